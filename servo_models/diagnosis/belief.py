"""How sure a diagnosis is: probabilities of the explanations, and the set that holds the cause.

The probability of an explanation falls with the squared error that it leaves on blocks it
has not seen, counted in independent samples of the best one's errors: a model that is
never quite right leaves coloured errors, and those are fewer than they look.
Source: Burnham, Anderson, Model Selection and Multimodel Inference, 2nd ed., sec. 2.9
(weights from information criteria; quasi-likelihood for overdispersion).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.causes import Explanation
from servo_models.diagnosis.evidence import dispersion

Array = NDArray[np.float64]

COVERED = 0.95
TEMPERATURE = 1.0
"""Factor on the dispersion, found on simulated cases (docs/studies)."""


def probabilities(explanations: Sequence[Explanation]) -> Array:
    """Return the probability of each explanation among these, shape (n,)."""
    losses = np.array([one.loss for one in explanations])
    best = explanations[int(np.argmin(losses))]
    weights = np.exp(
        -(losses - losses.min()) / (2.0 * TEMPERATURE * dispersion(best.evidence.errors))
    )
    return np.asarray(weights / weights.sum())


def covering(chances: Array, covered: float = COVERED) -> list[int]:
    """Return the fewest explanations, most likely first, that hold the cause so surely."""
    order = np.argsort(-chances)
    count = int(np.searchsorted(np.cumsum(chances[order]), covered)) + 1
    return [int(i) for i in order[:count]]
