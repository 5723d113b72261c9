"""By how much a response differs from itself where a quantiser or a dead band makes it hunt.

Such a limit cycle depends on parameters to more digits than any log holds, so what it leaves of the
errors says nothing against a fitted model.  It shows where parameters change within their standard
errors.
Source: Gelman, Meng, Stern, Statistica Sinica 6 (1996) 733 (posterior predictive checks).
"""

from __future__ import annotations

import numpy as np

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.diagnosis.search.fitting import FittedModel, discontinuous_of
from servo_models.diagnosis.search.residuals import unmodelled

DRAWS = 8  # draws of other parameters
MOVE_IN_STANDARD_ERRORS = 0.3  # standard deviation of such a draw
NEARER = 0.1  # share of that move at which they are tried once more


def unrepeatable(fitted: FittedModel) -> float:
    """Return by how much a response that hunts differs from itself [RMS, noise floors], else 0."""
    if fitted.widths is None:
        return 0.0
    moves = _moves(fitted)
    difference, nearer = _difference(fitted, moves), _difference(fitted, NEARER * moves)
    return difference if nearer > fitted.settings.hunting_share * difference else 0.0


def lacks(fitted: FittedModel, retuned: FittedModel) -> bool:
    """Return whether a fitted model lacks something that matters beside ``retuned``, see
    ``unmodelled``; that it hunts says nothing against it."""
    gap = rms(retuned.evidence.errors)
    left = fitted.left.without(unrepeatable(fitted))
    return unmodelled(left, gap, len(fitted.effects), fitted.settings)


def _moves(fitted: FittedModel) -> Array:
    """Moves of the parameters within their standard errors and bounds, shape (draws, p); the value
    of a discontinuous parameter stays."""
    problem, linear = fitted.problem, fitted.linearised
    free = [i for i in range(len(linear.vector)) if i not in discontinuous_of(problem)]
    _, spread, turned = np.linalg.svd(linear.slopes[:, free], full_matrices=False)
    certain = spread > 1e-6 * spread.max(initial=0.0)
    sizes = MOVE_IN_STANDARD_ERRORS * np.sqrt(fitted.evidence.dispersion) / spread[certain]
    random, vectors = np.random.default_rng(0), np.tile(linear.vector, (DRAWS, 1))
    vectors[:, free] += (random.standard_normal((DRAWS, len(sizes))) * sizes) @ turned[certain]
    return np.asarray(np.clip(vectors, *problem.bounds) - linear.vector)


def _difference(fitted: FittedModel, moves: Array) -> float:
    """RMS change [noise floors] beyond the slopes."""
    problem, linear = fitted.problem, fitted.linearised
    power = 0.0
    for move in moves:
        moved = problem.residuals(linear.vector + move) - linear.errors - linear.slopes @ move
        power += float(np.mean(moved[: problem.samples] ** 2)) / len(moves)
    return float(np.sqrt(power))
