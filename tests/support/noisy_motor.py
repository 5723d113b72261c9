"""Noisy logs of the torque motor's angle under five levels of voltage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from tests.support.logs import measured

STEP, NOISE = 1e-3, 2e-4
MOTOR = model("torque_motor", "measured", {"end_stops.half_range": 0.0})
VOLTAGE = 20.0 * np.repeat([0.0, 1.0, -1.0, 0.5, 0.0], 100)
TIMES = STEP * np.arange(len(VOLTAGE))


def motor_log(seed: int | None = 0, chosen: Model = MOTOR, size: float = 1.0) -> Log:
    """A log of the torque motor's angle [rad], with white noise unless ``seed`` is None."""
    noise = {"angle": 0.0 if seed is None else NOISE}
    return measured(chosen, TIMES, {"voltage": size * VOLTAGE}, noise, seed or 0)


def frame(log: Log) -> pl.DataFrame:
    degrees = np.degrees(log.outputs["angle"])
    volts = log.inputs["voltage"]
    return pl.DataFrame({"time_s": log.times, "voltage_V": volts, "angle_deg": degrees})


DESCRIPTION = """
actuator = "torque_motor"
variant = "measured"
free = ["{free}"]
[[logs]]
file = "bench log.csv"
time = {{ column = "time_s" }}
inputs.voltage = {{ column = "voltage_V" }}
outputs.angle = {{ column = "angle_deg", unit = "deg" }}
"""


def described(csv: Path, free: str = "torque_constant") -> Path:
    path = csv.with_name("description.toml")
    path.write_text(DESCRIPTION.format(free=free))
    return path
