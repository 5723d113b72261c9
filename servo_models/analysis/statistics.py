"""Statistics of errors: whiteness, correlation time, and dependence on the input.

Source: Ljung, System Identification, 2nd ed., sec. 16.6; Ljung and Box, Biometrika 65 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from servo_models.core.types import Array, Mask

LAGS = 25  # lags of the tests of residuals
ORDERS = 20  # highest order of an autoregression
LONGEST = 2000  # lags of an autocovariance at most
PREDICTED = 1e-8
"""Fraction of the variance that the past leaves unpredicted, below which it is rounding: higher
orders may be unstable."""
FAINT = 1e-3  # autocovariance over the variance below which it has died out


def rms(values: Array) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(values**2)))


def correlations(values: Array, other: Array, lags: int) -> Array:
    """Return sum(values[t] other[t - k]) / n for k = 0 ... lags, shape (lags + 1,)."""
    n = len(values)
    return np.array([float(values[k:] @ other[: n - k]) / n for k in range(min(lags, n - 1) + 1)])


def _pairs(residuals: Array, seen: Mask) -> tuple[Array, Array]:
    """Autocorrelations of seen residuals, and the number of pairs in each, by lag."""
    rows = np.flatnonzero(seen)
    span = slice(rows[0], rows[-1] + 1)
    values = np.where(seen, residuals, 0.0)[span]
    share = np.count_nonzero(seen) / len(values)
    there = seen[span].astype(float)
    counts = np.round(correlations(there, there, LAGS) * len(there))
    return correlations(values, values, LAGS) / share, counts


def whiteness(residuals: Array, seen: Mask | None = None) -> float:
    """Return the probability of such autocorrelations if the residuals are white (Ljung-Box).

    Samples that are not ``seen``, shape (n,), are unknown; they still count in the lags.
    """
    from scipy.special import chdtrc

    r, counts = _pairs(residuals, np.ones(len(residuals), dtype=bool) if seen is None else seen)
    if r[0] == 0.0:
        return 1.0
    n, met = counts[0], np.flatnonzero(counts[1:]) + 1
    statistic = n * (n + 2.0) * float(np.sum((r[met] / r[0]) ** 2 / counts[met]))
    return float(chdtrc(len(met), statistic))


def dependence(residuals: Array, given: Array) -> float:
    """Return the probability of such correlations with past inputs if there is none.

    The largest one over lags 0 to 25 is held against its asymptotic spread (Bonferroni).
    """
    both, deviation = cross_correlation(residuals, given, LAGS)
    if deviation == 0.0:
        return 1.0
    largest = float(np.max(np.abs(both))) / deviation
    return float(min(1.0, len(both) * math.erfc(largest / math.sqrt(2.0))))


def cross_correlation(residuals: Array, given: Array, lags: int) -> tuple[Array, float]:
    """Return the correlation of residuals with inputs 0 ... lags samples before, shape (lags + 1,),
    and its standard deviation under independence, 0 where one of the two does not move."""
    u, n = given - np.mean(given), len(residuals)
    covariance = autocovariance(residuals)
    drive = correlations(u, u, min(len(covariance) - 1, n // 4))
    k = len(drive)
    variance = covariance[0] * drive[0] + 2.0 * float(covariance[1:k] @ drive[1:k])
    if variance <= 0.0:
        return np.zeros(min(lags, n - 1) + 1), 0.0
    size = n * math.sqrt(covariance[0] * drive[0])
    return _sums(residuals, u)[: lags + 1] / size, math.sqrt(n * variance) / size


def autocovariance(residuals: Array) -> Array:
    """Return the autocovariance by lag up to where it has died out.

    It is that of an autoregression (up to order 20, by the BIC) with the residuals' first lags:
    unlike sums of measured lags it does not cut off long tails.
    Source: Brockwell, Davis, Time Series: Theory and Methods, 2nd ed., secs. 5.2 (Durbin and
    Levinson), 8.1 and 9.3.
    """
    n = len(residuals)
    r = correlations(residuals, residuals, ORDERS)
    if r[0] == 0.0:
        return r[:1]
    phi, left = np.zeros(0), 1.0
    best, least = phi, 0.0
    for order in range(1, min(ORDERS, n // 10) + 1):
        partial = (r[order] - float(phi @ r[order - 1 : 0 : -1])) / (left * r[0])
        phi = np.append(phi - partial * phi[::-1], partial)
        left *= 1.0 - partial**2
        if left < PREDICTED:
            break
        criterion = n * np.log(left) + order * np.log(n)
        if criterion < least:
            best, least = phi, criterion
    if not len(best):
        return r[:1]
    every = np.concatenate([r[:1], recursion(best, r[1 : len(best) + 1], LONGEST)])
    alive = np.flatnonzero(np.abs(every) > FAINT * r[0])
    return every[: min(int(alive[-1]) + 1, n)]


def recursion(weights: Array, first: Array, count: int) -> Array:
    """Return y[k] = sum of weights[j] y[k - 1 - j], shape (count,), as ``first`` begins it.

    Both have the shape (order,).  A matrix leads from so many values to as many that follow, and
    its square twice as far, so that all are known after few products.

    Example:
        >>> recursion(np.array([1.0, 1.0]), np.array([1.0, 1.0]), 8)
        array([ 1.,  1.,  2.,  3.,  5.,  8., 13., 21.])
    """
    order = len(weights)
    onward = np.eye(order, k=1)
    onward[-1] = weights[::-1]
    onward = np.linalg.matrix_power(onward, order)
    known = first[:, None]
    while known.size < count:
        known = np.hstack([known, onward @ known])
        onward = onward @ onward
    return known.T.ravel()[:count]


def stretch_powers(values: Array, window: Array) -> Array:
    """Return the power of each windowed stretch by frequency; stretches overlap by half.

    Shape (stretches, frequencies).  In a window of ``hann`` white noise of variance 1 has power 1.
    Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967).
    """
    length = len(window)
    starts = np.arange(0, len(values) - length + 1, max(length // 2, 1))
    stretches = values[starts[:, None] + np.arange(length)] * window
    return np.asarray(np.abs(np.fft.rfft(stretches, axis=1)) ** 2)


def hann(length: int) -> Array:
    """Return a window of so many samples without zeros at its ends, whose squares sum to 1."""
    window: Array = np.hanning(length + 2)[1:-1]
    return window / math.sqrt(window @ window)


def scatter(slopes: Array, covariance: Array) -> Array:
    """Return J' R J for slopes J, shape (n, p), and the R of an autocovariance, shape (p, p)."""
    n = len(slopes)
    kernel = np.concatenate([covariance[:0:-1], covariance])
    size = 2 ** int(np.ceil(np.log2(n + len(kernel))))
    spectrum = np.fft.rfft(kernel, size)[:, None] * np.fft.rfft(slopes, size, axis=0)
    spread_out = np.fft.irfft(spectrum, size, axis=0)
    first = len(covariance) - 1
    return np.asarray(slopes.T @ spread_out[first : first + n])


