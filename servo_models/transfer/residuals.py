"""Tests of residuals: are they noise, and do they still depend on the input?

Source: Ljung, System Identification, 2nd ed., sec. 16.6; Ljung and Box, Biometrika 65 (1978).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAGS = 25


def correlations(one: Array, other: Array, lags: int) -> Array:
    """Return sum(one[t] other[t - k]) / n for k = 0 ... lags, shape (lags + 1,)."""
    n = len(one)
    return np.array([float(one[k:] @ other[: n - k]) / n for k in range(min(lags, n - 1) + 1)])


def whiteness(residuals: Array) -> float:
    """Return the probability of such autocorrelations if the residuals are white (Ljung-Box)."""
    from scipy.stats import chi2

    n = len(residuals)
    r = correlations(residuals, residuals, LAGS)
    if r[0] == 0.0:
        return 1.0
    lags = np.arange(1, len(r))
    statistic = n * (n + 2.0) * float(np.sum((r[1:] / r[0]) ** 2 / (n - lags)))
    return float(chi2.sf(statistic, len(lags)))


def dependence(residuals: Array, given: Array) -> float:
    """Return the probability of such correlations with past inputs if there is none.

    The largest of them over lags 0 to 25 against its asymptotic spread, Bonferroni.
    """
    from scipy.stats import norm

    u = given - np.mean(given)
    both = correlations(residuals, u, LAGS)
    own, drive = autocovariance(residuals), correlations(u, u, len(residuals) // 4)
    k = min(len(own), len(drive))
    variance = own[0] * drive[0] + 2.0 * float(own[1:k] @ drive[1:k])
    if variance <= 0.0:
        return 1.0
    largest = float(np.max(np.abs(both))) * np.sqrt(len(residuals) / variance)
    return float(min(1.0, 2.0 * len(both) * norm.sf(largest)))


def autocovariance(residuals: Array) -> Array:
    """Return the autocovariance by lag up to where it has died out, tapered (Bartlett)."""
    n = len(residuals)
    r = correlations(residuals, residuals, min(n // 4, 400))
    quiet = np.abs(r) < 2.0 * r[0] / np.sqrt(n)
    runs = np.flatnonzero(np.convolve(quiet, np.ones(5), mode="valid") == 5.0)
    count = max(int(runs[0]), 1) if len(runs) else len(r)
    return np.asarray(r[:count] * (1.0 - np.arange(count) / (2.0 * count)))


def inflation(residuals: Array) -> float:
    """Return by how much correlation shrinks the number of independent residuals, at least 1."""
    r = autocovariance(residuals)
    return max(1.0, float(1.0 + 2.0 * np.sum(r[1:]) / r[0])) if r[0] > 0.0 else 1.0
