"""A log under the description of an actuator that did not make it: no cause is claimed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from tests.conftest import Run

NOISE = 1e-3
LEVELS = (0.0, 0.5, -0.3, 0.2, 0.8, -0.5, 0.0)  # commanded angles [rad]
AS_TORQUE_MOTOR = """
actuator = "torque_motor"
variant = "estimated"
[uncertainty]
torque_constant = "10 %"
stiffness = "10 %"
[[logs]]
file = "log.csv"
time = "t"
inputs.voltage = { column = "command", unit = "V", scale = 10 }
outputs.angle = "angle"
"""
AS_SG90 = """
actuator = "sg90"
[[logs]]
file = "log.csv"
time = "t"
inputs.pulse_width = { column = "command", unit = "us", scale = 590.8, offset = 1500 }
outputs.angle = "angle"
"""


def record(folder: Path, text: str, times: Array, command: Array, angle: Array) -> Path:
    """Write a log beside a description of it."""
    reading = angle + NOISE * np.random.default_rng(1).standard_normal(len(times))
    rows = np.column_stack([times, command, reading])
    names = "t,command,angle"
    np.savetxt(folder / "log.csv", rows, "%.9g", delimiter=",", header=names, comments="")
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def smart_servo(times: Array, command: Array) -> Array:
    return simulate(model("smart_servo", "sts3215"), times, {"goal": command})["angle"]


def linear_drive(times: Array, command: Array) -> Array:
    """A carriage that pulls a drum of 50 mm."""
    chosen = model("linear_drive", "identified")
    return simulate(chosen, times, {"reference": 0.05 * command})["position"] / 0.05


@pytest.mark.parametrize(
    ("rig", "step", "described", "doubt"),
    [
        pytest.param(
            *(smart_servo, 2.5e-3, AS_TORQUE_MOTOR, "that the log is of 'torque_motor'"),
            id="a smart servo as a torque motor",
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            *(linear_drive, 1e-2, AS_SG90, "moved further than their uncertainties allow"),
            id="a linear drive as an SG90",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_log_of_another_actuator_is_outside_the_catalogue(
    rig: Callable[[Array, Array], Array],
    step: float,
    described: str,
    doubt: str,
    run: Run,
    tmp_path: Path,
) -> None:
    command = np.repeat(LEVELS, 30)
    times = np.asarray(step * np.arange(len(command)), dtype=np.float64)
    path = record(tmp_path, described, times, command, rig(times, command))
    code, out, _ = run("diagnose", path, "--format", "json")
    document = json.loads(out)
    assert code == 1
    assert document["verdict"] == "outside-catalogue"
    assert document["sentence"].startswith("Outside the catalogue: ")
    assert document["gap"]["after"] > 10.0
    assert any(doubt in text for text in document["warnings"])


def test_a_log_of_a_quick_actuator_is_refused_under_a_slow_one(run: Run, tmp_path: Path) -> None:
    """A torque motor settles in milliseconds, an SG90 in a tenth of a second."""
    times = np.asarray(2.5e-4 * np.arange(200), dtype=np.float64)
    command = np.repeat([0.0, 0.5], 100)
    angle = simulate(model("torque_motor"), times, {"voltage": 10.0 * command})["angle"]
    code, out, err = run("diagnose", record(tmp_path, AS_SG90, times, command, angle))
    assert (code, out) == (2, "")
    assert "name the actuator that made it" in err
    assert len(err.splitlines()) == 1
