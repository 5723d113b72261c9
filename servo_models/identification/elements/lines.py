"""Potentiometer and amplifier: characteristics that are straight lines.

Source: Draper, Smith, Applied Regression Analysis, 3rd ed., ch. 1.
"""

from __future__ import annotations

import math
from operator import itemgetter

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import BENT, Figure, Interval, is_curved, linear


def potentiometer(angle: Array, voltage: Array) -> tuple[list[Figure], list[str]]:
    """Return k_FS [V/rad] and where the voltage is 0; and doubts about the table.

    Raises:
        UserError: the voltage does not go with the angle at all.
    """
    gain, zero, curved = _line(angle, voltage)
    figures = [
        Figure("gain k_FS", gain, "V/rad", "V/deg", "potentiometer_gain"),
        Figure("angle of 0 V", zero, "rad", "deg"),
    ]
    return figures, [f"{BENT}; see effect sensor_nonlinearity"] * curved


def amplifier(given: Array, output: Array, loaded: bool = False) -> tuple[list[Figure], list[str]]:
    """Return K_AP [1] and where the output is 0; and doubts about the table.

    Raises:
        UserError: the output does not go with the input at all.
    """
    gain, zero, curved = _line(given, output)
    figures = [
        Figure(f"gain K_AP{' with load' * loaded}", gain, "1", parameter="amplifier_gain"),
        Figure("input of 0 V", zero, "V"),
    ]
    doubt = f"{BENT}; cut the table to rows outside a dead band and between the limits"
    return figures, [doubt] * curved


def _line(x: Array, y: Array) -> tuple[Interval, Interval, bool]:
    """Slope, where the line meets 0, and whether the rows are curved about it."""
    line = linear(np.column_stack([x, np.ones(len(x))]), y)
    gain = line.estimate(itemgetter(0))
    if gain.value == 0.0 or gain.low <= 0.0 <= gain.high < math.inf:
        raise UserError("no slope; name another column, or measure over a range")
    return gain, line.estimate(lambda v: -v[1] / v[0]), is_curved(x, line.residuals)
