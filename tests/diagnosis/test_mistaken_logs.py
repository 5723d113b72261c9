"""A log that is not what was measured is told first, and no cause is sure."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.core.simulate import Model, model, simulate
from servo_models.core.types import Array
from servo_models.data.audit import audits
from servo_models.data.log import Log
from servo_models.diagnosis.preconditions import imitators
from servo_models.identification.plausibility import answer_time, mistaken_columns
from tests.conftest import Run
from tests.support.logs import log_of
from tests.support.plausible_logs import sane

GIMBAL = Path(__file__).parents[2] / "examples" / "gimbal"


def diagnosed(run: Run, folder: Path, spoil: Callable[[Array], Array]) -> dict[str, Any]:
    """A diagnosis of the gimbal whose angle was spoilt."""
    shutil.copytree(GIMBAL, folder)
    header, *rows = (folder / "log.csv").read_text("utf-8").splitlines()
    table = np.array([row.split(",") for row in rows], dtype=float)
    column = header.split(",").index("angle_deg")
    table[:, column] = spoil(table[:, column])
    np.savetxt(folder / "log.csv", table, "%.6g", ",", header=header, comments="")
    code, out, _ = run("diagnose", folder / "gimbal.toml", "--format", "json")
    assert code == 1
    return dict(json.loads(out))


@pytest.mark.thorough
def test_a_mistake_is_told_first_and_no_effect_that_imitates_it_is_taken(
    run: Run, tmp_path: Path
) -> None:
    found = diagnosed(
        run, tmp_path / "gimbal", lambda angle: np.clip(angle, *np.quantile(angle, [0.2, 0.8]))
    )
    assert found["sentence"].startswith("Correct log 'log': 'reading' is clipped")
    assert all(effect["probability"] is None for effect in found["effects"])
    assert "explains" not in found["sentence"].partition(":")[2].partition(";")[0]
    names = {effect["name"] for effect in found["effects"]}
    assert names
    assert not names & {"end_stops", "drive_saturation"}
    assert any("not tried" in text for text in found["warnings"])


@pytest.mark.thorough
def test_a_column_that_contradicts_the_model_is_told_first(run: Run, tmp_path: Path) -> None:
    found = diagnosed(run, tmp_path / "gimbal", np.negative)
    assert found["sentence"].startswith(
        "Correct log 'log': column 'angle_deg' ('reading') goes against the command"
    )
    assert all(effect["probability"] is None for effect in found["effects"])


@pytest.mark.thorough
def test_gains_imitate_a_sign_and_lags_a_time_that_runs_too_slowly() -> None:
    chosen, log = sane("smart_servo", "xl330", 105)
    turned = replace(log, outputs={name: -it for name, it in log.outputs.items()})
    assert "command_gain" in left_out(chosen, turned)
    assert "command_lag" not in left_out(chosen, turned)
    assert "command_lag" in left_out(chosen, replace(log, times=20.0 * log.times))
    assert not left_out(chosen, log)


def test_a_load_is_no_zero_of_a_current_that_is_elsewhere() -> None:
    """It moves the current for good, as the loop holds the speed: a load is to be found there."""
    motor = model("dc_motor_speed", "direct")
    loaded = replace(motor, values={**motor.values, "constant_load.torque": -0.06})
    times = 0.002 * np.arange(800)
    sent = np.repeat([0.0, 60.0, -40.0, 20.0], 200)
    speed, current = (
        simulate(loaded, times, {"speed_command": sent})[it] for it in ("encoder_speed", "current")
    )
    log = log_of(times, {"speed_command": sent}, {"encoder_speed": speed, "current": current})
    assert np.median(current) < -1.0
    assert not left_out(motor, log)
    bench = log_of(
        times, {"speed_command": sent}, {"encoder_angle": 90.0 + np.cumsum(speed) * 0.002}
    )
    assert "constant_load" in left_out(motor, bench)


def left_out(chosen: Model, log: Log) -> tuple[str, ...]:
    (found,) = audits([log], chosen.plant)
    wrong = tuple(mistaken_columns(chosen, log, answer_time(chosen)))
    return imitators([replace(found, mistakes=wrong)], chosen.plant)
