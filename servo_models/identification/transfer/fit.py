"""Output-error fit of one structure to all measurements at once, with its uncertainty.

Maximum likelihood for noise that is white and normal: each record and each frequency
response has a noise level of its own, estimated with the coefficients.  Where the residuals
of a record are not white, the covariance of the coefficients accounts for it.

It starts from the refined instrumental variable method for continuous-time models, with a grid
of filters and of delays: linear regressions, filtered by the last estimate of the denominator,
with the noise-free output of the last model as instrument.
Sources: Ljung, System Identification, 2nd ed., secs. 7.4, 9.4 and 9.5; Young, Recursive
Estimation and Time-Series Analysis, 2nd ed., ch. 8; on frequency responses the same steps are
those of Sanathanan and Koerner, IEEE Trans. AC 8 (1963).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from servo_models.analysis.statistics import autocovariance, scatter, whiteness
from servo_models.core.types import Array
from servo_models.identification.transfer.functions import Structure, TransferFunction
from servo_models.identification.transfer.measurements import Measurements, Point, Record, band

PASSES = 6  # rounds of coefficients given noise levels, then noise levels given coefficients
STEADY = 0.01  # a noise level that moves by less than this part has settled
EVALUATIONS = 60
SCOUTED = 12  # evaluations after which the most promising start goes on alone
ROUNDS = 4
FILTERS = 6
DELAYS = 7
KEPT = 2  # starts that go on to the fit, besides those grown from smaller structures
FASTER = 5.0  # an added pole is this much faster than the fastest before it


@dataclass(frozen=True, eq=False)
class Fit:
    """A transfer function with its uncertainty.

    Attributes:
        function: the estimate.
        covariance: of numerator (highest power first), denominator without its leading 1,
            and delay if the structure has one; SI, shape (size, size).
    """

    function: TransferFunction
    structure: Structure
    covariance: Array

    @property
    def coefficients(self) -> Array:
        """Estimates in the order of ``covariance``."""
        f = self.function
        delay = (f.delay,) if self.structure.delay else ()
        return np.array([*f.numerator, *f.denominator[1:], *delay])

    @property
    def standard_errors(self) -> Array:
        return np.asarray(np.sqrt(np.diag(self.covariance)))


class _Problem:
    """Residuals and slopes of one structure as functions of one vector."""

    def __init__(self, structure: Structure, measurements: Measurements, scale: float) -> None:
        self.structure, self.measurements, self.scale = structure, measurements, scale
        self.noise = np.array([data.noise_guess for data in measurements])
        self._last: tuple[bytes, list[tuple[Array, Array]]] = b"", []

    def point(self, x: Array) -> Point:
        """Vector (b, a, scale * delay) as a point."""
        m, n = self.structure.zeros + 1, self.structure.poles
        delay = float(x[m + n]) / self.scale if self.structure.delay else 0.0
        return Point(x[:m], x[m : m + n], self.scale, delay)

    def vector(self, point: Point) -> Array:
        delay = [point.delay * self.scale] if self.structure.delay else []
        return np.concatenate([point.b, point.a, delay])

    def parts(self, x: Array) -> list[tuple[Array, Array]]:
        """Errors and slopes of each piece of measurements, over the rows to be fitted."""
        if self._last[0] != x.tobytes():
            parts = []
            for data in self.measurements:
                with np.errstate(all="ignore"):
                    error, slopes = data.errors(self.point(x), self.structure.delay)
                if self.structure.delay:
                    slopes[:, -1] /= self.scale
                rows = data.fitted
                parts.append((error[rows], slopes[rows]))
            self._last = x.tobytes(), parts
        return self._last[1]

    def residuals(self, x: Array) -> Array:
        return np.concatenate([e / s for (e, _), s in zip(self.parts(x), self.noise)])

    def slopes(self, x: Array) -> Array:
        return np.concatenate([j / s for (_, j), s in zip(self.parts(x), self.noise)])

    def levels(self, x: Array) -> Array:
        """Noise levels, each freed from its share of the fitted coefficients."""
        errors = [e for e, _ in self.parts(x)]
        total = sum(len(e) for e in errors)
        free = 1.0 - len(x) / total
        sizes = np.array([max(float(np.std(e)), 1e-300) for e in errors])
        return np.asarray(sizes / np.sqrt(free))


def fit(
    structure: Structure,
    measurements: Measurements,
    smaller: Sequence[TransferFunction] = (),
) -> Fit | None:
    """Return the best fit over all starts, or None where none is finite.

    A delay is at most one over the lowest frequency that the data speak of.

    Args:
        structure: to be fitted.
        measurements: each with rows to be fitted.
        smaller: fitted functions of structures that this one contains.
    """
    longest_delay = 1.0 / band(measurements)[0]
    best: tuple[float, _Problem, Array] | None = None
    for start in _starts(structure, measurements, smaller):
        problem = _Problem(structure, measurements, start.scale)
        x = _descend(problem, problem.vector(start), longest_delay, SCOUTED)
        if x is None:
            continue
        reached = _unlikelihood(problem, x)
        if best is None or reached < best[0]:
            best = reached, problem, x
    if best is None:
        return None
    _, problem, x = best
    for _ in range(PASSES):
        better = _descend(problem, x, longest_delay, EVALUATIONS)
        x = x if better is None else better
        before, problem.noise = problem.noise, problem.levels(x)
        if len(measurements) == 1 or np.all(np.abs(problem.noise / before - 1.0) < STEADY):
            break
    problem.noise = problem.levels(x)
    fitted = _with_uncertainty(problem, x)
    return fitted if _is_finite(fitted.function, measurements) else None


def _is_finite(function: TransferFunction, measurements: Measurements) -> bool:
    """Whether it can still be evaluated: superfluous poles may run away to any speed."""
    with np.errstate(all="ignore"):
        errors = [data.errors(Point.of(function), False)[0] for data in measurements]
    return all(np.all(np.isfinite(error)) for error in errors)


def _descend(problem: _Problem, x: Array, longest_delay: float, evaluations: int) -> Array | None:
    from scipy.optimize import least_squares

    high = np.full(len(x), np.inf)
    low = -high
    if problem.structure.delay:
        low[-1], high[-1] = 0.0, longest_delay * problem.scale
        x = np.append(x[:-1], np.clip(x[-1], 1e-9 * high[-1], 0.999 * high[-1]))
    if not np.all(np.isfinite(problem.residuals(x))):
        return None
    with np.errstate(all="ignore"):  # a step too far makes the model unstable, and is taken back
        descent = least_squares(
            problem.residuals,
            x,
            problem.slopes,
            bounds=(low, high),
            x_scale="jac",
            ftol=1e-8,
            xtol=1e-9,
            gtol=1e-12,
            max_nfev=evaluations,
        )
    return np.asarray(descent.x)


def _unlikelihood(problem: _Problem, x: Array) -> float:
    """Negative log-likelihood with the noise levels at their best, up to a constant."""
    return sum(
        len(e) * float(np.log(level)) for (e, _), level in zip(problem.parts(x), problem.levels(x))
    )


def _with_uncertainty(problem: _Problem, x: Array) -> Fit:
    information = np.zeros((len(x), len(x)))
    spread = np.zeros_like(information)
    for data, (error, slopes), level in zip(problem.measurements, problem.parts(x), problem.noise):
        weighted, relative = slopes / level, error / level
        information += weighted.T @ weighted
        if isinstance(data, Record) and whiteness(relative) < 0.01:
            spread += scatter(weighted, autocovariance(relative))
        else:
            spread += weighted.T @ weighted
    inverse = np.linalg.pinv(information, hermitian=True)
    covariance = inverse @ spread @ inverse
    point, structure = problem.point(x), problem.structure
    m, n = structure.zeros + 1, structure.poles
    units = point.units
    delay = [1.0 / problem.scale] if structure.delay else []
    scale = np.concatenate([units[:m], units, delay])
    order = [*range(m)[::-1], *range(m, m + n)[::-1], *range(m + n, len(x))]
    si = (covariance * np.outer(scale, scale))[np.ix_(order, order)]
    return Fit(point.function(), structure, si)


def _cost(point: Point, measurements: Measurements) -> float:
    """Return the weighted sum of squares over the rows to be fitted; infinite if unstable."""
    total = 0.0
    with np.errstate(all="ignore"):
        for data in measurements:
            error, _ = data.errors(point, False)
            total += float(np.sum((error[data.fitted] / data.noise_guess) ** 2))
    return total if np.isfinite(total) else np.inf


def _starts(
    structure: Structure, measurements: Measurements, smaller: Sequence[TransferFunction]
) -> list[Point]:
    """Return starting points, the most promising first."""
    low, high = band(measurements)
    undelayed = [_grow(f, replace(structure, delay=False)) for f in smaller if not f.delay]
    ranked = _ranked(undelayed, measurements)
    if not (structure.delay and ranked):
        filters = [_poles_at(rate, structure.poles) for rate in np.geomspace(low, high, FILTERS)]
        refined = [_refine(f, structure.zeros, measurements) for f in filters]
        ranked = _ranked(refined, measurements)
    if structure.delay and ranked:
        base = ranked[0]
        longest = min(_lag(base), 1.0 / low)
        delays = longest * np.linspace(0.0, 1.0, DELAYS + 2)[1:-1]
        moved = (Point(base.b, base.a, base.scale, float(delay)) for delay in delays)
        refined = [_refine(_settled(p, high), structure.zeros, measurements) for p in moved]
        ranked = _ranked(refined, measurements)
    grown = [_grow(function, structure) for function in smaller]
    return _ranked([*ranked[:KEPT], *grown], measurements)


def _ranked(points: Sequence[Point | None], measurements: Measurements) -> list[Point]:
    costs = [(_cost(p, measurements), k, p) for k, p in enumerate(points) if p is not None]
    return [p for c, _, p in sorted(costs, key=lambda item: item[:2]) if np.isfinite(c)]


def _refine(filter_: Point, zeros: int, measurements: Measurements) -> Point | None:
    """Iterate from a filter, whose delay stays, to the best point seen."""
    _, high = band(measurements)
    best, least = None, np.inf
    model: Point | None = None
    for _ in range(ROUNDS):
        left = np.zeros((filter_.a.size + zeros + 1,))
        matrix = np.zeros((len(left), len(left)))
        for data in measurements:
            rows, size = data.fitted, data.noise_guess
            y, phi, z = data.regression(filter_, model, zeros)
            matrix += z[rows].T @ phi[rows] / size**2
            left += z[rows].T @ y[rows] / size**2
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(left))):
            break
        theta = np.linalg.lstsq(matrix, left, rcond=None)[0]
        b, a = np.split(theta, [zeros + 1])
        point = Point(np.asarray(b, float), np.asarray(a, float), filter_.scale, filter_.delay)
        reached = _cost(point, measurements)
        if reached < least:
            best, least = point, reached
        filter_ = _settled(point, high)
        model = filter_
    return best


def _poles_at(rate: float, order: int) -> Point:
    """(s + rate)^order."""
    a = np.array([float(comb(order, i)) for i in range(order)])
    return Point(np.array([1.0]), a, rate)


def _settled(point: Point, high: float) -> Point:
    """The same point with its poles made stable and not much faster than the data."""
    poles = np.roots([1.0, *point.a[::-1]])
    size = np.clip(np.abs(poles), 1e-6, 10.0 * high / point.scale)
    angle = np.angle(-np.abs(poles.real) + 1j * poles.imag)
    limit = np.pi - np.arccos(0.02)
    angle = np.where(np.abs(angle) < limit, np.sign(angle) * limit, angle)
    monic = np.real(np.poly(size * np.exp(1j * angle)))
    return Point.of(Point(point.b, monic[:0:-1], point.scale, point.delay).function())


def _lag(point: Point) -> float:
    """Delay [s] of slow signals, -G'(0) / G(0); infinite where it is not a positive one."""
    a, b = (np.append(c, 1.0 if c is point.a else 0.0) for c in (point.a, point.b))
    with np.errstate(all="ignore"):
        lag = float((a[1] / a[0] - b[1] / b[0]) / point.scale)
    return lag if np.isfinite(lag) and lag > 0.0 else np.inf


def _grow(function: TransferFunction, structure: Structure) -> Point:
    """The same function in a larger structure."""
    top, bottom = np.array(function.numerator), np.array(function.denominator)
    for _ in range(structure.poles - function.structure.poles):
        pole = FASTER * float(np.max(np.abs(np.roots(bottom))))
        bottom, top = np.polymul(bottom, [1.0, pole]), pole * top
    top = np.append(np.zeros(structure.zeros - function.structure.zeros), top)
    delay = function.delay
    if structure.delay and not delay:
        delay = 1e-3 / float(np.max(np.abs(np.roots(bottom))))
    return Point.of(TransferFunction.of(top, bottom, delay))
