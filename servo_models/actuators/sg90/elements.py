"""The elements of the servo as they are measured on a bench, one by one (SG90 paper sec. 4).

A description names the table of each under ``[elements.NAME]``.
"""

from __future__ import annotations

from dataclasses import dataclass

from servo_models.core.plant import Wire


@dataclass(frozen=True)
class Bench:
    """What the table of an element holds.

    Attributes:
        columns: columns that it must have, whose values differ from row to row.
        optional: columns that it may have.
        rows: rows that it needs at least.
    """

    columns: tuple[Wire, ...]
    optional: tuple[Wire, ...] = ()
    rows: int = 3


_VOLTAGE = Wire("voltage", "V", "voltage")
_SPEED = Wire("speed", "rad/s", "speed of the motor")
_AMPLIFIER = Bench((Wire("input", "V", "input voltage"), Wire("output", "V", "output voltage")))
_BRANCH = Wire("branch", "1", "above 0 where the voltage goes away from 0")

TABLES = {
    "potentiometer": Bench((Wire("angle", "rad", "angle of the potentiometer"), _VOLTAGE)),
    "amplifier": _AMPLIFIER,
    "amplifier_loaded": _AMPLIFIER,
    "motor": Bench((_VOLTAGE, _SPEED), (_BRANCH,), rows=8),
    "motor_step": Bench((Wire("time", "s", "time of the row"), _SPEED), (_VOLTAGE,)),
}
"""Bench of each element by its name, in the order in which they are identified: a gain with load
replaces one without."""
LOOP = ("amplifier_gain", "potentiometer_gain", "motor_time_constant", "gear_ratio")
"""Parameters of the loop except the gain of the motor."""
MADE_OF = (*LOOP, "motor_gain", "feedback_coefficient", "angle_unit")
"""Parameters that an actuator made of these elements has."""
