"""By how much a response differs from itself where a quantiser or a dead band makes it hunt.

Such a limit cycle depends on parameters to more digits than any log holds, so what it leaves of the
errors says nothing against a fitted model.  It shows where parameters change within their standard
errors.
Source: Gelman, Meng, Stern, Statistica Sinica 6 (1996) 733 (posterior predictive checks).
"""

from __future__ import annotations

import numpy as np

from servo_models.diagnosis.search.fitting import FittedModel, discontinuous_of

DRAWS = 8
"""Other parameters that are tried."""
MOVE_IN_STANDARD_ERRORS = 0.3
"""How far they are away."""
SMALLER_MOVE_IN_STANDARD_ERRORS = 0.03
"""The same once more."""
KEPT_SHARE = 0.5
"""Share of a difference that stays when parameters are ten times nearer, from which a response
hunts; of codes that flip it would be a third, the root of a tenth."""


def unrepeatable(found: FittedModel) -> float:
    """Return by how much a response that hunts differs from itself [RMS, noise floors], else 0."""
    if found.widths is None:
        return 0.0
    difference, nearer = (
        _difference(found, MOVE_IN_STANDARD_ERRORS),
        _difference(found, SMALLER_MOVE_IN_STANDARD_ERRORS),
    )
    return difference if nearer > KEPT_SHARE * difference else 0.0


def _difference(found: FittedModel, scale: float) -> float:
    """RMS change [noise floors] beyond the slopes; the value of a discontinuous parameter stays."""
    problem, linear = found.problem, found.linearised
    free = [i for i in range(len(linear.vector)) if i not in discontinuous_of(problem)]
    _, spread, turned = np.linalg.svd(linear.slopes[:, free], full_matrices=False)
    certain = spread > 1e-6 * spread.max(initial=0.0)
    sizes = scale * np.sqrt(found.evidence.dispersion) / spread[certain]
    random = np.random.default_rng(0)
    power = 0.0
    for _ in range(DRAWS):
        vector = linear.vector.copy()
        vector[free] += (random.standard_normal(len(sizes)) * sizes) @ turned[certain]
        vector = np.clip(vector, *problem.bounds)
        moved = problem.residuals(vector) - linear.errors - linear.slopes @ (vector - linear.vector)
        power += float(np.mean(moved[: problem.samples] ** 2)) / DRAWS
    return float(np.sqrt(power))
