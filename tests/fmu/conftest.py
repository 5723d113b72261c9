"""In this folder a test of an FMU is run with all kinds of it: Python, native, FMI 3.0."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from servo_models.build import FMI3, NATIVE, PYTHON
from servo_models.core.compilers import compiler
from tests.conftest import built_once, extracted
from tests.support.fmu_host import Host

Files = Callable[[str], Path]


@pytest.fixture(scope="session", params=[PYTHON, NATIVE, FMI3])
def kind(request: pytest.FixtureRequest) -> str:
    if request.param != PYTHON and compiler() is None:
        pytest.skip('no C compiler: install one, or pip install ".[native]"')
    return str(request.param)


@pytest.fixture(scope="session")
def fmu_file(kind: str, tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Return the path of an FMU of ``MODELS``."""
    return functools.partial(built_once, tmp_path_factory, kind=kind)


@pytest.fixture(scope="session")
def fmu_folder(fmu_file: Files, tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Return the folder in which it is extracted: pytest would share that of other folders' tests,
    which is of Python, whichever kind is asked for."""
    return extracted(fmu_file, tmp_path_factory.mktemp("extracted FMUs"))


@pytest.fixture
def host(fmu_folder: Files) -> Iterator[Host]:
    """A torque motor that has made one step of 1 ms."""
    with Host(fmu_folder("torque_motor")) as made:
        made.start({"voltage": 10.0})
        made.fmu.doStep(0.0, 1e-3)
        yield made
