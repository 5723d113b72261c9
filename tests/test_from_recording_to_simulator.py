"""From a robot's recording to the lines of its simulator, by the commands of the documentation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from servo_models import model, simulate
from servo_models.core.types import Array
from tests.conftest import Run
from tests.support.lerobot import FPS, JOINTS, data_set

DELAY = 0.13  # s, of which the variant knows nothing


def moved(frames: int, seed: int) -> tuple[Array, Array]:
    """Commands [deg] of slow motions, and what a late servo makes of them, both joints alike."""
    times = np.arange(frames) / FPS
    random = np.random.default_rng(seed)
    waves = [random.uniform(5.0, 15.0) * np.sin(w * times) for w in (1.1, 2.3, 4.1)]
    goal = np.round(np.sum(waves, axis=0), 2)
    servo = model("second_order_servo", "bus", {"transport_delay.time": DELAY})
    rest = {"goal": np.radians(goal), "pulse_width": 1.5e-3}
    angle = np.degrees(simulate(servo, times, rest)["angle_reading"])
    read = np.round(angle + 0.05 * random.standard_normal(frames), 2)
    return np.column_stack([goal, goal]), np.column_stack([read, read])


@pytest.mark.thorough
def test_a_joint_of_a_data_set_becomes_lines_of_mujoco(run: Run, tmp_path: Path) -> None:
    """LeRobot folder, description, diagnosis, MJCF: the delay comes through."""
    data_set(tmp_path / "arm", [moved(300, seed) for seed in range(3)])
    code, out, err = run("check", tmp_path / "arm", "--init")
    assert (code, out.count("wrote")) == (0, len(JOINTS)), err
    description, found = tmp_path / "arm_elbow.toml", tmp_path / "GAP.toml"
    code, out, err = run("diagnose", description, "--out", found)
    assert code == 1, err
    code, out, err = run("export", found, "--to", "mujoco", "--log", description)
    assert code == 0, err
    line = next(line for line in out.splitlines() if line.startswith("<position"))
    (delay,) = re.findall(r'delay="([\d.]+)"', line)
    assert float(delay) == pytest.approx(DELAY, abs=0.5 / FPS)
    (share,) = re.findall(r"MuJoCo keeps (\d+) %", out)
    assert int(share) > 80
