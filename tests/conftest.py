"""FMUs built once per test session, in a folder with spaces in its name; measured logs."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from hypothesis import settings

from servo_models.build import PYTHON, build
from servo_models.catalogue import model
from servo_models.cli import main
from tests.support.made_once import made_once

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

MODELS = {
    "sg90": ("sg90", None),
    "sg90_linear": ("sg90", "linear"),
    "oscillatory": ("sg90", "oscillatory_motor"),
    "torque_motor": ("torque_motor", None),
    "measured": ("torque_motor", "measured"),
    "linear_drive": ("linear_drive", None),
    "smart_servo": ("smart_servo", None),
    "second_order_servo": ("second_order_servo", None),
    "dc_motor": ("dc_motor", None),
    "dc_motor_current": ("dc_motor_current", None),
    "dc_motor_speed": ("dc_motor_speed", None),
    "sg90_torque": ("sg90_torque", None),
    "torque_motor_torque": ("torque_motor_torque", None),
}


QUICK = ("sg90", "torque_motor", "dc_motor", "sg90_torque")
"""Models with which a test of FMUs is quick; with the others the same test is thorough."""
TWINS = (
    "sg90_linear",
    "oscillatory",
    "measured",
    "dc_motor_current",
    "dc_motor_speed",
    "torque_motor_torque",
)
"""Models of blocks that others have as well: with them it is long."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        call, asked = getattr(item, "callspec", None), getattr(item, "fixturenames", ())
        name = call.params.get("name") if call else None
        if name in MODELS and name not in QUICK and {"fmu_file", "fmu_folder"} & {*asked}:
            item.add_marker(pytest.mark.long if name in TWINS else pytest.mark.thorough)


def built_once(factory: pytest.TempPathFactory, name: str, kind: str = PYTHON) -> Path:
    """Return the path of an FMU of ``MODELS``, which is built once for all workers."""
    file = f"{name}.fmu"

    def make(folder: Path) -> None:
        build(model(*MODELS[name]), folder / file, kind)

    return made_once(factory, f"built {kind} {name}", make) / file


@pytest.fixture(scope="session")
def fmu_file(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the path of an FMU of ``MODELS``."""
    return functools.partial(built_once, tmp_path_factory)


@pytest.fixture(scope="session")
def fmu_folder(
    fmu_file: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], Path]:
    """Return the folder in which an FMU of ``MODELS`` is extracted."""
    return extracted(fmu_file, tmp_path_factory.mktemp("extracted FMUs"))


def extracted(fmu_file: Callable[[str], Path], parent: Path) -> Callable[[str], Path]:
    """Return what extracts an FMU into a folder of ``parent``, once."""

    def folder_of(name: str) -> Path:
        folder = parent / name
        if not folder.exists():
            fmpy.extract(str(fmu_file(name)), str(folder))
        return folder

    return folder_of


@pytest.fixture(scope="session")
def logs_folder() -> Path:
    """Return the folder of the measured logs, which are no part of the repository."""
    beside = Path(__file__).parent.parent.parent / "shared" / "data"
    folder = Path(os.environ.get("SERVO_MODELS_DATA", beside))
    if not folder.is_dir():
        pytest.skip(f"no measured logs in '{folder}': set SERVO_MODELS_DATA to their folder")
    return folder


Run = Callable[..., tuple[int, str, str]]
"""A command with its words: exit code, stdout, stderr."""


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command in this process: exit code, stdout, stderr."""

    def command(*words: str | Path) -> tuple[int, str, str]:
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return command
