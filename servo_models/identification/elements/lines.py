"""Static characteristics that are straight between edges: potentiometer and amplifier.

The edges of the amplifier are knees of a continuous curve y = K (g(x) - zero), where g follows
x and stands still below a lower limit, above an upper limit and inside a dead band.  Knees
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

from servo_models.actuators.sg90.physics import amplifier
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    Estimate,
    Fit,
    fit,
    is_bent,
    is_correlated,
    rounding,
)

KNEE_COST = 3.0
KNOTS = 12  # places at which knees are looked for first
STARTS = 3
LEAST_ROWS = 3  # rows that a flat, and a piece of the line, needs to be believed
NO_SLOPE = "no slope; name another column, or measure over a range"


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

    Raises:
        UserError: y does not go with x at all.
    """
    line = STRAIGHT.fitted(x, y)
    if line is None:
        raise UserError(NO_SLOPE)
    return Line(line.estimate(0), line.estimate(1), bent=_is_bent(x, line))


def line_with_flats(x: Array, y: Array) -> Line:
    """Fit a line that may stand still at its ends and in a dead band; see ``Line``.

    Raises:
        UserError: no rows on a line: all of the table is flat, or one jump.
    """
    fits = [(shape, shape.fitted(x, y)) for shape in SHAPES]
    known = [(_criterion(shape, best, y), shape, best) for shape, best in fits if best]
    if not known:
        raise UserError(NO_SLOPE)
    _, shape, best = min(known, key=lambda item: item[0])
    gain = best.estimate(0)
    if not (gain.low > 0.0 or gain.high < 0.0 or best.freedom <= 0):
        raise UserError("no linear region; add rows between the edges, in small steps")
    knees = iter([best.estimate(2 + k) for k in range(shape.count)])
    first = 2 + shape.lower
    return Line(
        gain=gain,
        lower=next(knees) if shape.lower else None,
        dead=(next(knees), next(knees)) if shape.dead else None,
        upper=next(knees) if shape.upper else None,
        zero=best.estimate((lambda v: v[first : first + 2].mean()) if shape.dead else 1),
        bent=_is_bent(x, best),
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

    def output(self, x: Array, gain: float, zero: float, *knees: float) -> Array:
        """y at x, shape (n,)."""
        return np.asarray(amplifier(self.travel(x, np.array(knees)) - zero, gain))

    def travel(self, x: Array, knees: Array) -> Array:
        """g(x), shape (..., n), for knees of shape (..., count) and x of shape (n,)."""
        inside, first = x, int(self.lower)
        if self.lower or self.upper:
            low = knees[..., :1] if self.lower else -np.inf
            inside = np.clip(x, low, knees[..., -1:] if self.upper else np.inf)
        if self.dead:
            inside = inside - np.clip(x, knees[..., first, None], knees[..., first + 1, None])
        return np.asarray(inside)

    def fitted(self, x: Array, y: Array) -> Fit | None:
        """Gain, zero and knees, None where the table has too few rows for the pieces."""
        fits = [fit(self.output, x, y, start) for start in self._starts(x, y)]
        usable = [line for line in fits if self._enough(line.values[2:], x)]
        return min(usable, key=lambda line: line.squares, default=None)

    def _starts(self, x: Array, y: Array) -> Iterator[Array]:
        """The best few unknowns with knees between rows, by exhaustive search."""
        middles = np.convolve(np.unique(x), [0.5, 0.5], "valid")
        places = np.unique(np.quantile(middles, np.linspace(0, 1, KNOTS)))
        choices = list(itertools.combinations(places, self.count))
        if not choices:
            return
        knees = np.array(choices).reshape(len(choices), self.count)
        travel = np.broadcast_to(self.travel(x, knees), (len(choices), len(x)))
        about = travel - travel.mean(axis=1, keepdims=True)
        power = np.maximum(np.sum(about**2, axis=1), np.finfo(float).tiny)
        gain = about @ y / power
        for k in np.argsort(-(gain**2) * power)[:STARTS]:
            if gain[k] and self._enough(knees[k], x):
                yield np.array([gain[k], travel[k].mean() - y.mean() / gain[k], *knees[k]])

    def _enough(self, knees: Array, x: Array) -> bool:
        """Whether knees are in order, with rows enough on each piece between them."""
        rows = np.histogram(x, np.concatenate([[-np.inf], np.sort(knees), [np.inf]]))[0]
        return self.count == 0 or bool(np.all(np.diff(knees) > 0.0) and np.all(rows >= LEAST_ROWS))


SHAPES = tuple(Shape(*flags) for flags in itertools.product((False, True), repeat=3))
STRAIGHT = SHAPES[0]


def _criterion(shape: Shape, best: Fit, y: Array) -> float:
    n = len(y)
    size = (best.squares + rounding(y)) / n
    return n * math.log(size) + (2.0 + KNEE_COST * shape.count) * math.log(n)


def _is_bent(x: Array, best: Fit) -> bool:
    order = np.argsort(x, kind="stable")
    return is_bent(x, best.residuals) or is_correlated(best.residuals[order])
