"""Adding an actuator is adding a folder: the catalogue and the validation find what is in it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import servo_models.actuators
import servo_models.validation
from servo_models.catalogue import actuators, all_actuators, model
from servo_models.core.simulate import Model
from servo_models.validation.cases import all_cases, offered
from servo_models.validation.responses import response_rows
from servo_models.validation.rows import MODEL, Validation, judged
from tests.support.own_actuators import SOURCE

CASES = """
import numpy as np
from servo_models.validation.cases import Case, grid

TIMES = grid(1.0, 0.01)

def reference(times, inputs):
    return {"angle": 1.0 - np.exp(-times / 0.2)}

def cases():
    return [Case("joint", "plain", "step", TIMES, {"goal": 1.0}, reference, "closed form", True)]
"""
PICTURES = """
from servo_models.report.sections import Section
SECTIONS = (Section("A joint", items=("It lags.",)),)
"""
FILES = {
    servo_models.actuators: {"__init__": SOURCE},
    servo_models.validation: {"__init__": "", "cases": CASES, "pictures": PICTURES},
}


@pytest.fixture(autouse=True)
def folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Folders of an actuator called ``joint`` beside those of the package."""
    for package, files in FILES.items():
        folder = tmp_path / package.__name__ / "joint"
        folder.mkdir(parents=True)
        for name, text in files.items():
            (folder / f"{name}.py").write_text(text)
        monkeypatch.setattr(package, "__path__", [*package.__path__, str(folder.parent)])
    actuators.cache_clear()
    all_actuators.cache_clear()
    yield
    actuators.cache_clear()
    all_actuators.cache_clear()
    for name in [name for name in sys.modules if name.endswith(".joint") or ".joint." in name]:
        del sys.modules[name]


def test_the_catalogue_finds_it() -> None:
    assert model("joint").actuator is actuators()["joint"]


def test_the_validation_finds_its_cases_and_judges_them() -> None:
    (case,) = [case for case in all_cases() if case.actuator == "joint"]
    rows = response_rows(case, model("joint"), Model.run)
    assert {row.quantity for row in rows if row.passed is False} == set()
    wrong = response_rows(case, model("joint", None, {"time_constant": 0.201}), Model.run)
    assert "angle: largest error" in {row.quantity for row in wrong if row.passed is False}


def test_the_report_shows_its_section_and_a_missing_part_is_none() -> None:
    assert "joint" not in offered("paper")
    row = judged(MODEL, ("joint", "plain", "step"), "angle: largest error", 0.0, 1e-6)
    titles = [section.title for section in Validation((row,)).report().sections]
    assert "A joint" in titles
    assert "Linear drive: to and fro" not in titles
