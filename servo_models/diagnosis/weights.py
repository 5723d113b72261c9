"""How sure a diagnosis is: probabilities of the fitted models, and the set that holds the cause.

The probability of a fitted model falls with the squared error that it leaves on blocks it
has not seen, counted in independent samples of the best one's errors: a model that is
never quite right leaves coloured errors, and those are fewer than they look.
Sources: Burnham, Anderson, Model Selection and Multimodel Inference, 2nd ed., sec. 2.9
(weights from information criteria; quasi-likelihood for overdispersion) and sec. 4.2.2
(bootstrapped selection); Kuensch, Annals of Statistics 17 (1989) (blocks).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.search.fitting import FittedModel

COVERED = 0.95
TEMPER = 3.0
"""Factor on the dispersion: a small effect that is missing beside the right one, or a law that
is not quite the actuator's, favours a wrong one by more than noise would.  From withheld cases
of such a kind, with other seeds than those that are reported."""
DOUBT = 0.02
"""Share of what a fitted model surely lacks that may favour a wrong one: where a law is missing,
two that leave nearly the same are not told apart by how many samples there are."""
DRAWS = 400


def probabilities(fitted_models: Sequence[FittedModel], lacking: float = 0.0) -> Array:
    """Return the probability of each fitted model among these, shape (n,).

    ``lacking`` is the sum of the squared errors [noise floors squared] that are surely no noise.

    The likelihood of the errors on unseen blocks knows the noise; its mean over blocks drawn
    again knows how much one stretch of the log decides.
    """
    blocks = np.array([one.evidence.losses for one in fitted_models])
    losses = np.array([one.loss for one in fitted_models])
    best = fitted_models[int(np.argmin(losses))]
    penalties = losses - blocks.sum(axis=1)
    random = np.random.default_rng(0)
    drawn = random.integers(0, blocks.shape[1], (DRAWS, blocks.shape[1]))
    every = blocks[:, drawn].sum(axis=2) + penalties[:, None]
    every = np.column_stack([losses, every])
    scale = 2.0 * TEMPER * best.evidence.dispersion + DOUBT * lacking
    weights = np.exp((every.min(axis=0) - every) / scale)
    weights /= weights.sum(axis=0)
    return np.asarray(0.5 * (weights[:, 0] + weights[:, 1:].mean(axis=1)))


def covering(chances: Array, covered: float = COVERED) -> list[int]:
    """Return the fewest fitted models, most likely first, that hold the cause so surely."""
    order = np.argsort(-chances)
    count = int(np.searchsorted(np.cumsum(chances[order]), covered)) + 1
    return [int(i) for i in order[:count]]
