"""A log of the motor of eq. 12 with its delay, and descriptions of it without one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from servo_models.validation.torque_motor.reference import IDENTIFIED, Linear

RATE = 4000.0
NOISE = 5e-5
DESCRIPTION = """
actuator = "torque_motor"
variant = "identified"
parameters.transport_delay.time = 0
[uncertainty]
torque_constant = "5 %"
inductance = "5 %"
[[logs]]
file = "log.csv"
time = {{ column = "t", unit = "s" }}
inputs.voltage = {{ column = "u", unit = "V" }}
outputs.angle = {{ column = "angle", unit = "deg" }}
{}
"""


def write_log(path: Path, seconds: float = 0.5) -> None:
    """Steps and a chirp of the motor of eq. 12, its delay included, with white noise."""
    times = np.arange(0.0, seconds, 1.0 / RATE)
    steps = 8.0 * np.sign(np.sin(2.0 * np.pi * 12.0 * times))
    chirp = 10.0 * np.sin(2.0 * np.pi * (5.0 + 150.0 * times) * times)
    voltage = np.where(times < 0.5 * seconds, steps, chirp)
    inputs = {"voltage": voltage, "load_torque": np.zeros_like(times)}
    angle = Linear(IDENTIFIED)(times, inputs)["angle"]
    angle = np.rad2deg(angle + NOISE * np.random.default_rng(5).standard_normal(len(times)))
    rows = np.column_stack([times, voltage, angle])
    np.savetxt(path, rows, "%.9g", delimiter=",", header="t,u,angle", comments="")


def describe(folder: Path, text: str = DESCRIPTION.format(""), seconds: float = 0.5) -> Path:
    write_log(folder / "log.csv", seconds)
    path = folder / "rig.toml"
    path.write_text(text)
    return path
