"""What a fitted model could not repeat itself: the part of its errors that says nothing against it.

A quantiser or a dead band in a loop makes it hunt.  The hunting depends on parameters to more
digits than any log holds, so the response with the true cause differs from the measured one as
much as from itself with parameters changed within their standard errors.  Codes that merely flip at
other samples are no hunting: with a smaller change of parameters fewer of them do.
Source: Gelman, Meng, Stern, Statistica Sinica 6 (1996) 733 (posterior predictive checks).
"""

from __future__ import annotations

import numpy as np

from servo_models.diagnosis.fitting.discontinuous import discontinuous_of
from servo_models.diagnosis.fitting.fitted_model import FittedModel

DRAWS = 8
"""Other parameters that are tried."""
SMALL, SMALLER = 0.3, 0.03
"""How far they are away, in standard errors, and once more."""
HUNTING = 0.5
"""Share of a difference that stays when parameters are ten times nearer, from which a response
hunts; of codes that flip it would be a third, the root of a tenth."""


def unrepeatable(found: FittedModel) -> float:
    """Return by how much a response that hunts differs from itself [RMS, noise floors], else 0."""
    if found.widths is None:
        return 0.0
    difference, nearer = _difference(found, SMALL), _difference(found, SMALLER)
    return difference if nearer > HUNTING * difference else 0.0


def _difference(found: FittedModel, scale: float) -> float:
    """RMS change [noise floors] beyond the slopes; the size of a staircase stays."""
    problem, seen = found.problem, found.linearised
    free = [i for i in range(len(seen.vector)) if i not in discontinuous_of(problem)]
    _, spread, turned = np.linalg.svd(seen.slopes[:, free], full_matrices=False)
    certain = spread > 1e-6 * spread.max(initial=0.0)
    sizes = scale * np.sqrt(found.evidence.dispersion) / spread[certain]
    random = np.random.default_rng(0)
    power = 0.0
    for _ in range(DRAWS):
        vector = seen.vector.copy()
        vector[free] += (random.standard_normal(len(sizes)) * sizes) @ turned[certain]
        vector = np.clip(vector, *problem.bounds)
        moved = problem.residuals(vector) - seen.errors - seen.slopes @ (vector - seen.vector)
        power += float(np.mean(moved[: problem.samples] ** 2)) / DRAWS
    return float(np.sqrt(power))
