"""From what was tried to what is said: one of six verdicts, and how sure.

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
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.data.audit import LEAST_GAP
from servo_models.diagnosis.gap import DRAWS, not_followed
from servo_models.diagnosis.residual_regression import (
    NOTHING_TESTED,
    LockedTest,
    command_locked,
)
from servo_models.diagnosis.search.crossval import closed
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.limit_cycle import lacks, unrepeatable
from servo_models.diagnosis.search.residuals import sure
from servo_models.diagnosis.search.selection import Selection

NO_GAP = "no-gap"
PARAMETERS = "parameters"
EFFECT = "effect"
EFFECTS = "effects"
OUTSIDE = "outside-catalogue"
NOT_IDENTIFIABLE = "not-identifiable"


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is said.

    Attributes:
        kind: one of the six.
        weights: model weight of each effect, most likely first, by name.
        members: effects of the set that holds the cause with ``covered_probability``; of a verdict
            ``parameters``, those that they mask.
        rivals: fitted models of that set, most likely first.
        rest: RMS [noise floors] of errors that are left and surely no noise, 0 for none.
        limit_cycle: by how much the fitted model differs from itself [RMS, noise floors], which
            says nothing against it and is in no ``rest``.
        locked: how far what is left follows the command.
    """

    kind: str
    weights: dict[str, float]
    members: tuple[str, ...]
    rivals: tuple[FittedModel, ...]
    rest: float = 0.0
    limit_cycle: float = 0.0
    locked: LockedTest = NOTHING_TESTED

    @property
    def lacks(self) -> bool:
        """Whether more than noise is left."""
        return self.kind == OUTSIDE or self.rest > 0.0

    def __str__(self) -> str:
        return self.kind


def _rank(chance: float, alone: float | None) -> tuple[float, float]:
    """Likeliest first; of those alike to a hundredth, such as two that are both sure, the one
    that explains most alone."""
    return -round(chance, 2), np.inf if alone is None else alone


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


def weights_of(selection: Selection, rest: float) -> Array:
    """Return the model weight of each of the fitted models ``alike``, shape (n,).

    ``rest`` is the RMS [noise floors] of what is surely missing.
    """
    return model_weights(selection.alike, selection.taken.problem.samples * rest**2)


def weights_by_effects(selection: Selection, verdict: Verdict) -> dict[tuple[str, ...], float]:
    """Return the model weight of each fitted model of as many effects as were taken, by these."""
    if not verdict.weights:
        return {}
    weights = weights_of(selection, verdict.rest)
    return {one.effects: weight for one, weight in zip(selection.alike, weights.tolist())}


def parameters_explain(selection: Selection) -> bool:
    """Return whether re-tuned parameters alone explain the gap."""
    retuned = selection.retuned
    share = closed(selection.before.rms, retuned.evidence.rms, 1.0)
    enough = share is not None and share >= retuned.settings.explained_share
    return enough and bool(retuned.problem.free)


def decide(selection: Selection, tolerance: float = LEAST_GAP) -> Verdict:
    """Return the verdict on what was tried.

    ``tolerance`` is the gap [noise floors] that counts as none.
    """
    taken, settings = selection.taken, selection.taken.settings
    if selection.before.rms <= tolerance:
        return Verdict(NO_GAP, {}, (), ())
    gap = rms(selection.retuned.evidence.errors)
    limit_cycle = unrepeatable(taken)
    left = taken.left.without(limit_cycle)
    slopes = taken.linearised.slopes[: taken.problem.samples]
    test = command_locked(taken.problem, taken.values, taken.evidence.errors, slopes)
    locked = replace(test, settings=settings)
    lacking = (
        lacks(taken, selection.retuned)
        or bool(not_followed(taken, tolerance))
        or locked.matters(left.noise, gap, limit_cycle)
    )
    rest = left.structured if sure(left, settings) else 0.0
    if not taken.effects:
        if lacking or left.structured > settings.most_left_floors:
            return Verdict(OUTSIDE, {}, (), (), rest, limit_cycle, locked)
        masked = selection.masked if parameters_explain(selection) else ()
        names = tuple(one.name for one in masked)
        return Verdict(PARAMETERS, {}, names, (), rest, limit_cycle)
    rivals = selection.alike
    chances = weights_of(selection, rest)
    held = covering(chances, settings.covered_probability)
    place = next(i for i, it in enumerate(rivals) if it.effects == taken.effects)
    if place not in held:
        # a likelier one has not earned its place, which a probability knows nothing of
        held.append(place)
    by_effect: dict[str, float] = {}
    for fitted_model, chance in zip(rivals, chances):
        for name in fitted_model.effects:
            # shares of 1 may add up to more by a rounding
            by_effect[name] = min(1.0, by_effect.get(name, 0.0) + float(chance))
    alone = {one.effects: one.loss for one in selection.of_size(1)}
    ranked = dict(sorted(by_effect.items(), key=lambda it: _rank(it[1], alone.get((it[0],)))))
    inside = tuple(dict.fromkeys(name for i in held for name in rivals[i].effects))
    kind = EFFECT if len(taken.effects) == 1 else EFFECTS
    if lacking:
        kind = OUTSIDE
    elif len(held) > settings.few_models:
        kind = NOT_IDENTIFIABLE
    near = tuple(rivals[i] for i in held)
    return Verdict(kind, ranked, inside, near, rest, limit_cycle, locked)
