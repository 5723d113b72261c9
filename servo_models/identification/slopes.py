"""Over which steps the slopes of a response mean something.

A quantiser, dry friction or a sampler inside a loop makes the response a staircase of its
parameters, or throws a limit cycle to and fro: small differences are then 0, or noise that
grows as the step shrinks.
Source: More, Wild, Estimating derivatives of noisy simulations, ACM TOMS 38 (2012).
"""

from __future__ import annotations

import numpy as np

from servo_models.core.types import Array
from servo_models.identification.problem import DIFFERENCE, Problem

STEPS = (1e-3, 1e-2, 3e-2, 1e-1, 3e-1)
"""Wider steps, in scales, that are tried in turn."""
SAME = 0.5
"""Slopes differ if their difference is more than this part of the slope over the wider step."""


def steps(problem: Problem, vector: Array) -> Array | None:
    """Return for each parameter the least step whose slope the next wider step confirms.

    They are in scales, shape (p,); None where the smallest step will do for all.
    """
    widths = np.full(len(vector), DIFFERENCE)
    rough = np.ones(len(vector), dtype=bool)
    finer = problem.jacobian(vector)[: problem.samples]
    for step in STEPS:
        wider = problem.jacobian(vector, np.full(len(vector), step))[: problem.samples]
        size = np.linalg.norm(wider, axis=0)
        rough &= np.linalg.norm(finer - wider, axis=0) > SAME * size
        if not rough.any():
            break
        widths[rough] = step
        finer = wider
    return widths if np.any(widths > DIFFERENCE) else None
