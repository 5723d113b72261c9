"""Output-error fit of one structure to all measurements at once, with its uncertainty.

Maximum likelihood for noise that is white and normal: each record and each frequency
response has a noise level of its own, estimated with the coefficients.  Where the residuals
of a record are not white, the covariance of the coefficients accounts for it.

It starts from linear regressions of the equation error, filtered by the last estimate of the
denominator, with a grid of first filters and of delays.
Sources: Ljung, System Identification, 2nd ed., secs. 7.4, 9.4 and 9.5; Young, Recursive
Estimation and Time-Series Analysis, 2nd ed., ch. 8, for the filtered regressions; on frequency
responses they are those of Sanathanan and Koerner, IEEE Trans. AC 8 (1963).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from servo_models.analysis.statistics import autocovariance, scatter, whiteness
from servo_models.core.types import Array
from servo_models.identification.transfer.functions import Structure, TransferFunction
from servo_models.identification.transfer.measurements import Measurements, Record, band

LEAST_ANGLE = np.pi - np.arccos(0.02)  # of a damped pole
Fit = tuple[TransferFunction, Array]
"""A function and the covariance of its coefficients, SI, shape (size, size)."""


def fit(
    structure: Structure,
    measurements: Measurements,
    smaller: Sequence[TransferFunction] = (),
) -> Fit | None:
    """Return the best fit over all starts, None where none is finite.

    A delay is at most one over the lowest frequency that the data speak of.

    Args:
        structure: to be fitted.
        measurements: each with rows to be fitted.
        smaller: fitted functions of structures that this one contains.
    """
    problem = _Problem(structure, measurements)
    starts = _starts(structure, measurements, smaller)
    if not starts:
        return None
    scouted = [problem.descend(start.coefficients, evaluations=12) for start in starts]
    x = min(scouted, key=problem.unlikelihood)
    for _ in range(6):  # coefficients given noise levels, then noise levels given coefficients
        x = problem.descend(x, evaluations=60)
        before, problem.noise = problem.noise, problem.levels(x)
        if len(measurements) == 1 or np.all(np.abs(problem.noise / before - 1.0) < 0.01):
            break
    function = structure.function(x)
    # Superfluous poles may run away to any speed, at which nothing can be evaluated.
    return (function, problem.covariance(x)) if _ranked([function], measurements) else None


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
                both = [data.errors(function, self.structure.delay) for data in self.measurements]
            rows = [data.fitted for data in self.measurements]
            self._last = x.tobytes(), [(e[used], j[used]) for (e, j), used in zip(both, rows)]
        return self._last[1]

    def levels(self, x: Array) -> Array:
        """Noise levels, each freed from its share of the fitted coefficients."""
        errors = [e for e, _ in self.parts(x)]
        free = 1.0 - len(x) / sum(map(len, errors))
        sizes = np.array([max(float(np.std(e)), 1e-300) for e in errors])
        return np.asarray(sizes / np.sqrt(free))

    def unlikelihood(self, x: Array) -> float:
        """Negative log-likelihood with the noise levels at their best, up to a constant."""
        counts = np.array([len(e) for e, _ in self.parts(x)])
        return float(counts @ np.log(self.levels(x)))

    def descend(self, x: Array, evaluations: int) -> Array:
        """Least squares from ``x``, whose response is finite."""
        from scipy.optimize import least_squares

        def weighted(x: Array, which: int) -> Array:
            return np.concatenate([p[which] / s for p, s in zip(self.parts(x), self.noise)])

        low, high = np.full((2, len(x)), [[-np.inf], [np.inf]])
        if self.structure.delay:
            low[-1], high[-1] = 0.0, 1.0 / band(self.measurements)[0]
            x = np.append(x[:-1], np.clip(x[-1], 1e-9 * high[-1], 0.999 * high[-1]))
        # Sizes of coefficients differ by powers of ten, so the squares alone say when to end.
        options = {"x_scale": "jac", "ftol": 1e-8, "xtol": None, "gtol": None}
        with np.errstate(all="ignore"):  # a step too far may be unstable, and is taken back
            descent = least_squares(
                partial(weighted, which=0),
                x,
                partial(weighted, which=1),
                bounds=(low, high),
                max_nfev=evaluations,
                **options,
            )
        return np.asarray(descent.x)

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
    structure: Structure, measurements: Measurements, smaller: Sequence[TransferFunction]
) -> list[TransferFunction]:
    """Return starting points, the most promising first."""
    low, high = band(measurements)
    undelayed = [_grow(f, replace(structure, delay=False)) for f in smaller if not f.delay]
    ranked = _ranked(undelayed, measurements)
    if not (structure.delay and ranked):
        rates = np.geomspace(low, high, 6)  # of equal poles
        filters = [TransferFunction.of([1.0], np.poly([-r] * structure.poles)) for r in rates]
        ranked = _refined(filters, structure.zeros, measurements)
    if structure.delay and ranked:
        longest = min(_lag(ranked[0]), 1.0 / low)
        moved = [replace(ranked[0], delay=longest * k / 8.0) for k in range(1, 8)]
        ranked = _refined([_settled(f, high) for f in moved], structure.zeros, measurements)
    grown = [_grow(function, structure) for function in smaller]
    return _ranked([*ranked[:2], *grown], measurements)


def _ranked(
    functions: Sequence[TransferFunction], measurements: Measurements
) -> list[TransferFunction]:
    """Those that can be evaluated, the least weighted sum of squares first."""
    costs = []
    for k, function in enumerate(functions):
        with np.errstate(all="ignore"):
            errors = [data.errors(function, False)[0][data.fitted] for data in measurements]
            parts = [np.sum((e / d.noise_guess) ** 2) for e, d in zip(errors, measurements)]
        costs.append((float(np.sum(parts)), k))
    return [functions[k] for cost, k in sorted(costs) if np.isfinite(cost)]


def _refined(
    filters: Sequence[TransferFunction], zeros: int, measurements: Measurements
) -> list[TransferFunction]:
    """The best function that each filter leads to, whose delay stays; the best of all first."""
    best = []
    for start in filters:
        filter_, seen = start, list[TransferFunction]()
        for _ in range(4):
            pieces = [(data, *data.regression(filter_, zeros)) for data in measurements]
            left = np.concatenate([y[d.fitted] / d.noise_guess for d, y, _ in pieces])
            columns = np.concatenate([phi[d.fitted] / d.noise_guess for d, _, phi in pieces])
            size = np.linalg.norm(columns, axis=0)
            if not (np.all(np.isfinite(columns / size)) and np.all(np.isfinite(left))):
                break
            top, bottom = np.split(
                np.linalg.lstsq(columns / size, left, rcond=None)[0] / size, [zeros + 1]
            )
            seen.append(TransferFunction.of(top, [1.0, *bottom], start.delay))
            filter_ = _settled(seen[-1], band(measurements)[1])
        best += _ranked(seen, measurements)[:1]
    return _ranked(best, measurements)


def _settled(function: TransferFunction, high: float) -> TransferFunction:
    """The same with its poles made stable, damped by 2 %, and not much faster than the data."""
    poles = np.roots(function.denominator)
    angle = np.maximum(np.abs(np.angle(-np.abs(poles.real) + 1j * poles.imag)), LEAST_ANGLE)
    size = np.clip(np.abs(poles), 1e-6 * high, 10.0 * high)
    bottom = np.real(np.poly(size * np.exp(1j * np.copysign(angle, poles.imag))))
    return TransferFunction.of(function.numerator, bottom, function.delay)


def _lag(function: TransferFunction) -> float:
    """Delay [s] of slow signals, -G'(0) / G(0); infinite where it is not a positive one."""
    top, bottom = (0.0, *function.numerator), function.denominator
    with np.errstate(all="ignore"):
        lag = float(np.divide(bottom[-2], bottom[-1]) - np.divide(top[-2], top[-1]))
    return lag if np.isfinite(lag) and lag > 0.0 else np.inf


def _grow(function: TransferFunction, structure: Structure) -> TransferFunction:
    """The same function in a larger structure; an added pole is far faster than all before."""
    top, bottom = np.array(function.numerator), np.array(function.denominator)
    for _ in range(structure.poles - function.structure.poles):
        pole = 5.0 * float(np.max(np.abs(np.roots(bottom))))
        bottom, top = np.polymul(bottom, [1.0, pole]), pole * top
    top = np.append(np.zeros(structure.zeros - function.structure.zeros), top)
    fastest = float(np.max(np.abs(np.roots(bottom))))
    delay = function.delay or (1e-3 / fastest if structure.delay else 0.0)
    return TransferFunction.of(top, bottom, delay)
