"""Output-error fit of one structure to all measurements at once, with its uncertainty.

Maximum likelihood for noise that is white and normal: each record and each frequency
response has a noise level of its own, estimated with the coefficients.  Where the residuals
of a record are not white, the covariance of the coefficients accounts for it.

Sources: Ljung, System Identification, 2nd ed., secs. 7.4, 9.4 and 9.5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from servo_models.analysis.statistics import autocovariance, scatter, whiteness
from servo_models.core.types import Array
from servo_models.identification.transfer.functions import Structure, TransferFunction
from servo_models.identification.transfer.measurements import Measurements, Record, band

Fit = tuple[TransferFunction, Array]
"""A function and the covariance of its coefficients, SI, shape (size, size)."""


def fit(
    structure: Structure,
    measurements: Measurements,
    undelayed: TransferFunction | None = None,
) -> Fit | None:
    """Return the best fit over all starts, None where none is finite.

    Every measurement has rows to be fitted.  A delay is at most one over the lowest frequency that
    the data speak of; the search for one begins with the best function without it, ``undelayed``.
    """
    problem = _Problem(structure, measurements)
    starts = _starts(structure, measurements, undelayed)
    if not starts:
        return None
    scouted = [problem.descend(start.coefficients, evaluations=25) for start in starts]
    counts = np.array([np.sum(data.fitted) for data in measurements])
    x = min(scouted, key=lambda x: float(counts @ np.log(problem.levels(x))))  # the likeliest
    for _ in range(6):  # coefficients given noise levels, then noise levels given coefficients
        x = problem.descend(x, evaluations=60)
        before, problem.noise = problem.noise, problem.levels(x)
        if len(measurements) == 1 or np.all(np.abs(problem.noise / before - 1.0) < 0.01):
            break
    function = structure.function(x)
    return (function, problem.covariance(x)) if _is_finite(function, measurements) else None


class _Problem:
    """Residuals and slopes of one structure as functions of its coefficients."""

    def __init__(self, structure: Structure, measurements: Measurements) -> None:
        self.structure, self.measurements = structure, measurements
        self.noise = np.array([data.noise_guess for data in measurements])
        self._last: tuple[bytes, list[tuple[Array, Array]]] = b"", []

    def parts(self, x: Array) -> list[tuple[Array, Array]]:
        """Errors and slopes of each piece of measurements, over the rows to be fitted."""
        if self._last[0] != x.tobytes():
            with np.errstate(all="ignore"):
                function = self.structure.function(x)
                both = [(data.errors(function), data.fitted) for data in self.measurements]
            self._last = x.tobytes(), [(e[used], j[used, : len(x)]) for (e, j), used in both]
        return self._last[1]

    def levels(self, x: Array) -> Array:
        """Noise levels, each freed from its share of the fitted coefficients."""
        errors = [e for e, _ in self.parts(x)]
        free = 1.0 - len(x) / sum(map(len, errors))
        sizes = np.array([max(float(np.std(e)), 1e-300) for e in errors])
        return np.asarray(sizes / np.sqrt(free))

    def descend(self, x: Array, evaluations: int) -> Array:
        """Least squares from ``x``, whose response is finite."""
        from scipy.optimize import least_squares

        def weighted(k: int) -> Callable[[Array], Array]:
            """Errors, or slopes, over the noise."""
            return lambda x: np.concatenate([p[k] / s for p, s in zip(self.parts(x), self.noise)])

        low, high = np.full((2, len(x)), [[-np.inf], [np.inf]])
        if self.structure.delay:
            low[-1], high[-1] = 0.0, 1.0 / band(self.measurements)[0]
            x = np.append(x[:-1], np.clip(x[-1], 1e-9 * high[-1], 0.999 * high[-1]))
        # Sizes of coefficients differ by powers of ten, so the squares alone say when to end.
        options = {"x_scale": "jac", "ftol": 1e-8, "xtol": None, "gtol": None}
        options |= {"bounds": (low, high), "max_nfev": evaluations}
        with np.errstate(all="ignore"):  # a step too far may be unstable, and is taken back
            return np.asarray(least_squares(weighted(0), x, weighted(1), **options).x)

    def covariance(self, x: Array) -> Array:
        """Residuals that are not white count with their covariance."""
        information, spread = np.zeros((2, len(x), len(x)))
        for data, (error, slopes), level in zip(self.measurements, self.parts(x), self.noise):
            weighted, relative = slopes / level, error / level
            information += weighted.T @ weighted
            if isinstance(data, Record) and whiteness(relative) < 0.01:
                spread += scatter(weighted, autocovariance(relative))
            else:
                spread += weighted.T @ weighted
        units = np.sqrt(np.outer(np.diag(information), np.diag(information)))
        inverse = np.linalg.pinv(information / units, hermitian=True) / units
        return np.asarray(inverse @ spread @ inverse)


def _starts(
    structure: Structure, measurements: Measurements, undelayed: TransferFunction | None
) -> list[TransferFunction]:
    """Return functions to start from: equal poles anywhere in the band, and the best function
    without a delay, with any delay."""
    (low, high), starts = band(measurements), list[TransferFunction]()
    for rate in np.geomspace(low, high, 6):
        bottom, top = np.poly([-rate] * structure.poles), np.zeros(structure.zeros + 1)
        delay = 0.5 / rate if structure.delay else 0.0
        with np.errstate(all="ignore"):
            lag = TransferFunction.of(bottom[-1:], bottom, delay)
            model, measured = measurements[0].moved(lag)
            top[-1] = bottom[-1] * np.vdot(model, measured).real / np.vdot(model, model).real
        starts.append(TransferFunction.of(top, bottom, delay))
    if structure.delay and not undelayed:
        fitted = fit(replace(structure, delay=False), measurements)
        undelayed = fitted[0] if fitted else None
    if structure.delay and undelayed:
        delays = (0.7 ** np.arange(1, 15) / low).tolist()
        starts += [replace(undelayed, delay=delay) for delay in delays]
    return [f for f in starts if any(f.numerator) and _is_finite(f, measurements)]


def _is_finite(function: TransferFunction, measurements: Measurements) -> bool:
    """Whether it can be evaluated: superfluous poles may run away to any speed."""
    with np.errstate(all="ignore"):
        errors = [data.errors(function)[0] for data in measurements]
    return all(np.all(np.isfinite(each)) for each in errors)
