"""Whether a fitted model earns its further parameters."""

from __future__ import annotations

from servo_models.diagnosis.fitting.crossval import advantage, consistency
from servo_models.diagnosis.fitting.fitted_model import FittedModel
from servo_models.diagnosis.fitting.residuals import sure

LIKELY = 20.0
"""Twice the log likelihood ratio by which an effect has to predict unseen blocks better, beyond
what the best of so many trials does by chance."""
BY_CHANCE = 0.05
"""Probability that so many blocks favour it by chance."""
WORTH, PRESSED = 0.02, 0.2
"""Share of the error left [mean square] that an effect has to take away at least, and one that
a bound holds back: what it imitates may be another effect."""


def passes_entry_test(one: FittedModel, other: FittedModel, worth: float = WORTH) -> bool:
    """Return whether ``one`` predicts what its fit has not seen surely better than ``other``.

    ``worth`` is the share of the squared errors that it has to take away.
    """
    if one.disguised and not other.disguised:
        worth = max(worth, PRESSED)
    trials = 2.0 * max(one.chance - other.chance, 0.0)
    by_chance = not sure(other.left)
    saved = 1.0 - one.loss / other.loss if other.loss > 0.0 else 0.0
    return (
        saved > worth
        and advantage(one.evidence, other.evidence, by_chance) > LIKELY + trials
        and consistency(one.evidence, other.evidence) < BY_CHANCE
    )
