"""A log that shows two levels only, so that static laws look alike in it."""

from __future__ import annotations

import numpy as np

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
