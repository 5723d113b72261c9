"""Static characteristics that are straight between edges: potentiometer and amplifier.

The edges of the amplifier are knees of a continuous curve y = c + K g(x), where g follows x
and stands still below a lower limit, above an upper limit and inside a dead band.  Knees
and gain are fitted together by least squares.  Which of the three flats there are is
decided by an information criterion, in which a knee costs ``KNEE_COST`` ln n, more than an
ordinary unknown, since it is searched for.
Sources: Seber, Wild, Nonlinear Regression, sec. 9.3 (joined lines); Yao, Statistics and
Probability Letters 6 (1988) 181 (number of breaks).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    Estimate,
    LeastSquares,
    at_optimum,
    is_bent,
    is_correlated,
    least_squares,
    rounding,
)

KNEE_COST = 3.0
KNOTS = 12
"""Places at which knees are looked for first."""
STARTS = 3
LEAST_ROWS = 3
"""Rows that a flat, and a piece of the line, needs to be believed."""


@dataclass(frozen=True)
class Line:
    """A straight characteristic y = gain (x - zero), with the flats that the table shows.

    Attributes:
        gain: in units of y per unit of x.
        zero: x at which the line meets y = 0; the middle of a dead band.
        lower, upper: x below and above which y stands still, None if it never does.
        dead: x from and to which y stands still in between, None if it never does.
        bent: the residuals are no chance, so that this shape says too little.
    """

    gain: Estimate
    zero: Estimate
    lower: Estimate | None = None
    upper: Estimate | None = None
    dead: tuple[Estimate, Estimate] | None = None
    bent: bool = False


def straight_line(x: Array, y: Array) -> Line:
    """Fit a straight line to a table, both columns of shape (n,) in any units.

    Two rows give gain and zero, with infinite standard errors.
    """
    fit = least_squares(np.column_stack([np.ones(len(x)), x]), y)
    return Line(fit.estimate(1), _zero(fit), bent=_is_bent(x, fit))


def line_with_flats(x: Array, y: Array) -> Line:
    """Fit a line that may stand still at its ends and in a dead band; see ``Line``.

    Raises:
        UserError: no rows on a line: all of the table is flat, or one jump.
    """
    fits = [(shape, _fitted(shape, x, y)) for shape in SHAPES]
    known = [(_criterion(shape, fit, y), shape, fit) for shape, fit in fits if fit]
    _, shape, fit = min(known, key=lambda item: item[0])
    gain = fit.estimate(1)
    if not (gain.low > 0.0 or gain.high < 0.0 or fit.freedom <= 0):
        raise UserError("no linear region; add rows between the edges, in small steps")
    knees = iter([fit.estimate(2 + k) for k in range(shape.count)])
    return Line(
        gain=gain,
        lower=next(knees) if shape.lower else None,
        dead=(next(knees), next(knees)) if shape.dead else None,
        upper=next(knees) if shape.upper else None,
        zero=_middle(fit, shape) if shape.dead else _zero(fit),
        bent=_is_bent(x, fit),
    )


@dataclass(frozen=True)
class Shape:
    """Which flats a characteristic has; its knees go from left to right."""

    lower: bool
    dead: bool
    upper: bool

    @property
    def count(self) -> int:
        """Number of knees."""
        return self.lower + 2 * self.dead + self.upper

    def ends(self, knees: Array) -> tuple[Array, Array]:
        """Limits of x, shape (..., 2), and ends of the dead band, for knees (..., count)."""
        rest = (*knees.shape[:-1], 1)
        low = knees[..., :1] if self.lower else np.full(rest, -np.inf)
        high = knees[..., -1:] if self.upper else np.full(rest, np.inf)
        first = int(self.lower)
        dead = knees[..., first : first + 2] if self.dead else np.zeros((*knees.shape[:-1], 2))
        return np.concatenate([low, high], axis=-1), dead

    def travel(self, knees: Array, x: Array) -> Array:
        """g(x), shape (..., n), for knees of shape (..., count) and x of shape (n,)."""
        limits, dead = self.ends(knees)
        inside = np.clip(x, limits[..., :1], limits[..., 1:])
        return np.asarray(inside - np.clip(x, dead[..., :1], dead[..., 1:]))

    def slopes(self, unknowns: Array, x: Array) -> Array:
        """Derivatives of y by c, K and the knees, shape (n, 2 + count)."""
        gain, knees = unknowns[1], unknowns[2:]
        (low, high), dead = self.ends(knees)
        columns = [np.ones(len(x)), self.travel(knees, x)]
        columns += [gain * (x < low)] if self.lower else []
        columns += [-gain * (x < dead[0]), -gain * (x > dead[1])] if self.dead else []
        columns += [gain * (x > high)] if self.upper else []
        return np.column_stack(columns)

    def enough(self, knees: Array, x: Array) -> bool:
        """Whether knees are in order, with rows enough on each piece between them."""
        rows = np.histogram(x, np.concatenate([[-np.inf], np.sort(knees), [np.inf]]))[0]
        return self.count == 0 or bool(np.all(np.diff(knees) > 0.0) and np.all(rows >= LEAST_ROWS))


SHAPES = tuple(Shape(*flags) for flags in itertools.product((False, True), repeat=3))


def _fitted(shape: Shape, x: Array, y: Array) -> LeastSquares | None:
    """The fit of a shape, None where the table has too few rows for its pieces."""
    from scipy import optimize

    def slopes(unknowns: Array) -> Array:
        return -shape.slopes(unknowns, x)

    def residuals(unknowns: Array) -> Array:
        return np.asarray(y - unknowns[0] - unknowns[1] * shape.travel(unknowns[2:], x))

    best: Array | None = None
    for start in _starts(shape, x, y):
        found = optimize.least_squares(residuals, start, slopes, x_scale="jac", xtol=1e-12).x
        usable = shape.enough(found[2:], x)
        if usable and (
            best is None or np.sum(residuals(found) ** 2) < np.sum(residuals(best) ** 2)
        ):
            best = found
    return None if best is None else at_optimum(best, -slopes(best), residuals(best), y)


def _starts(shape: Shape, x: Array, y: Array) -> Iterator[Array]:
    """The best few unknowns with knees between rows, by exhaustive search."""
    distinct = np.unique(x)
    places = np.unique(np.quantile(0.5 * (distinct[1:] + distinct[:-1]), np.linspace(0, 1, KNOTS)))
    choices = list(itertools.combinations(places, shape.count))
    if not choices:
        return
    knees = np.array(choices).reshape(len(choices), shape.count)
    travel = shape.travel(knees, x)
    about = travel - travel.mean(axis=1, keepdims=True)
    power = np.maximum(np.sum(about**2, axis=1), np.finfo(float).tiny)
    gain = about @ y / power
    explained = gain**2 * power
    for k in np.argsort(-explained)[:STARTS]:
        if shape.enough(knees[k], x):
            level = y.mean() - gain[k] * travel[k].mean()
            yield np.array([level, gain[k], *knees[k]])


def _criterion(shape: Shape, fit: LeastSquares, y: Array) -> float:
    n = len(y)
    size = (fit.squares + rounding(y)) / n
    return n * math.log(size) + (2.0 + KNEE_COST * shape.count) * math.log(n)


def _is_bent(x: Array, fit: LeastSquares) -> bool:
    order = np.argsort(x, kind="stable")
    return is_bent(x, fit.residuals) or is_correlated(fit.residuals[order])


def _zero(fit: LeastSquares) -> Estimate:
    """Where c + K x = 0."""
    level, gain = fit.values[:2]
    slopes = np.zeros(len(fit.values))
    slopes[:2] = -1.0 / gain, level / gain**2
    return fit.derived(float(-level / gain), slopes)


def _middle(fit: LeastSquares, shape: Shape) -> Estimate:
    """Middle of the dead band."""
    slopes = np.zeros(len(fit.values))
    first = 2 + shape.lower
    slopes[first : first + 2] = 0.5
    return fit.derived(float(slopes @ fit.values), slopes)
