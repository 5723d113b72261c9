"""Descriptions of the logs of real actuators, as their authors recorded them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from servo_models.data.description import Description, read_description
from tests.support.own_actuators import WITH_A_FLAG, write


def log_of(
    folder: Path, tmp_path: Path, actuator: str, name: str, body: str, **options: str
) -> Description:
    path = tmp_path / "description.toml"
    file = (folder / name).as_posix()
    path.write_text(f'actuator = "{actuator}"\n[[logs]]\nfile = "{file}"\n{body}')
    return read_description(path)


def test_emps(logs_folder: Path, tmp_path: Path) -> None:
    body = """
    time = "t"
    inputs.reference = "qg"
    inputs.disturbance = "pulses_N"
    outputs = { position = "qm", drive = "vir" }
    settle = 0
    """
    found = log_of(logs_folder, tmp_path, "linear_drive", "emps/DATA_EMPS_PULSES.mat", body)
    (log,) = found.logs
    assert len(log.times) == 24841
    assert log.duration == pytest.approx(24.84, rel=1e-4)
    assert np.max(np.abs(log.outputs["position"] - log.inputs["reference"])) < 1e-3
    assert log.settle == 0.0


def test_sg90_steps(logs_folder: Path, tmp_path: Path) -> None:
    body = """
    time = { column = 1, unit = "ms" }
    inputs.pulse_width = { column = 2, unit = "us", scale = 10, offset = 600 }
    outputs.rate_reading = { column = 3, unit = "deg/s", scale = 7.75 }
    held_out = { input = "pulse_width", levels = "even" }
    """
    (log,) = log_of(logs_folder, tmp_path, "sg90", "sg90_steps/log.csv", body).logs
    command = log.inputs["pulse_width"]
    away = command != command[0]
    starts = away & (np.diff(command, prepend=command[0]) != 0.0)
    assert np.count_nonzero(starts) == 26  # and as many steps back
    levels = np.unique(command[away])
    assert levels[-1] == pytest.approx(600e-6 + 135 * 10e-6)
    held = [bool(log.held_out[command == level].all()) for level in levels]
    assert held == [i % 2 == 1 for i in range(len(levels))]
    turned = np.cumsum(log.outputs["rate_reading"][:-1] * np.diff(log.times))
    assert np.max(np.abs(turned)) > 1.0  # the last steps are of more than 2 rad


def test_sg90_video(logs_folder: Path, tmp_path: Path) -> None:
    body = """
    time = "t_s"
    inputs.pulse_width = { column = "cmd_rad", unit = "us", scale = 600, offset = 600 }
    outputs.angle_reading = { column = "theta_rad", unit = "rad" }
    """
    (log,) = log_of(logs_folder, tmp_path, "sg90", "sg90_video/sg90_square180.csv", body).logs
    assert np.median(np.diff(log.times)) == pytest.approx(1 / 29.9, rel=0.01)
    assert np.ptp(log.outputs["angle_reading"]) == pytest.approx(math.pi, rel=0.1)


@pytest.mark.parametrize("name", ["rotation-multisine", "wrist_roll-trapezoidal_profile"])
def test_so101(logs_folder: Path, tmp_path: Path, name: str) -> None:
    write(tmp_path, name="mine.py", changes=WITH_A_FLAG)
    body = """
    time = "time_s"
    inputs.goal = "command_rad"
    outputs = { angle = "position_rad", speed = "velocity_rad_s" }
    """
    (log,) = log_of(logs_folder, tmp_path, "mine.py", f"so101/{name}.csv", body).logs
    assert np.median(np.diff(log.times)) == pytest.approx(0.0201, rel=0.01)
    assert np.corrcoef(log.inputs["goal"], log.outputs["angle"])[0, 1] > 0.9


def test_xl330(logs_folder: Path, tmp_path: Path) -> None:
    write(tmp_path, name="mine.py", changes=WITH_A_FLAG)
    body = """
    time = "timestamp"
    inputs = { goal = "goal_position", enabled = "torque_enable" }
    outputs.angle = "position"
    """
    for path in sorted((logs_folder / "bam_xl330").glob("*.json")):
        (log,) = log_of(logs_folder, tmp_path, "mine.py", f"bam_xl330/{path.name}", body).logs
        assert log.duration == pytest.approx(6.0, rel=0.01)
        assert set(np.unique(log.inputs["enabled"])) <= {0.0, 1.0}
        document = json.loads(path.read_text())
        row = int(log.rows[100]) - 1
        assert document["entries"][row]["position"] == log.outputs["angle"][100]