def inflation(residuals: Array) -> float:
    """Return the factor by which correlation reduces the number of independent residuals, >= 1."""
    r = autocovariance(residuals)
    return max(1.0, float(1.0 + 2.0 * np.sum(r[1:]) / r[0])) if r[0] > 0.0 else 1.0


def autocorrelation(errors: Array) -> Array:
    """Return the correlation of errors with themselves, at lags of 0 to a fifth of their length.

    Empty for errors that do not move.
    """
    centred = errors - errors.mean()
    correlation = _sums(centred, centred)[: len(errors) // 5 + 1]
    return correlation / correlation[0] if correlation[0] > 0.0 else correlation[:0]


def _sums(values: Array, other: Array) -> Array:
    """Return sum(values[t] other[t - k]) for k = 0 ... n - 1, shape (n,), by FFT."""
    n = len(values)
    size = 2 ** int(np.ceil(np.log2(2 * n)))
    product = np.fft.rfft(values, size) * np.fft.rfft(other, size).conj()
    return np.asarray(np.fft.irfft(product, size)[:n])


def memory(errors: Array) -> int:
    """Return the lag up to which the correlation of errors is significant."""
    correlation = autocorrelation(errors)
    quiet = np.flatnonzero(correlation < 2.0 / np.sqrt(len(errors)))
    return int(quiet[0]) - 1 if len(quiet) else max(len(correlation) - 1, 0)


def derivatives(function: Callable[[Array], Array], at: Array) -> Array:
    """Return derivatives of a smooth vector function by central differences, (outputs, inputs)."""
    columns = []
    for step in np.diag(1e-5 * np.where(at == 0.0, 1.0, np.abs(at))):
        rise = function(at + step) - function(at - step)
        columns.append(rise / (2.0 * np.max(step)))
    return np.column_stack(columns)
