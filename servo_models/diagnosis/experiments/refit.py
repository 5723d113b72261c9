"""What one fitted model leaves of another one's response once it is re-fitted to that in earnest.

Source: Atkinson, Fedorov, Biometrika 62 (1975) (T-optimality: the rival re-fitted).
"""

from __future__ import annotations

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.identification.problem import Problem

EVALUATIONS = 40
"""Slopes that a fit may take."""


def residual_after_refit(rival: FittedModel, problem: Problem, known: Array) -> float:
    """Return the RMS error [noise floors] of a rival on a log, re-fitted to that log.

    Args:
        rival: where it begins, and to stay near which logs so far and priors ask.
        problem: its own with the log that is to be imitated.
        known: what logs so far and priors say of its parameters, shape (p, p) per scale.
    """
    from scipy.optimize import least_squares

    start, (low, high) = rival.evidence.vector, problem.bounds
    room = np.flatnonzero(high > low)
    size, axes = np.linalg.eigh(known)
    root = np.sqrt(np.maximum(size, 0.0))[:, None] * axes.T

    def at(values: Array) -> Array:
        vector = start.copy()
        vector[room] = values
        return vector

    def data(values: Array) -> Array:
        return problem.residuals(at(values))[: problem.samples]

    def errors(values: Array) -> Array:
        return np.concatenate([data(values), root @ (at(values) - start)])

    def slopes(values: Array) -> Array:
        own = problem.jacobian(at(values), rival.widths, room.tolist())[: problem.samples]
        return np.vstack([own, root[:, room]])

    found = np.clip(start, low, high)[room]
    if len(room):
        limits = (low[room], high[room])
        found = least_squares(errors, found, slopes, limits, max_nfev=EVALUATIONS).x
    return float(np.sqrt(np.mean(data(found) ** 2)))
