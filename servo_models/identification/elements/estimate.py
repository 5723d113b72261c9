"""Estimates with standard error and 95 % interval, from least squares or from two rows.

Sources: Seber, Wild, Nonlinear Regression, secs. 2.1.3 and 9.3 (joined lines); Draper,
Smith, Applied Regression Analysis, 3rd ed., ch. 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from servo_models.core.types import Array

CONFIDENCE = 0.95
EXACT = 1e-24
"""Mean square of residuals, relative to that of the values, below which a fit is exact."""


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
    half = _quantile(math.inf) * error
    return Estimate(value, error, value - half, value + half)


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """A fit by least squares with equal, independent errors of all rows.

    Attributes:
        values: the unknowns, shape (p,).
        covariance: of them, shape (p, p); it means nothing without a row to spare.
        residuals: measured minus fitted, shape (n,).
        freedom: rows minus unknowns.
    """

    values: Array
    covariance: Array
    residuals: Array
    freedom: int

    @property
    def squares(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def scatter(self) -> float:
        """Standard deviation of the residuals, in the unit of the fitted quantity."""
        return math.sqrt(self.squares / self.freedom) if self.freedom > 0 else math.inf

    def estimate(self, unknown: int) -> Estimate:
        """Return one of the unknowns."""
        return self.derived(float(self.values[unknown]), np.eye(len(self.values))[unknown])

    def derived(self, value: float, gradient: ArrayLike) -> Estimate:
        """Return a function of the unknowns by its value and its gradient, shape (p,)."""
        slope = np.asarray(gradient, dtype=float)
        if self.freedom <= 0:
            return Estimate(value, math.inf, -math.inf, math.inf)
        error = math.sqrt(max(float(slope @ self.covariance @ slope), 0.0))
        half = _quantile(self.freedom) * error
        return Estimate(value, error, value - half, value + half)


def least_squares(slopes: Array, measured: Array) -> LeastSquares:
    """Fit ``measured``, shape (n,), by a sum of the columns of ``slopes``, shape (n, p)."""
    values, *_ = np.linalg.lstsq(slopes, measured, rcond=None)
    return at_optimum(np.asarray(values), slopes, measured - slopes @ values, measured)


def at_optimum(values: Array, slopes: Array, residuals: Array, measured: Array) -> LeastSquares:
    """Return the fit with these unknowns, by the slopes of the model there.

    Residuals that are nothing but rounding count as 0.
    """
    n, p = slopes.shape
    if residuals @ residuals <= rounding(measured):
        residuals = np.zeros(n)
    inverse = np.asarray(np.linalg.pinv(slopes.T @ slopes), dtype=float)
    variance = float(residuals @ residuals) / max(n - p, 1)
    return LeastSquares(values, variance * inverse, residuals, n - p)


def rounding(measured: Array) -> float:
    """Sum of squares of residuals that are nothing but rounding."""
    return EXACT * float(measured @ measured)


BENT = 4.0
"""Curvature in standard errors from which a line counts as bent."""
CORRELATED = 3.0
"""Correlation of neighbours from which residuals count as no chance, over 1 / sqrt(n)."""
FEWEST = 8
"""Residuals that either judgement needs."""


def is_bent(x: Array, residuals: Array) -> bool:
    """Whether the residuals of a straight line in ``x``, both of shape (n,), show a bow."""
    if len(x) < FEWEST:
        return False
    bow = np.column_stack([np.ones(len(x)), x - x.mean(), (x - x.mean()) ** 2])
    curvature = least_squares(bow, residuals).estimate(2)
    return abs(curvature.value) > BENT * curvature.standard_error


def is_correlated(residuals: Array) -> bool:
    """Whether residuals in the order of the rows, shape (n,), follow their neighbours."""
    power = float(residuals @ residuals)
    if len(residuals) < FEWEST or power == 0.0:
        return False
    return float(residuals[1:] @ residuals[:-1]) > CORRELATED / math.sqrt(len(residuals)) * power


def _quantile(freedom: float) -> float:
    """Half width of the 95 % interval in standard errors (Student's t)."""
    from scipy.special import stdtrit

    return float(stdtrit(min(freedom, 1e9), 0.5 + 0.5 * CONFIDENCE))
