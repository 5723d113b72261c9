"""In this folder a test of an FMU is run with all kinds of it: Python, native, FMI 3.0."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest

from fmu_src.native.compilers import compiler
from servo_models.build import FMI3, NATIVE, PYTHON, build
from servo_models.core.simulate import model
from tests.conftest import MODELS

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


@pytest.fixture(scope="session")
def fmu_folder(fmu_file: Files, tmp_path_factory: pytest.TempPathFactory) -> Files:
    """Return the folder in which an FMU of ``MODELS`` is extracted."""
    parent = tmp_path_factory.mktemp("extracted FMUs")

    def extracted(name: str) -> Path:
        folder = parent / name
        if not folder.exists():
            fmpy.extract(str(fmu_file(name)), str(folder))
        return folder

    return extracted
