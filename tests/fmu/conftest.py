"""In this folder a test of an FMU is run with all kinds of it: Python, native, FMI 3.0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from servo_models.build import FMI3, NATIVE, PYTHON, build
from servo_models.core.compilers import compiler
from servo_models.core.simulate import model
from tests.conftest import MODELS
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
    folder = tmp_path_factory.mktemp(f"built {kind} FMUs")

    def built(name: str) -> Path:
        path = folder / f"{name}.fmu"
        return path if path.exists() else build(model(*MODELS[name]), path, kind)

    return built


@pytest.fixture
def host(fmu_folder: Files) -> Iterator[Host]:
    """A torque motor that has made one step of 1 ms."""
    with Host(fmu_folder("torque_motor")) as made:
        made.start({"voltage": 10.0})
        made.fmu.doStep(0.0, 1e-3)
        yield made
