"""How sure a diagnosis is: weights of the fitted models, and the set that holds the cause.

The weight of a fitted model falls with the squared error that it leaves on blocks it
has not seen, counted in independent samples of the best one's errors: a model that is
never quite right leaves coloured errors, and those are fewer than they look.
Sources: Burnham, Anderson, Model Selection and Multimodel Inference, 2nd ed., sec. 2.9
(weights from information criteria; quasi-likelihood for overdispersion); Huggins, Miller, Bayesian
Analysis 18 (2023) 79 (bagged posteriors: two models that are as wrong as each other get half each);
Kuensch, Annals of Statistics 17 (1989) (blocks).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.search.fitting import FittedModel

DRAWS = 400


def model_weights(fitted_models: Sequence[FittedModel], lacking: float = 0.0) -> Array:
    """Return the weight of each fitted model among these, shape (n,).

    ``lacking`` is the sum of the squared errors [noise floors squared] that are surely no noise.

    Bagged: weights by the likelihood of the errors on held-out blocks, averaged over draws of as
    many blocks with replacement.  Where one stretch of the log decides, draws without it count too.
    """
    blocks = np.array([one.evidence.losses for one in fitted_models])
    losses = np.array([one.loss for one in fitted_models])
    best = fitted_models[int(np.argmin(losses))]
    penalties = losses - blocks.sum(axis=1)
    random = np.random.default_rng(0)
    drawn = random.integers(0, blocks.shape[1], (DRAWS, blocks.shape[1]))
    every = blocks[:, drawn].sum(axis=2) + penalties[:, None]
    settings = best.settings
    scale = 2.0 * settings.temper * best.evidence.dispersion + settings.doubt_share * lacking
    weights = np.exp((every.min(axis=0) - every) / scale)
    return np.asarray((weights / weights.sum(axis=0)).mean(axis=1))


def covering(weights: Array, covered: float) -> list[int]:
    """Return the fewest fitted models, most likely first, that hold the cause so surely."""
    order = np.argsort(-weights)
    count = int(np.searchsorted(np.cumsum(weights[order]), covered)) + 1
    return [int(i) for i in order[:count]]
