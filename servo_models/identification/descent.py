"""A short least-squares search: hundreds of fits a diagnosis, each of a few dozen simulations.

Levenberg and Marquardt on the normal equations, inside bounds.  Slopes are not taken anew at
every step: Broyden's rule corrects them by what the step has shown, and only where they
mispredict, or a step fails, are they simulated.  A final fit that is to be exact to many
digits is ``identification.search``'s.
Sources: Marquardt, J. SIAM 11 (1963); Nocedal, Wright, Numerical Optimization, 2nd ed., secs.
10.3 and 16.7 (projection on a box); Broyden, Mathematics of Computation 19 (1965).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.identification.problem import Problem

STRAY = 0.4
"""Part of a change that slopes may miss and still be corrected."""
DAMPING, SMALLEST, LARGEST = 1e-3, 1e-9, 1e8
"""Of the first step over the diagonal of the normal equations, the least, and the one that
gives up."""
ROUNDS, PACE = 4, 0.8
"""A search goes on for so many rounds, while one takes away a fifth of the squared errors."""
POOR, GOOD = 0.01, 0.5
"""Decrease over the predicted one, below which a step fails and above which damping falls."""
SLOPES_EVERY = 3
"""Steps for which a search may afford slopes once."""
EASED, HARDENED = 0.2, 5.0
"""Factors on the damping after a good step, and after a failed one."""


@dataclass
class _Point:
    """A vector, its errors, and slopes that were simulated there (``fresh``) or carried on."""

    vector: Array
    errors: Array
    slopes: Array
    fresh: bool

    @property
    def cost(self) -> float:
        return 0.5 * float(self.errors @ self.errors)


def descend(
    problem: Problem,
    start: Array,
    tolerance: float,
    limit: int,
    widths: Array | None = None,
    known: Array | None = None,
) -> tuple[Array, bool, Array | None]:
    """Return the best vector [scales] near ``start``, and whether the search met its tolerance.

    The slopes there come third, where they were simulated there, shape (m, p).

    Args:
        problem: its ``residuals`` are made small.
        start: shape (p,); a value outside its bounds is moved onto them.
        tolerance: relative decrease of the cost that ends the search.
        limit: of steps in a round.
        widths: over which slopes are taken [scales], shape (p,); None for small ones.
        known: slopes near the start, shape (m, k), of the first k parameters.
    """
    vector = np.clip(start, *problem.bounds)
    errors = problem.residuals(vector)
    at = _Point(vector, errors, _slopes(problem, vector, widths, known), fresh=known is None)
    met = False
    for _ in range(ROUNDS):
        before = at.cost
        at, met = _round(problem, at, tolerance, limit, widths)
        if met or at.cost > PACE * before:
            break
    return at.vector, met, at.slopes if at.fresh else None


def _round(
    problem: Problem, at: _Point, tolerance: float, limit: int, widths: Array | None
) -> tuple[_Point, bool]:
    """Steps until the tolerance is met or what a round may cost is spent."""
    low, high = problem.bounds
    damping = DAMPING
    spent = problem.memory.evaluations + limit * (len(at.vector) + 1) // SLOPES_EVERY
    for _ in range(limit):
        if problem.memory.evaluations > spent:
            break
        step, promised = _step(at, low, high, damping)
        if promised <= 0.1 * tolerance * at.cost:
            if at.fresh:
                return at, True
            at = _refreshed(problem, at, widths)
            continue
        errors = problem.residuals(at.vector + step)
        saved = at.cost - 0.5 * float(errors @ errors)
        if saved > POOR * promised:
            settled = saved < tolerance * at.cost and saved < 2.0 * promised
            at = _moved(problem, at, step, errors, widths)
            if settled:
                return at, True
            if saved > GOOD * promised:
                damping = max(damping * EASED, SMALLEST)
        elif not at.fresh:
            at = _refreshed(problem, at, widths)
        elif damping > LARGEST:
            return at, True
        else:
            damping *= HARDENED
    return at, False


def _refreshed(problem: Problem, at: _Point, widths: Array | None) -> _Point:
    slopes = problem.jacobian(at.vector, widths)
    return _Point(at.vector, at.errors, slopes, fresh=True)


def _slopes(problem: Problem, vector: Array, widths: Array | None, known: Array | None) -> Array:
    if known is None:
        return problem.jacobian(vector, widths)
    others = range(known.shape[1], len(vector))
    return np.column_stack([known, problem.jacobian(vector, widths, others)])


def _step(at: _Point, low: Array, high: Array, damping: float) -> tuple[Array, float]:
    """The damped step inside the box, and by how much it promises to lower the cost.

    It goes towards the least of the quadratic up to the first bound, and on along that: every
    part of the way leads down.
    """
    gradient, curvature = at.slopes.T @ at.errors, at.slopes.T @ at.slopes
    weights = np.diag(curvature) + 1e-12 * max(float(np.trace(curvature)), 1e-30)
    damped = curvature + np.diag(damping * weights)
    below, above = low - at.vector, high - at.vector
    step = np.zeros(len(gradient))
    inside = ~(((below >= 0.0) & (gradient > 0.0)) | ((above <= 0.0) & (gradient < 0.0)))
    while inside.any():
        towards = (gradient + damped @ step)[inside]
        move = np.zeros(len(step))
        move[inside] = -np.linalg.lstsq(damped[np.ix_(inside, inside)], towards, rcond=None)[0]
        ahead = step + move
        outside = ((move < 0.0) & (ahead < below)) | ((move > 0.0) & (ahead > above))
        if not outside.any():
            step = ahead
            break
        ends = np.where(move < 0.0, below, above)
        parts = np.divide(ends - step, move, out=np.full(len(step), np.inf), where=outside)
        step = step + max(float(parts.min()), 0.0) * move
        hit = outside & (parts == parts.min())
        step[hit] = ends[hit]
        inside &= ~hit
    return step, -float(step @ gradient + 0.5 * step @ curvature @ step)


def _moved(
    problem: Problem, at: _Point, step: Array, errors: Array, widths: Array | None
) -> _Point:
    """The point after a step, its slopes corrected by Broyden's rule where that is enough."""
    change = errors - at.errors
    missed = change - at.slopes @ step
    vector = at.vector + step
    if np.linalg.norm(missed) > STRAY * np.linalg.norm(change):
        return _Point(vector, errors, problem.jacobian(vector, widths), fresh=True)
    slopes = at.slopes + np.outer(missed, step / float(step @ step))
    return _Point(vector, errors, slopes, fresh=False)
