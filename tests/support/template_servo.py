"""The servo of ``servo-models new actuator`` a second time, by scipy, and a log of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from servo_models.core.types import Array

VALUES = {"inertia": 2e-3, "top_speed": 8.0, "stall_torque": 1.0, "gain": 6.0}
"""As in the file [SI]."""
STEPS = np.repeat(np.radians([0, 10, -20, 2, 0, 3, 25, -6, -4, 15]), 60)
"""Commands [rad] that a log holds, each for 0.6 s."""
STEP_SIZE = 0.01  # of the log [s]
NOISE = np.radians(0.02)
DESCRIPTION = """actuator = "{name}.py"

[[logs]]
file = "log.csv"
time = {{ column = "time", unit = "s" }}
inputs.command = {{ column = "command", unit = "rad" }}
outputs.reading = {{ column = "reading", unit = "rad" }}
"""


def angles(
    commands: Array,
    step_size: float,
    values: dict[str, float],
    load: Callable[[float], float] = lambda speed: 0.0,
    dead_zone: float = 0.0,
) -> Array:
    """Return the angle [rad], shape (n,), at the time of each command, which is held."""

    def slopes(_: float, state: Array, command: float) -> list[float]:
        angle, speed = state
        drive = values["gain"] * (command - angle)
        drive = np.sign(drive) * max(abs(drive) - dead_zone, 0.0)
        torque = values["stall_torque"] * (np.clip(drive, -1.0, 1.0) - speed / values["top_speed"])
        return [speed, (torque - load(speed)) / values["inertia"]]

    state, found = np.zeros(2), []
    for command in commands:
        found.append(state[0])
        span = (0.0, step_size)
        state = solve_ivp(slopes, span, state, "DOP853", args=(command,), rtol=1e-9, atol=1e-12).y[
            :, -1
        ]
    return np.array(found)


def write_log(folder: Path, name: str, reading: Array, commands: Array = STEPS) -> Path:
    """Write a log with noise, and its description, whose path is returned."""
    noise = NOISE * np.random.default_rng(3).standard_normal(len(commands))
    table = np.column_stack([STEP_SIZE * np.arange(len(commands)), commands, reading + noise])
    header = "time,command,reading"
    np.savetxt(folder / "log.csv", table, delimiter=",", header=header, comments="")
    path = folder / f"{name}.toml"
    path.write_text(DESCRIPTION.format(name=name))
    return path
