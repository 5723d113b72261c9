"""How sure a diagnosis is: probabilities of the explanations, and the set that holds the cause.

The probability of an explanation falls with the squared error that it leaves on blocks it
has not seen, counted in independent samples of the best one's errors: a model that is
never quite right leaves coloured errors, and those are fewer than they look.
Sources: Burnham, Anderson, Model Selection and Multimodel Inference, 2nd ed., sec. 2.9
(weights from information criteria; quasi-likelihood for overdispersion) and sec. 4.2.2
(bootstrapped selection); Kuensch, Annals of Statistics 17 (1989) (blocks).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.explanation import Explanation

Array = NDArray[np.float64]

COVERED = 0.95
TEMPER = 3.0
"""Factor on the dispersion: a small effect that is missing beside the right one, or a law that
is not quite the actuator's, favours a wrong one by more than noise would.  From withheld cases
of such a kind, with other seeds than those that are reported."""
DRAWS = 400


def probabilities(explanations: Sequence[Explanation]) -> Array:
    """Return the probability of each explanation among these, shape (n,).

    The mean of two opinions: the likelihood of the errors on unseen blocks, and how often an
    explanation wins when blocks are drawn again; the first knows the noise, the second how
    much one stretch of the log decides.
    """
    losses = np.array([one.loss for one in explanations])
    best = explanations[int(np.argmin(losses))]
    weights = np.exp(-(losses - losses.min()) / (2.0 * TEMPER * best.evidence.dispersion))
    return np.asarray(0.5 * (weights / weights.sum() + _wins(explanations)))


def _wins(explanations: Sequence[Explanation]) -> Array:
    """Share of draws of the blocks in which each explanation leaves the least, shape (n,)."""
    by_block = np.array([one.evidence.losses for one in explanations])
    by_block *= np.array([[one.loss / one.evidence.losses.sum()] for one in explanations])
    random = np.random.default_rng(0)
    drawn = random.integers(0, by_block.shape[1], (DRAWS, by_block.shape[1]))
    winners = np.argmin(by_block[:, drawn].sum(axis=2), axis=0)
    return np.bincount(winners, minlength=len(explanations)) / DRAWS


def covering(chances: Array, covered: float = COVERED) -> list[int]:
    """Return the fewest explanations, most likely first, that hold the cause so surely."""
    order = np.argsort(-chances)
    count = int(np.searchsorted(np.cumsum(chances[order]), covered)) + 1
    return [int(i) for i in order[:count]]
