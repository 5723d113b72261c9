"""Diagnoses and parameter sets side by side: errors by simulation, and what has changed is said."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.diagnosis.comparison.compare import compare
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.sources import ROOT

GIMBAL = ROOT / "examples" / "gimbal"
FITTED = {"speed_constant": 0.9, "drive_dead_zone.half_width": 0.6}
SET = """actuator = "gimbal.py"
[parameters.speed_constant]
value = 0.76
unit = "rad/(V.s)"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The gimbal with a diagnosis, of which what ``compare`` reads, and a parameter file."""
    for name in ("gimbal.py", "gimbal.toml", "log.csv"):
        shutil.copy(GIMBAL / name, tmp_path)
    (tmp_path / "retuned.toml").write_text(SET)
    write(tmp_path)
    return tmp_path


def write(folder: Path, **other: Any) -> None:
    digests = {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest()
        for name in ("gimbal.toml", "log.csv")
    }
    document = {
        "description": {"file": "gimbal.toml", "sha256": digests["gimbal.toml"]},
        "actuator": "gimbal",
        "variant": "bench",
        "parameters": [{"name": name, "value": value} for name, value in FITTED.items()],
        "logs": [{"file": "log.csv", "sha256": digests["log.csv"]}],
    }
    (folder / "found.json").write_text(json.dumps({**document, **other}))


def test_errors_are_those_of_simulations(folder: Path) -> None:
    found = compare([folder / "found.json", folder / "retuned.toml"])
    (log,) = read_description(folder / "gimbal.toml").logs
    expected = []
    for values in ({}, FITTED, {"speed_constant": 0.76}):
        response = simulate(model(str(folder / "gimbal.py"), None, values), log.times, log.inputs)
        expected.append(
            float(np.sqrt(np.mean((response["reading"] - log.outputs["reading"]) ** 2)))
        )
    np.testing.assert_allclose(found.errors[log.name, "reading"], expected, rtol=1e-9)
    assert found.remarks == ()
    assert found.changed == ["speed_constant", "drive_dead_zone.half_width"]
    assert list(found.report().panels[0].models[0].sets) == ["nominal", "found", "retuned"]


def test_what_has_changed_is_said(folder: Path) -> None:
    text = (folder / "gimbal.toml").read_text()
    (folder / "gimbal.toml").write_text(text + "# edited\n")
    (folder / "log.csv").write_text((folder / "log.csv").read_text() + "4000,0,0\n")
    said = compare([folder / "found.json", folder / "retuned.toml"]).remarks
    assert any("another 'gimbal.toml'" in it for it in said)
    assert any("'log.csv' has changed" in it for it in said)
    assert not any("different logs" in it for it in said)
    write(folder, logs=[{"file": "other.csv", "sha256": "0" * 64}])
    assert any(
        "'other.csv', which is not here" in it for it in compare([folder / "found.json"]).remarks
    )


def test_diagnoses_of_different_logs_are_said_to_be_that(folder: Path) -> None:
    """Of two folders, of one where the log was recorded anew, or by another name."""
    again, new, mine = folder / "again", (folder / "log.csv").read_text(), folder / "found.json"
    again.mkdir()
    for file in [*folder.glob("gimbal.*")]:
        shutil.copy(file, again)
    (again / "log.csv").write_text(new + "4000,0,0\n")
    write(again)
    kept = shutil.copy(again / "found.json", folder / "before.json")
    write(again, logs=[{"file": "b.csv", "sha256": "0" * 64}])
    named = shutil.copy(again / "found.json", folder / "named.json")
    write(again)
    for other, which in (
        (again / "found.json", "another 'log.csv'"),
        (kept, "another 'log.csv'"),
        (named, "'b.csv', which is not here"),
    ):
        (said,) = compare([mine, other]).remarks
        begin = f"'{other}' is of different logs than '{folder / 'gimbal.toml'}': {which}."
        assert said == f"{begin} Errors are on those of '{folder / 'gimbal.toml'}'."
    (said,) = compare([again / "found.json"], folder / "gimbal.toml").remarks
    assert "different logs" in said


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("bad.json", "{", "no diagnosis"),
        ("bad.json", '{"parameters": 3}', "no diagnosis"),
        ("bad.json", '{"actuator": "x", "variant": "y", "parameters": [], "logs": []}', "--on"),
        ("bad.toml", 'actuator = "sg90"', "give --on"),
    ],
)
def test_what_cannot_be_compared(folder: Path, name: str, content: str, said: str) -> None:
    (folder / name).write_text(content)
    with pytest.raises(UserError, match=said):
        compare([folder / name])


def test_another_actuator_is_refused(folder: Path) -> None:
    (folder / "servo.toml").write_text('actuator = "sg90"')
    with pytest.raises(UserError, match="of one actuator"):
        compare([folder / "servo.toml"], folder / "gimbal.toml")


def test_values_of_another_model_are_not_mixed_with_the_described_ones(folder: Path) -> None:
    write(folder, variant="other")
    with pytest.raises(UserError, match="begins with variant 'other'"):
        compare([folder / "found.json"])
    write(folder, parameters=[{"name": "speed_constent", "value": 1.0}])
    with pytest.raises(UserError, match="did you mean 'speed_constant'"):
        compare([folder / "found.json"])


def test_the_command_prints_and_writes(folder: Path, run: Run) -> None:
    page, out = folder / "c.html", folder / "c.json"
    code, text, _ = run("compare", folder / "found.json", "--report", page, "--json", out)
    assert code == 0
    assert "drive_dead_zone.half_width" in text
    assert "data-live" in page.read_text("utf-8")
    assert json.loads(out.read_text())["parameters"]["speed_constant"] == {
        "nominal": 0.8,
        "found": 0.9,
    }
