"""Covariance of estimates whose errors are coloured.

The white-noise covariance would be far too small: here it is J+ R J+', with the covariance
R of the errors from an autoregressive model of each record's residuals.
Source: Ljung, System Identification, 2nd ed., sec. 9.3.
"""

from __future__ import annotations

import numpy as np

from servo_models.analysis.statistics import autocovariance, scatter
from servo_models.core.types import Array
from servo_models.identification.problem import Problem


def covariance(problem: Problem, jacobian: Array, residuals: Array, more: float = 1.0) -> Array:
    """Covariance of the estimates in scales, shape (p, p).

    Priors are scores of their own with the variance that they claim; that of the errors counts
    ``more`` times.
    """
    inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-14)
    count = problem.samples
    prior = jacobian[count:]
    middle = prior.T @ prior
    start = 0
    for log in problem.logs:
        kept = int(log.fitted.sum())
        if kept == 0:
            continue
        for _ in log.outputs:
            part = slice(start, start + kept)
            own = autocovariance(residuals[part])
            middle = middle + more * scatter(jacobian[part], own)
            start += kept
    freedom = count / max(count - jacobian.shape[1], 1)
    return np.asarray(freedom * inverse @ middle @ inverse)
