"""Least squares on a table, and estimates with standard error and 95 % interval.

Sources: Seber, Wild, Nonlinear Regression, secs. 2.1.3 and 9.3 (joined lines); Draper,
Smith, Applied Regression Analysis, 3rd ed., ch. 5.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array

CONFIDENCE = 0.95
EXACT = 1e-24
"""Mean square of residuals, relative to that of the values, below which a fit is exact."""
ROUNDING = 1e-9  # relative difference of two estimates that is nothing but rounding
TIGHT = 1e-12  # relative tolerance of the unknowns of a fit
STEP = 1e-5  # step of a slope, relative to the unknown


@dataclass(frozen=True)
class Estimate:
    """A number that was estimated, in one unit.

    Attributes:
        value: the estimate.
        standard_error: infinite where there are as many unknowns as rows.
        low, high: 95 % interval.
    """

    value: float
    standard_error: float
    low: float
    high: float

    def scaled(self, by: float) -> Estimate:
        """Return the estimate of ``by`` times this quantity."""
        low, high = sorted((by * self.low, by * self.high))
        return Estimate(by * self.value, abs(by) * self.standard_error, low, high)

    def contradicts(self, other: Estimate, errors: float = 3.0) -> bool:
        """Whether both are further apart than so many standard errors, and than rounding."""
        gap = combined((1.0, self), (-1.0, other))
        differ = not math.isclose(self.value, other.value, rel_tol=ROUNDING)
        return differ and abs(gap.value) > errors * gap.standard_error


def exactly(value: float) -> Estimate:
    """Return a number that is known, such as a count of teeth."""
    return Estimate(value, 0.0, value, value)


def between(one: float, other: float) -> Estimate:
    """Return an estimate of what lies anywhere between two rows, with equal chance."""
    middle, width = 0.5 * (one + other), abs(other - one)
    half = 0.5 * CONFIDENCE * width
    return Estimate(middle, width / math.sqrt(12.0), middle - half, middle + half)


def combined(*parts: tuple[float, Estimate]) -> Estimate:
    """Return the weighted sum of independent estimates, given as (weight, estimate)."""
    value = sum(weight * part.value for weight, part in parts)
    error = math.hypot(*(weight * part.standard_error for weight, part in parts))
    return _with_interval(value, error, math.inf)


def _with_interval(value: float, error: float, freedom: float) -> Estimate:
    """The interval is that of Student's t."""
    from scipy.special import stdtrit

    half = float(stdtrit(min(freedom, 1e9), 0.5 + 0.5 * CONFIDENCE)) * error
    return Estimate(value, error, value - half, value + half)


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit by least squares with equal, independent errors of all rows.

    Attributes:
        values: the unknowns, shape (p,).
        covariance: of them, shape (p, p); it means nothing without a row to spare.
        residuals: measured minus fitted, shape (n,).
    """

    values: Array
    covariance: Array
    residuals: Array

    @property
    def freedom(self) -> int:
        """Rows minus unknowns."""
        return len(self.residuals) - len(self.values)

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals, in the unit of the fitted quantity."""
        return math.sqrt(self.squares / self.freedom) if self.freedom > 0 else math.inf

    def estimate(self, quantity: int | Callable[[Array], float]) -> Estimate:
        """Return one of the unknowns, by position, or a smooth function of them."""
        function = quantity if callable(quantity) else (lambda values: float(values[quantity]))
        value = float(function(self.values))
        if self.freedom <= 0:
            return Estimate(value, math.inf, -math.inf, math.inf)
        slope = _slopes(function, self.values)
        error = math.sqrt(max(float(slope @ self.covariance @ slope), 0.0))
        return _with_interval(value, error, self.freedom)


def fit(
    model: Callable[..., Array],
    x: Array,
    y: Array,
    start: Sequence[float] | Array,
) -> Fit:
    """Fit ``model(x, *unknowns)`` to ``y``, shape (n,), from ``start``, shape (p,).

    Residuals that are nothing but rounding count as 0.
    """
    from scipy.optimize import least_squares

    best = least_squares(
        lambda unknowns: model(x, *unknowns) - y,
        start,
        method="lm",
        x_scale="jac",
        xtol=TIGHT,
    )
    residuals = -best.fun if best.fun @ best.fun > rounding(y) else np.zeros(len(y))
    variance = float(residuals @ residuals) / max(len(y) - len(best.x), 1)
    slopes = _slopes(lambda unknowns: model(x, *unknowns), best.x)
    covariance = variance * np.asarray(np.linalg.pinv(slopes.T @ slopes), dtype=float)
    return Fit(best.x, covariance, residuals)


def _slopes(function: Callable[[Array], Array | float], values: Array) -> Array:
    """Derivatives by central differences, by ``values`` along the last axis."""
    columns = []
    for k, size in enumerate(np.abs(values)):
        step = np.zeros(len(values))
        step[k] = STEP * (size or 1.0)
        rise = np.asarray(function(values + step)) - function(values - step)
        columns.append(rise / (2.0 * step[k]))
    return np.stack(columns, axis=-1)


def rounding(measured: Array) -> float:
    """Sum of squares of residuals that are nothing but rounding."""
    return EXACT * float(measured @ measured)


BENT = 4.0  # curvature in standard errors from which a line counts as bent
CORRELATED = 3.0
"""Correlation of neighbours from which residuals count as no chance, over 1 / sqrt(n)."""
FEWEST = 8  # residuals that either judgement needs


def is_bent(x: Array, residuals: Array) -> bool:
    """Whether the residuals of a straight line in ``x``, both of shape (n,), show a bow."""
    if len(x) < FEWEST:
        return False
    bow, covariance = np.polyfit(x - x.mean(), residuals, 2, cov=True)
    return bool(abs(bow[0]) > BENT * math.sqrt(covariance[0, 0]))


def is_correlated(residuals: Array) -> bool:
    """Whether residuals in the order of the rows, shape (n,), follow their neighbours."""
    power = float(residuals @ residuals)
    if len(residuals) < FEWEST or power == 0.0:
        return False
    return float(residuals[1:] @ residuals[:-1]) > CORRELATED / math.sqrt(len(residuals)) * power
