"""Potentiometer and amplifier: static characteristics that are straight between edges.

The edges are knees of a continuous curve y = K (g(x) - zero), where g follows x and stands still
below a lower limit, above an upper limit and inside a dead band.  Knees and gain are fitted
together.  Which of the three flats there are is decided by an information criterion, in which a
knee costs more than an ordinary unknown, since it is searched for.
Sources: Seber, Wild, Nonlinear Regression, sec. 9.3 (joined lines); Yao, Statistics and
Probability Letters 6 (1988) 181 (number of breaks).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from functools import partial
from operator import itemgetter

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    BENT,
    Figure,
    Fit,
    fit,
    is_bent,
    is_correlated,
    rounding,
)

Knees = tuple[int, ...]
"""Which of lower limit, start and end of the dead band, and upper limit there are, ascending."""
SHAPES: tuple[Knees, ...]
SHAPES = ((), (0,), (1, 2), (3,), (0, 1, 2), (0, 3), (1, 2, 3), (0, 1, 2, 3))


def potentiometer(angle: Array, voltage: Array) -> tuple[list[Figure], list[str]]:
    """Return k_FS [V/rad] and where the voltage is 0; and doubts about the table.

    Raises:
        UserError: the voltage does not go with the angle at all.
    """
    line, _ = _best(angle, voltage, SHAPES[:1])
    figures = [
        Figure("gain k_FS", line.estimate(itemgetter(0)), "V/rad", "V/deg", "potentiometer_gain"),
        Figure("angle of 0 V", line.estimate(itemgetter(1)), "rad", "deg"),
    ]
    return figures, [f"{BENT}; see effect sensor_nonlinearity"] * _is_curved(angle, line)


def amplifier(given: Array, output: Array, loaded: bool = False) -> tuple[list[Figure], list[str]]:
    """Return K_AP [1], where the output is 0, and the edges of flats; and doubts about the table.

    Raises:
        UserError: no rows on a line: all of the table is flat, or one jump.
    """
    line, shape = _best(given, output, SHAPES)
    gain, zero = line.estimate(itemgetter(0)), line.estimate(itemgetter(1))
    if gain.low <= 0.0 <= gain.high and math.isfinite(gain.high):
        raise UserError("no linear region; add rows between the edges, in small steps")
    at = {knee: 2 + k for k, knee in enumerate(shape)}
    if 1 in at:  # the middle of the dead band
        zero = line.estimate(lambda v: 0.5 * (v[at[1]] + v[at[2]]))
    names = ("no change below", "dead band from", "dead band to", "no change above")
    figures = [
        Figure(f"gain K_AP{' with load' * loaded}", gain, "1", parameter="amplifier_gain"),
        Figure("input of 0 V", zero, "V"),
        *(Figure(names[knee], line.estimate(itemgetter(k)), "V") for knee, k in at.items()),
    ]
    return figures, [BENT] * _is_curved(given, line)


def _is_curved(x: Array, line: Fit) -> bool:
    """Whether the residuals are no chance."""
    order = np.argsort(x, kind="stable")
    return is_bent(x, line.residuals) or is_correlated(line.residuals[order])


def _best(x: Array, y: Array, shapes: Sequence[Knees]) -> tuple[Fit, Knees]:
    """Gain, zero and knees of the shape with the least criterion, in which a knee costs 3 ln n."""
    n, fits = len(y), list[tuple[float, Knees, Fit]]()
    for shape, start in [(s, start) for s in shapes for start in _starts(s, x, y)]:
        line = fit(partial(_output, shape, x), y, start)
        score = n * math.log((line.squares + rounding(y)) / n) + (2 + 3 * len(shape)) * math.log(n)
        if _is_ordered(line.values[2:], x):
            fits.append((score, shape, line))
    if not fits:
        raise UserError("no slope; name another column, or measure over a range")
    _, shape, line = min(fits, key=itemgetter(0))
    return line, shape


def _output(shape: Knees, x: Array, unknowns: Array) -> Array:
    gain, zero = unknowns[:2]
    return np.asarray(gain * (_travel(shape, x, unknowns[2:]) - zero))


def _travel(shape: Knees, x: Array, knees: Array) -> Array:
    """g(x), shape (..., n), for knees of shape (..., count)."""
    every = np.broadcast_to([-np.inf, 0.0, 0.0, np.inf], (*knees.shape[:-1], 4)).copy()
    every[..., list(shape)] = knees
    low, start, end, high = np.moveaxis(every, -1, 0)[..., None]
    return np.asarray(np.clip(x, low, high) - np.clip(x, start, end))


def _starts(shape: Knees, x: Array, y: Array) -> Iterator[Array]:
    """The best three gains, zeros and knees between rows, by exhaustive search."""
    middles = np.convolve(np.unique(x), [0.5, 0.5], "valid")
    places = np.unique(np.quantile(middles, np.linspace(0, 1, 12)))
    choices = [c for c in itertools.combinations(places, len(shape)) if _is_ordered(np.array(c), x)]
    if not choices:
        return
    knees = np.array(choices).reshape(len(choices), len(shape))
    travel = _travel(shape, x, knees)
    about = travel - travel.mean(axis=1, keepdims=True)
    power = np.maximum(np.sum(about**2, axis=1), np.finfo(float).tiny)
    gain = about @ y / power
    for k in np.argsort(-(gain**2) * power)[:3]:
        if gain[k]:
            yield np.array([gain[k], travel[k].mean() - y.mean() / gain[k], *knees[k]])


def _is_ordered(knees: Array, x: Array) -> bool:
    """Whether knees ascend, with three rows or more on each piece between them."""
    rows = np.histogram(x, np.concatenate([[-np.inf], np.sort(knees), [np.inf]]))[0]
    return not len(knees) or bool(np.all(np.diff(knees) > 0.0) and np.all(rows >= 3))
