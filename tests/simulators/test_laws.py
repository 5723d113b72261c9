"""The law of each simulator against the simulator itself, or against a second writing of it."""

from __future__ import annotations

import math
import re
from collections import deque
from pathlib import Path

import numpy as np
import pytest

from servo_models.core.types import Array
from servo_models.simulators import simulator
from servo_models.simulators.refit import delayed
from servo_models.simulators.simulator import DELAY
from tests.support.engines import ardupilot_angles, jsbsim_angles, mujoco_angles, mujoco_model

INERTIA = 0.003  # kg m2
COUNT = 800
HELD = (0, 1.0, 1.0, 0.9, -0.5, 0.3, 0.3, 0.0)  # rad, goals one after the other
GOAL = np.repeat(np.array(HELD, dtype=float), COUNT // len(HELD))
LOAD = np.where((np.arange(COUNT) > 250) & (np.arange(COUNT) < 350), 0.05, 0.0)  # N m

Fields = dict[str, float]


def law(name: str, fields: Fields) -> tuple[str, float, Array]:
    """Exported lines, time step, and the angles of the law for the same fields."""
    of = simulator(name)
    values = {field.name: fields.get(field.name, 0.0) for field in of.fields}
    goal = delayed(GOAL, values[DELAY])
    begun = fields.get("bias", 0.0)  # an engine's memories begin at 0
    angles = of.angles(values, of.step, goal, LOAD, INERTIA, begun)
    return of.lines(values, of.step, INERTIA), of.step, angles


JOINT = {"kp": 1.2, "damping": 0.05}


@pytest.mark.parametrize(
    "fields",
    [
        JOINT,
        {"kp": 1.2, "kv": 0.03},
        {**JOINT, "forcerange": 0.3},
        {**JOINT, "kv": 0.03, "forcerange": 0.3},
        {**JOINT, "frictionloss": 0.02},
        {**JOINT, "timeconst": 0.03},
        {**JOINT, "delay": 5.0},
        {
            **JOINT,
            "kv": 0.02,
            "forcerange": 0.3,
            "frictionloss": 0.02,
            "timeconst": 0.02,
            "delay": 9.0,
        },
    ],
    ids="+".join,
)
def test_mujoco_moves_the_joint_as_the_law_says(fields: Fields) -> None:
    """Up to the inertia of the body that its joint needs, a part in 3e6."""
    pytest.importorskip("mujoco", minversion="3.5")  # which has delays
    lines, _, angles = law("mujoco", fields)
    engine = mujoco_angles(mujoco_model(lines), GOAL, LOAD)
    assert np.ptp(engine) > 1.0
    assert engine == pytest.approx(angles, abs=1e-6)


@pytest.mark.parametrize(
    "fields",
    [
        {"lag": 20.0},
        {"rate_limit": 2.0},
        {"deadband_width": 0.1},
        {"hysteresis_width": 0.2},
        {"bias": 0.1},
        {"clipto": 0.6},
        {"delay": 1.0},
        {"delay": 7.0},
        {
            "lag": 20.0,
            "rate_limit": 3.0,
            "hysteresis_width": 0.05,
            "bias": 0.02,
            "clipto": 0.7,
            "delay": 3.0,
        },
    ],
    ids="+".join,
)
def test_jsbsim_moves_as_the_law_says(fields: Fields, tmp_path: Path) -> None:
    """To the last digits: both are sums and products of doubles."""
    pytest.importorskip("jsbsim")
    lines, step, angles = law("jsbsim", fields)
    engine = jsbsim_angles(lines, step, GOAL, tmp_path)
    assert engine[10:] == pytest.approx(angles[10:], abs=1e-9)  # its delay is first filled with 0


def isaaclab(lines: str, step: float) -> Array:
    """Isaac Lab's DelayedPDActuator on a joint of PhysX, from the configuration as printed."""
    cfg = {name: float(number) for name, number in re.findall(r"(\w+)=([-\d.e]+),", lines)}
    buffer = deque([GOAL[0]] * int(cfg["max_delay"] + 1), maxlen=int(cfg["max_delay"] + 1))
    position, velocity, angles = 0.0, 0.0, []
    for wanted, torque in zip(GOAL, LOAD):
        angles.append(position)
        buffer.append(wanted)
        effort = cfg["stiffness"] * (buffer[0] - position) - cfg["damping"] * velocity
        limit = cfg.get("effort_limit", math.inf)
        effort = float(np.clip(effort, -limit, limit))
        velocity += (effort - torque) / cfg["armature"] * step
        impulse = -velocity * cfg["armature"]  # to rest, as PhysX solves for it
        most = cfg.get("friction", 0.0) * step
        velocity += float(np.clip(impulse, -most, most)) / cfg["armature"]
        fastest = cfg.get("velocity_limit_sim", math.inf)
        velocity = float(np.clip(velocity, -fastest, fastest))
        position += velocity * step
    return np.array(angles)


@pytest.mark.parametrize(
    "fields",
    [
        {"stiffness": 1.2, "damping": 0.05},
        {"stiffness": 1.2, "damping": 0.05, "effort_limit": 0.25, "velocity_limit_sim": 4.0},
        {"stiffness": 1.2, "damping": 0.05, "friction": 0.02, "delay": 3.0},
    ],
    ids="+".join,
)
def test_isaac_lab_moves_as_written_a_second_time(fields: Fields) -> None:
    lines, step, angles = law("isaaclab", fields)
    again = isaaclab(lines, step)
    assert np.ptp(again) > 0.5
    assert again == pytest.approx(angles, abs=1e-9)


@pytest.mark.parametrize(
    "fields",
    [
        {"speed": 0.1},
        {"speed": 0.2, "delay": 12.0},
        {"filter": 5.0},
        {"speed": 0.15, "filter": 4.0, "delay": 30.0},
    ],
    ids="+".join,
)
def test_ardupilot_moves_as_written_a_second_time(fields: Fields) -> None:
    lines, step, angles = law("ardupilot", fields)
    assert np.ptp(angles) > 0.3
    assert ardupilot_angles(lines, step, GOAL) == pytest.approx(angles, abs=1e-9)
