"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

An effect is taken only if it predicts blocks that its fit has not seen, and beside a pair
each half has to earn its place, also under conditions that were left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf, log

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.fitting.conditions import leave_one_condition_out
from servo_models.diagnosis.fitting.crossval import CrossValidation
from servo_models.diagnosis.fitting.entry_test import passes_entry_test
from servo_models.diagnosis.fitting.fitted_model import FittedModel, Fitter
from servo_models.diagnosis.search.detectability import Detectability, reaches
from servo_models.diagnosis.search.first_fits import FirstFits, first_fits
from servo_models.diagnosis.search.fits import (
    Tell,
    Teller,
    beside_each,
    best_of_each,
    settled,
    starts_of,
)
from servo_models.diagnosis.search.forward import forward_selection
from servo_models.diagnosis.search.masking import MaskedEffect, masked_effects
from servo_models.diagnosis.search.pairing import LESS, ambiguous, singles_of
from servo_models.diagnosis.search.preselection import preselect
from servo_models.diagnosis.search.screening import Screened, promising, screening_results

TOLERANCE = 2.0
"""Gap in noise floors that counts as none."""
QUIET = 4
"""Effects that are fitted where nominal parameters leave noise only."""
FINALISTS, NEARLY = 3, 1.5
"""Those are fitted on that leave less than this over the best."""
FINER, LONGER = 1e-6, 60
"""Relative tolerance and steps of these fits."""
HALVED = 2
"""Pairs of which each half is tried alone again."""
LEAST = 1.0
"""Movement of the outputs [RMS, noise floors] from which what parameters imitate is told."""


@dataclass(frozen=True, eq=False)
class Selection:
    """What was tried and what was taken.

    Attributes:
        before: the nominal model.
        retuned: nominal parameters alone.
        singles, pairs: fitted models by one and by two effects, best first.
        more: by as many as were taken, where further ones were added to a pair.
        taken: the fitted model that earns its place.
        detectability: how far each effect can move the outputs, by its name.
        masked: effects that may be there beside nominal parameters alone, if these were taken.
    """

    before: CrossValidation
    retuned: FittedModel
    singles: list[FittedModel]
    pairs: list[FittedModel]
    more: list[FittedModel]
    taken: FittedModel
    detectability: dict[str, Detectability]
    masked: Sequence[MaskedEffect] = ()

    @property
    def alike(self) -> list[FittedModel]:
        """Fitted models by as many effects as were taken."""
        return self.more or (self.pairs if len(self.taken.effects) == 2 else self.singles)

    @property
    def fitted(self) -> dict[str, FittedModel]:
        """By each effect that was fitted: alone, or else the best fitted model that has it."""
        found: dict[str, FittedModel] = {}
        for one in (*self.singles, *self.pairs, *self.more):
            for name in one.effects:
                found.setdefault(name, one)
        return found


def select_effects(
    fitter: Fitter,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
    tolerance: float = TOLERANCE,
) -> Selection:
    """Explain a gap by nominal parameters, by one effect, or by several.

    Args:
        fitter: model, logs, priors and floors.
        left_out: effects that are not considered.
        tell: is told what goes on.
        tolerance: gap [noise floors] up to which there is nothing to explain.
    """
    say = Teller(tell) if tell else Teller()
    as_it_is = fitter.unfitted()
    before = as_it_is.evidence
    if before.rms <= tolerance:
        return Selection(before, as_it_is, [], [], [], as_it_is, {})
    say("re-tuning nominal parameters")
    fitter = fitter.surveyed()
    retuned = fitter.finish(fitter.fit((), ()))
    # an effect with an uncertain size is one of the nominal ones, and free in every fit
    owners = {fitter.model.plant.parameters[free.name].owner for free in fitter.nominal}
    every = candidates(fitter.model, fitter.logs, owners.union(left_out))
    fitter = replace(fitter, trials={one.name: log(one.trials) for one in every})
    say(f"looking at {len(every)} effects")
    plain = [retuned]
    if not settled(retuned):
        nominal = {free.name: free.nominal for free in fitter.nominal}
        plain.insert(0, fitter.unfit((), (), nominal))
    results = screening_results([it.linearised for it in plain], every)
    reach = reaches(results, every)
    tried = _tried(fitter, retuned, promising(results), every, say)
    couples, more, taken = _explained(fitter, retuned, tried, say)
    masked: Sequence[MaskedEffect] = ()
    if taken is retuned:
        say("looking for what re-tuned parameters imitate")
        masked = masked_effects(fitter, retuned, results, max(tolerance, LEAST))
    else:
        say(f"fitting {' and '.join(taken.effects)} to the end")
        taken = fitter.finish(taken)
    return Selection(before, retuned, tried.singles, couples, more, taken, reach, masked)


def _tried(
    fitter: Fitter,
    retuned: FittedModel,
    results: Sequence[Screened],
    every: Sequence[Candidate],
    say: Teller,
) -> FirstFits:
    """Fits of one and of two effects, those to the end that leave least."""
    if settled(retuned):
        few = beside_each(fitter, retuned, starts_of(results, QUIET), say)
        found = FirstFits(few, [], preselect(every, results))
    else:
        found = first_fits(fitter, retuned, results, every, say)
    singles, couples, near = found
    better = [it for it in couples[:HALVED] if it.loss < LESS * singles[0].loss]
    singles = best_of_each([*singles, *singles_of(fitter, better)])
    if not settled(retuned):
        say("fitting the best to the end")
        least = min((it.loss for it in (*singles, *couples)), default=inf)
        singles, couples = _finals(fitter, singles, least), _finals(fitter, couples, least)
    return FirstFits(singles, couples, near)


def _explained(
    fitter: Fitter, retuned: FittedModel, tried: FirstFits, say: Teller
) -> tuple[list[FittedModel], list[FittedModel], FittedModel]:
    """Fitted models by two effects, by more, and the one that is taken."""
    couples = tried.couples
    taken = _taken(fitter, retuned, tried.singles, couples)
    if len(taken.effects) < 2:
        return couples, [], taken
    more = forward_selection(fitter, taken, couples, tried.near, say)
    if more:
        return couples, more, more[0]
    if not settled(taken):
        # beside a pair that leaves noise only they have been sought already
        couples = best_of_each([*couples, *ambiguous(fitter, taken, tried.near, say)])
        taken = _taken(fitter, retuned, tried.singles, couples)
    return couples, [], taken


def _finals(fitter: Fitter, found: Sequence[FittedModel], least: float) -> list[FittedModel]:
    """The same with those near the least loss fitted on: a search may have stopped short."""
    near = [it for it in found[:FINALISTS] if it.loss < NEARLY * least]
    forward_selection = [fitter.again(it, FINER, LONGER) for it in near if not settled(it)]
    return best_of_each([*forward_selection, *found])


def _taken(
    fitter: Fitter,
    retuned: FittedModel,
    singles: Sequence[FittedModel],
    couples: Sequence[FittedModel],
) -> FittedModel:
    best = singles[0] if singles and passes_entry_test(singles[0], retuned) else retuned
    lost: float | None = None
    for couple in couples:
        parts = [one for one in singles if set(one.effects) <= set(couple.effects)]
        if passes_entry_test(couple, best) and all(
            passes_entry_test(couple, part) for part in parts
        ):
            lost = leave_one_condition_out(fitter, best) if lost is None else lost
            if leave_one_condition_out(fitter, couple) <= lost:
                return couple
    return best
