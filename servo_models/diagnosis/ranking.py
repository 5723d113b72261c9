"""What a diagnosis says of each effect: how likely, how large, how much of the gap it closes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from servo_models.diagnosis.calibration import calibrated, doubtful
from servo_models.diagnosis.search.crossval import closed
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.selection import Selection
from servo_models.diagnosis.verdict import EFFECT, EFFECTS, Verdict
from servo_models.identification.doubts import doubt

NOTHING_ERRORS = 2.0  # standard errors from nothing up to which a size may be nothing


@dataclass(frozen=True)
class Value:
    """A parameter [SI] with its standard error, its value before, and why it is doubtful, if it is.

    The standard error is NaN on a bound, infinite where logs do not tell or nobody has asked.
    """

    name: str
    nominal: float
    value: float
    standard_error: float
    doubt: str = ""


@dataclass(frozen=True)
class RankedEffect:
    """An effect in the ranking.

    Attributes:
        name: of its place, and ``wire`` on which it acts.
        model_weight: share of the fitted models of as many effects as were taken that have it,
            each with its weight; None where none of them has. It ranks.
        probability: that it is among the causes, None where nothing is known of that: without a
            model weight, where the search was stopped, in logs that are not what was measured or
            sent, and outside the catalogue, where none of the effects explains all.
        in_set: whether it is in the set that cannot be told apart.
        taken: whether the after figures are with it.
        parameters: of the effect, in the best fitted model that has it.
        gap_after: error of blocks [noise floors] of that fitted model.
        closed: share of the reducible gap [1] that it closes, None where there is none.
        beside: the other effects of that fitted model.
        converged: False where its fit did not; it is ranked all the same.
        detectability: how far it can move the outputs of these logs [noise floors], without what
            nominal parameters imitate.
    """

    name: str
    wire: str
    model_weight: float | None
    probability: float | None
    in_set: bool
    taken: bool
    parameters: tuple[Value, ...]
    gap_after: float
    closed: float | None
    beside: tuple[str, ...]
    converged: bool
    detectability: float


def undetermined(taken: FittedModel) -> tuple[str, ...]:
    """Return the effects whose size may be nothing, or stands on a bound."""
    sizes = {one.name: one for one in estimates(taken)}
    mains = {name: sizes.get(taken.problem.model.plant.main(name).switch) for name in taken.effects}
    return tuple(
        name
        for name, size in mains.items()
        if size and not abs(size.value) > NOTHING_ERRORS * size.standard_error  # NaN on a bound
    )


def doubted(selection: Selection, verdict: Verdict, contradicted: Sequence[str]) -> tuple[str, ...]:
    """Return the effects that were taken and are not said to explain the gap, those among them
    that what is held out contradicts."""
    taken = selection.taken
    if verdict.kind not in (EFFECT, EFFECTS):
        return ()
    less = taken.effects if not taken.converged else (*contradicted, *undetermined(taken))
    return tuple(name for name in taken.effects if name in less)


def probabilities(
    selection: Selection, verdict: Verdict, contradicted: Sequence[str]
) -> dict[str, float]:
    """Return the probability of each effect being among the causes, by name; none outside the
    catalogue, where none of the effects explains all."""
    less_sure = doubted(selection, verdict, contradicted)
    told = calibrated(verdict.weights, verdict.kind)
    return {name: doubtful(p) if name in less_sure else p for name, p in told.items()}


def ranked_effects(
    selection: Selection, verdict: Verdict, known: Mapping[str, float]
) -> tuple[RankedEffect, ...]:
    """Return every effect that was fitted, most likely first, then by the gap it leaves.

    ``known`` are ``probabilities``; without any, none is told.
    """
    found: dict[str, RankedEffect] = {}
    for fitted_model in (selection.taken, *verdict.rivals, *selection.fitted.values()):
        for name in fitted_model.effects:
            if name not in found:
                found[name] = _ranked_effect(name, fitted_model, selection, verdict, known)
    place = {name: i for i, name in enumerate(verdict.weights)}
    others = len(place)
    return tuple(sorted(found.values(), key=lambda it: (place.get(it.name, others), it.gap_after)))


def _ranked_effect(
    name: str,
    fitted_model: FittedModel,
    selection: Selection,
    verdict: Verdict,
    known: Mapping[str, float],
) -> RankedEffect:
    model = fitted_model.problem.model
    matters = fitted_model is selection.taken or fitted_model in verdict.rivals
    values = estimates(fitted_model, matters)
    after = fitted_model.evidence.rms
    return RankedEffect(
        name=name,
        wire=model.plant.main_wire(name),
        model_weight=verdict.weights.get(name),
        probability=known.get(name),
        in_set=name in verdict.members,
        taken=name in selection.taken.effects,
        parameters=tuple(v for v in values if v.name.startswith(f"{name}.")),
        gap_after=after,
        closed=closed(selection.before.rms, after, 1.0),
        beside=tuple(other for other in fitted_model.effects if other != name),
        converged=fitted_model.converged,
        detectability=selection.detectability[name].shown,
    )


def estimates(fitted_model: FittedModel, asked: bool = True) -> tuple[Value, ...]:
    """Return every free parameter of a fitted model, with its standard error if that is asked.

    Of a fit that nobody has taken to the end it is not worth its simulations.
    """
    each = list(zip(fitted_model.problem.free, fitted_model.values.values()))
    if not (each and asked):
        return tuple(Value(one.name, one.nominal, value, math.inf) for one, value in each)
    errors = fitted_model.spread.standard_errors.tolist()
    return tuple(
        Value(one.name, one.nominal, value, error, doubt(one, value, error))
        for (one, value), error in zip(each, errors)
    )
