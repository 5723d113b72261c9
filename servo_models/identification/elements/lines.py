"""Potentiometer and amplifier: static characteristics that are straight between edges.

The edges are knees of a continuous curve y = K g(x) + y_0, where g follows x and stands still
below a lower limit, above an upper limit and inside a dead band.  Knees and gain are fitted
together.  Which of the three flats there are is decided by an information criterion, in which a
knee costs more than an ordinary unknown, since it is searched for.
Sources: Seber, Wild, Nonlinear Regression, sec. 9.3 (joined lines); Yao, Statistics and
Probability Letters 6 (1988) 181 (number of breaks).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import combinations
from operator import itemgetter

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import BENT, Figure, Fit, fit, is_curved, linear

KNEES = ("no change below", "dead band from", "dead band to", "no change above")
SHAPES = [s for k in range(5) for s in combinations(range(4), k) if (1 in s) == (2 in s)]
"""Which of the knees there are; a dead band has both of its own."""


def potentiometer(angle: Array, voltage: Array) -> tuple[list[Figure], list[str]]:
    """Return k_FS [V/rad] and where the voltage is 0; and doubts about the table.

    Raises:
        UserError: the voltage does not go with the angle at all.
    """
    line, _ = _best(angle, voltage, SHAPES[:1])
    figures = [
        Figure("gain k_FS", line.estimate(itemgetter(0)), "V/rad", "V/deg", "potentiometer_gain"),
        Figure("angle of 0 V", line.estimate(lambda v: -v[1] / v[0]), "rad", "deg"),
    ]
    doubt = f"{BENT}; see effect sensor_nonlinearity"
    return figures, [doubt] * is_curved(angle, line.residuals)


def amplifier(given: Array, output: Array, loaded: bool = False) -> tuple[list[Figure], list[str]]:
    """Return K_AP [1], where the output is 0, and the edges of flats; and doubts about the table.

    Raises:
        UserError: no rows on a line: all of the table is flat, or one jump.
    """
    line, shape = _best(given, output, SHAPES)
    at = {knee: k for k, knee in enumerate(shape, start=2)}

    def zero(v: Array) -> float:  # in the middle of the dead band where there is one
        return float(0.5 * (v[at[1]] + v[at[2]]) if 1 in at else -v[1] / v[0])

    gain = line.estimate(itemgetter(0))
    figures = [
        Figure(f"gain K_AP{' with load' * loaded}", gain, "1", parameter="amplifier_gain"),
        Figure("input of 0 V", line.estimate(zero), "V"),
        *(Figure(KNEES[knee], line.estimate(itemgetter(k)), "V") for knee, k in at.items()),
    ]
    return figures, [BENT] * is_curved(given, line.residuals)


def _best(x: Array, y: Array, shapes: Sequence[tuple[int, ...]]) -> tuple[Fit, tuple[int, ...]]:
    """Gain, offset and knees of the shape with the least criterion, in which a knee costs 3 ln n;
    each is fitted from the best three of all places between rows."""
    middles = np.convolve(np.unique(x), [0.5, 0.5], "valid")
    places, fits = np.unique(np.quantile(middles, np.linspace(0, 1, 12))), []
    for shape in shapes:
        starts = [
            (knees, linear(np.column_stack([_travel(shape, x, knees), np.ones(len(x))]), y))
            for knees in combinations(places, len(shape))
            if _is_ordered(knees, x)
        ]
        for knees, start in sorted(starts, key=lambda one: one[1].squares)[:3]:
            line = fit(partial(_output, shape, x), y, [*start.values, *knees])
            if _is_ordered(line.values[2:], x):
                fits.append((line.criterion(2 + 3 * len(shape)), shape, line))
    _, shape, line = min(fits, key=itemgetter(0))
    gain = line.estimate(itemgetter(0))
    if gain.value == 0.0 or gain.low <= 0.0 <= gain.high < math.inf:
        raise UserError("no linear region; name another column, or add rows in small steps")
    return line, shape


def _output(shape: Sequence[int], x: Array, unknowns: Array) -> Array:
    gain, offset, *knees = unknowns
    return np.asarray(gain * _travel(shape, x, knees) + offset)


def _travel(shape: Sequence[int], x: Array, knees: Sequence[float]) -> Array:
    """g(x), shape (n,)."""
    there = dict(zip(shape, knees))
    travel = np.clip(x, there.get(0, -np.inf), there.get(3, np.inf))
    return np.asarray(travel - np.clip(x, there.get(1, 0.0), there.get(2, 0.0)))


def _is_ordered(knees: Sequence[float] | Array, x: Array) -> bool:
    """Whether knees ascend, with three rows or more on each piece between them."""
    rows = np.histogram(x, np.concatenate([[-np.inf], np.sort(knees), [np.inf]]))[0]
    return not len(knees) or bool(np.all(np.diff(knees) > 0.0) and np.all(rows >= 3))
