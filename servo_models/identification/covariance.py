"""Covariance of estimates whose errors are coloured.

The white-noise covariance would be far too small: here it is J+ R J+', with the covariance
R of the errors from an autoregressive model of each record's residuals.
Sources: Ljung, System Identification, 2nd ed., sec. 9.3; Brockwell, Davis, Introduction to
Time Series and Forecasting, sec. 5.1 (Yule-Walker, Levinson and Durbin).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servo_models.identification.problem import Problem

Array = NDArray[np.float64]

ORDERS = 30
"""Highest order of the autoregressive model of the errors."""
PREDICTED = 1e-10
"""Share of their variance down to which errors are predicted; the rest is rounding."""


def covariance(problem: Problem, jacobian: Array, residuals: Array) -> Array:
    """Covariance of the estimates in scales, shape (p, p).

    Priors are scores of their own with the variance that they claim.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14)
    count = problem.samples
    prior = jacobian[count:]
    middle = prior.T @ prior
    start = 0
    for log in problem.logs:
        kept = int(log.fitted.sum())
        if kept == 0:
            continue
        for _ in log.outputs:
            part = slice(start, start + kept)
            middle = middle + _scatter(jacobian[part], residuals[part])
            start += kept
    freedom = count / max(count - jacobian.shape[1], 1)
    return np.asarray(freedom * inverse @ middle @ inverse)


def _scatter(slopes: Array, errors: Array) -> Array:
    """J' R J for the slopes of one record and the covariance R of its errors, shape (p, p)."""
    covariance = _autocovariance(errors)
    n = len(slopes)
    kernel = np.concatenate([covariance[:0:-1], covariance])
    size = 2 ** int(np.ceil(np.log2(n + len(kernel))))
    spectrum = np.fft.rfft(kernel, size)[:, None] * np.fft.rfft(slopes, size, axis=0)
    spread_out = np.fft.irfft(spectrum, size, axis=0)
    first = len(covariance) - 1
    return np.asarray(slopes.T @ spread_out[first : first + n])


def _autocovariance(errors: Array) -> Array:
    """Autocovariance of an autoregressive model of the errors, until it has died away.

    Yule-Walker equations by Levinson and Durbin, order by Akaike's criterion.
    """
    n = len(errors)
    highest = min(ORDERS, n // 10)
    known = np.array([errors[k:] @ errors[: n - k] for k in range(highest + 1)]) / n
    if known[0] <= 0.0:
        return known[:1]
    weights, variance = np.empty(0), known[0]
    best = (n * np.log(variance), weights)
    for order in range(1, highest + 1):
        reflection = (known[order] - weights @ known[order - 1 : 0 : -1]) / variance
        weights = np.append(weights - reflection * weights[::-1], reflection)
        variance *= 1.0 - reflection**2
        if variance < PREDICTED * known[0]:
            break
        best = min(best, (n * np.log(variance) + 2.0 * order, weights), key=lambda it: it[0])
    return _extended(known[: len(best[1]) + 1], best[1], n)


def _extended(known: Array, weights: Array, n: int) -> Array:
    """Continue an autocovariance by its autoregression until it is below a thousandth."""
    if not len(weights):
        return known
    values = known.tolist()
    backward = weights[::-1]
    while len(values) < n and np.abs(values[-len(weights) :]).max() > 1e-3 * values[0]:
        values.append(float(backward @ values[-len(weights) :]))
    return np.array(values)


def autocorrelation(errors: Array) -> Array:
    """Return the correlation of errors with themselves, at lags of 0 to a fifth of their length.

    Empty for errors that do not move.
    """
    n = len(errors)
    centred = errors - errors.mean()
    size = 2 ** int(np.ceil(np.log2(2 * n)))
    spectrum = np.fft.rfft(centred, size)
    correlation = np.fft.irfft(spectrum * spectrum.conj(), size)[: n // 5 + 1]
    return correlation / correlation[0] if correlation[0] > 0.0 else correlation[:0]


def memory(errors: Array) -> int:
    """Return the first lag at which the errors' correlation is no longer significant."""
    correlation = autocorrelation(errors)
    quiet = np.flatnonzero(correlation < 2.0 / np.sqrt(len(errors)))
    return int(quiet[0]) - 1 if len(quiet) else max(len(correlation) - 1, 0)
