"""Least squares on the table of an element, estimates with standard error and 95 % interval, and
the elements whose characteristic is a straight line.

Sources: Seber, Wild, Nonlinear Regression, sec. 2.1.3; Draper, Smith, Applied Regression
Analysis, 3rd ed., chs. 1 and 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from servo_models.analysis.statistics import derivatives
from servo_models.core.types import Array
from servo_models.errors import UserError

FEWEST = 8  # residuals that show a bow or a correlation
BENT = "the rows bend away from a straight line by more than chance"


@dataclass(frozen=True)
class Interval:
    """A number that was estimated, in one unit, with its 95 % interval ``low`` to ``high``; the
    standard error is infinite where there are as many unknowns as rows."""

    value: float
    standard_error: float
    low: float
    high: float

    @classmethod
    def of(cls, value: float, error: float = 0.0, freedom: float = math.inf) -> Interval:
        """The interval is that of Student's t."""
        from scipy.special import stdtrit

        half = float(stdtrit(min(freedom, 1e9), 0.975)) * error
        return cls(value, error, value - half, value + half)

    @classmethod
    def between(cls, low: float, high: float) -> Interval:
        """Of what lies anywhere between two rows, with equal chance."""
        middle, half = 0.5 * (low + high), 0.5 * abs(high - low)
        return cls(middle, half / math.sqrt(3.0), middle - 0.95 * half, middle + 0.95 * half)

    @classmethod
    def sum(cls, *parts: tuple[float, Interval]) -> Interval:
        """Of the weighted sum of independent estimates, given as (weight, estimate)."""
        value = math.fsum(weight * part.value for weight, part in parts)
        return cls.of(value, math.hypot(*(w * part.standard_error for w, part in parts)))

    def scaled(self, by: float) -> Interval:
        """Return the estimate of ``by`` times this quantity."""
        low, high = sorted((by * self.low, by * self.high))
        return Interval(by * self.value, abs(by) * self.standard_error, low, high)

    def contradicts(self, other: Interval) -> bool:
        """Whether both are further apart than three standard errors, and than rounding."""
        gap = Interval.sum((1.0, self), (-1.0, other))
        differ = not math.isclose(self.value, other.value, rel_tol=1e-9)
        return differ and abs(gap.value) > 3.0 * gap.standard_error


@dataclass(frozen=True)
class Figure:
    """A figure of an element in ``unit`` (SI), shown in ``display`` where that is given; ``factor``
    times it is ``parameter`` of the actuator, if it tells one."""

    name: str
    estimate: Interval
    unit: str
    display: str = ""
    parameter: str = ""
    factor: float = 1.0
    element: str = ""
    file: str = ""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit by least squares with equal, independent errors of all rows: the unknowns, shape (p,),
    slopes of the rows by them, shape (n, p), and measured minus fitted, shape (n,), 0 where that is
    nothing but rounding."""

    values: Array
    slopes: Array
    residuals: Array

    @classmethod
    def of(cls, values: Array, slopes: Array, residuals: Array, measured: Array) -> Fit:
        rounded = residuals @ residuals <= 1e-24 * float(measured @ measured)
        return cls(values, slopes, 0.0 * residuals if rounded else residuals)

    @property
    def squares(self) -> float:
        return float(self.residuals @ self.residuals)

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals."""
        return math.sqrt(self.squares / self.freedom) if self.freedom > 0 else math.inf

    @property
    def freedom(self) -> int:
        """Rows less unknowns of which they tell."""
        return len(self.residuals) - int(np.sum(np.any(self.slopes, axis=0)))

    def criterion(self, unknowns: float) -> float:
        """The information criterion of Bayes; an exact fit is the likeliest, however small."""
        n = len(self.residuals)
        return n * math.log(max(self.squares, np.finfo(float).tiny) / n) + unknowns * math.log(n)

    def estimate(self, function: Callable[[Array], float]) -> Interval:
        """Return a smooth function of the unknowns."""
        value = float(function(self.values))
        if self.freedom <= 0:
            return Interval(value, math.inf, -math.inf, math.inf)
        [slope] = derivatives(lambda values: np.array([function(values)]), self.values)
        inverse = np.linalg.pinv(self.slopes.T @ self.slopes, hermitian=True)
        error = self.scatter * math.sqrt(max(float(slope @ inverse @ slope), 0.0))
        return Interval.of(value, error, self.freedom)


def fit(model: Callable[[Array], Array], y: Array, start: Sequence[float] | Array) -> Fit:
    """Fit ``model`` of the unknowns to ``y``, shape (n,), from ``start``, shape (p,)."""
    from scipy.optimize import least_squares

    best = least_squares(lambda v: y - model(v), start, method="lm", x_scale="jac", xtol=1e-12)
    return Fit.of(best.x, best.jac, best.fun, y)


def linear(columns: Array, y: Array) -> Fit:
    """Fit ``columns``, shape (n, p), times the unknowns to ``y``, shape (n,)."""
    values = np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0], dtype=float)
    return Fit.of(values, columns, y - columns @ values, y)


def is_curved(x: Array, residuals: Array) -> bool:
    """Whether the residuals of a line over ``x``, both of shape (n,), show a bow, bend to both
    sides or follow their neighbours."""
    if len(x) < FEWEST or not np.any(residuals):
        return False
    shape, covariance = np.polyfit((x - x.mean()) / np.std(x), residuals, 3, cov=True)
    ordered = residuals[np.argsort(x, kind="stable")]
    follow = float(ordered[1:] @ ordered[:-1]) / float(ordered @ ordered)
    bent = np.abs(shape[:2]) > 4.0 * np.sqrt(np.diag(covariance)[:2])
    return bool(np.any(bent) or follow > 3.0 / math.sqrt(len(x)))


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
