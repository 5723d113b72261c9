"""Whether the errors that a model leaves are its own, or only coloured noise.

Noise does not know when the actuator moves, and its power is spread over frequencies.  What a
model lacks shows where there is motion, or, if something drives the actuator by itself, as a
line in the spectrum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.evidence import Evidence
from servo_models.identification.problem import Problem

Array = NDArray[np.float64]

STRETCHES = 60
"""Stretches of a record whose errors are set beside their motion."""
BY_CHANCE = 1e-3
"""Probability of such a rank correlation, if errors and motion know nothing of each other."""
LINE = 0.25
"""Share of the power in one line of a spectrum from which it is no noise."""


def structured(problem: Problem, evidence: Evidence) -> bool:
    """Return whether errors follow the motion of any output, or sound at one frequency."""
    start = 0
    for log in problem.logs:
        count = int(log.fitted.sum())
        for values in log.outputs.values():
            errors = evidence.errors[start : start + count]
            start += count
            if count and (_follows(errors, values[log.fitted]) or _sounds(errors)):
                return True
    return False


def _follows(errors: Array, measured: Array) -> bool:
    """Rank correlation of squared errors and movement over stretches of a record (Spearman)."""
    from scipy.stats import spearmanr

    parts = np.array_split(np.arange(len(errors)), min(STRETCHES, max(len(errors) // 8, 2)))
    power = [float(np.mean(errors[part] ** 2)) for part in parts]
    moved = [float(np.ptp(measured[part])) for part in parts]
    if np.ptp(moved) == 0.0 or np.ptp(power) == 0.0:
        return False
    found = spearmanr(power, moved, alternative="greater")
    return bool(found.pvalue < BY_CHANCE)


def _sounds(errors: Array) -> bool:
    """Whether a line and its two neighbours hold much of the power."""
    power = np.abs(np.fft.rfft((errors - errors.mean()) * np.hanning(len(errors)))) ** 2
    three = np.convolve(power, np.ones(3), "same")
    return bool(three[2:].max(initial=0.0) > LINE * power.sum())
