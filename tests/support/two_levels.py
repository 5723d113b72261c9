"""A log that shows two levels only, so that static laws look alike in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from servo_models.core.simulate import Model
from servo_models.core.types import Array
from tests.support.logs import measured

STEP = 5e-4
FLOOR = 2e-5
TWO_LEVELS = np.repeat([0.0, 10.0, 0.0], 200)
"""A log that shows nothing but two levels: what a static law does in between is not seen."""
DEAD_ZONE = {"drive_dead_zone.half_width": 1.5}
HEAD = """
actuator = "torque_motor"
variant = "estimated"
parameters.end_stops.half_range = 0
[uncertainty]
resistance = "1 %"
stiffness = "1 %"
rotor_inertia = "1 %"
"""
LOG = """
[[logs]]
file = "{}"
time = {{ column = "t", unit = "s" }}
inputs.voltage = {{ column = "u", unit = "V" }}
outputs.angle = {{ column = "angle", unit = "rad" }}
"""


def record(file: Path, rig: Model, times: Array, voltage: Array, seed: int) -> str:
    """Play a command on a rig; returns the lines that describe its log."""
    log = measured(rig, times, {"voltage": voltage}, {"angle": FLOOR}, seed)
    rows = np.column_stack([times, voltage, log.outputs["angle"]])
    np.savetxt(file, rows, "%.12g", delimiter=",", header="t,u,angle", comments="")
    return LOG.format(file.name)
