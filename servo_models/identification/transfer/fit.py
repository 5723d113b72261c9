"""Output-error fit of one structure to all evidence at once, with its uncertainty.

Maximum likelihood for noise that is white and normal: each record and each frequency
response has a noise level of its own, estimated with the coefficients.  Where the residuals
of a record are not white, the covariance of the coefficients accounts for it.
Source: Ljung, System Identification, 2nd ed., secs. 7.4, 9.4 and 9.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.analysis.statistics import autocovariance, scatter, whiteness
from servo_models.core.types import Array
from servo_models.identification.transfer.evidence import Evidence, Point, Record
from servo_models.identification.transfer.functions import Structure, TransferFunction

PASSES = 6
"""Rounds of coefficients given noise levels, then noise levels given coefficients."""
STEADY = 0.01
"""A noise level that moves by less than this part has settled."""
EVALUATIONS = 60
SCOUTED = 12
"""Evaluations after which the most promising start goes on alone."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A transfer function with its uncertainty.

    Attributes:
        function: the estimate.
        covariance: of numerator (highest power first), denominator without its leading 1,
            and delay if the structure has one; SI, shape (size, size).
        noise: standard deviation of the errors of each piece of evidence.
    """

    function: TransferFunction
    structure: Structure
    covariance: Array
    noise: tuple[float, ...]

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

    def __init__(self, structure: Structure, evidence: Sequence[Evidence], scale: float) -> None:
        self.structure, self.evidence, self.scale = structure, evidence, scale
        self.noise = np.ones(len(evidence))
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
        """Errors and slopes of each piece of evidence, over the rows to be fitted."""
        if self._last[0] != x.tobytes():
            found = []
            for one in self.evidence:
                with np.errstate(all="ignore"):
                    error, slopes = one.errors(self.point(x), self.structure.delay)
                if self.structure.delay:
                    slopes[:, -1] /= self.scale
                rows = ~one.rows_held_out
                found.append((error[rows], slopes[rows]))
            self._last = x.tobytes(), found
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
    evidence: Sequence[Evidence],
    noise: Sequence[float],
    starts: Sequence[Point],
    longest_delay: float,
) -> Fit | None:
    """Return the best fit over all starts, or None where none is finite.

    Args:
        noise: first levels, in the units of ``Evidence.errors``.
        longest_delay: bound of the delay [s].
    """
    best: tuple[float, _Problem, Array] | None = None
    for start in starts:
        problem = _Problem(structure, evidence, start.scale)
        problem.noise = np.array(noise)
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
        if len(evidence) == 1 or np.all(np.abs(problem.noise / before - 1.0) < STEADY):
            break
    problem.noise = problem.levels(x)
    found = _with_uncertainty(problem, x)
    return found if _is_finite(found.function, evidence) else None


def _is_finite(function: TransferFunction, evidence: Sequence[Evidence]) -> bool:
    """Whether it can still be evaluated: superfluous poles may run away to any speed."""
    with np.errstate(all="ignore"):
        errors = [one.errors(Point.of(function), False)[0] for one in evidence]
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
        found = least_squares(
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
    return np.asarray(found.x)


def _unlikelihood(problem: _Problem, x: Array) -> float:
    """Negative log-likelihood with the noise levels at their best, up to a constant."""
    return sum(
        len(e) * float(np.log(level)) for (e, _), level in zip(problem.parts(x), problem.levels(x))
    )


def _with_uncertainty(problem: _Problem, x: Array) -> Fit:
    information = np.zeros((len(x), len(x)))
    spread = np.zeros_like(information)
    for one, (error, slopes), level in zip(problem.evidence, problem.parts(x), problem.noise):
        weighted, relative = slopes / level, error / level
        information += weighted.T @ weighted
        if isinstance(one, Record) and whiteness(relative) < 0.01:
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
    return Fit(point.function(), structure, si, tuple(map(float, problem.noise)))
