"""Further effects beside two: forward selection, with backward elimination after each step.

A fit with one more effect begins where that without it has ended.  Which of its rivals do as
well is asked once nothing more is added: each effect in turn is taken out and sought again.
Source: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd ed., sec. 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.conditions import leave_one_condition_out
from servo_models.diagnosis.fitting.entry_test import WORTH, passes_entry_test
from servo_models.diagnosis.fitting.fitted_model import FittedModel, Fitter
from servo_models.diagnosis.search.fits import Teller, best_of_each, settled, side_by_side
from servo_models.diagnosis.search.pairing import (
    added,
    ambiguous,
    promising,
    screen_discontinuous,
    swap,
    without,
)
from servo_models.diagnosis.search.preselection import seen_beside

MOST = 5
"""Effects in a fitted model."""
THIRD = 0.2
"""Share of the error left [mean square] that a third effect and each after it has to take away:
many effects together imitate what is none of them."""
ADDED = 4
"""Effects that are fitted beside those that were taken."""
RIVAL, RIVALS = 1.25, 1
"""Loss of a pair of quite other effects over that of the pair taken, up to which further effects
are sought beside it as well, and how many such pairs."""


def forward_selection(
    fitter: Fitter,
    taken: FittedModel,
    couples: Sequence[FittedModel],
    every: Sequence[Candidate],
    say: Teller,
) -> list[FittedModel]:
    """Return fitted models by more effects than ``taken``, the one that earns its place first.

    None where no further effect does.  All have as many effects as the first.  Of ``couples``, one
    that leaves little more by quite other effects gets a third as well: that of two look-alikes
    which is closer to the cause gains more by what both lack.
    """
    others = (_grown(fitter, one, every, say) for one in _rivals(taken, couples))
    ends = [it for it in others if it and _belongs(fitter, it.taken, taken, WORTH)]
    own = _grown(fitter, taken, every, say)
    ends += [own] if own else []
    if not ends:
        return []
    end = min(ends, key=lambda it: it.taken.loss)
    every_one = best_of_each([end.taken, *end.tried, *swap(fitter, end.taken, every, say)])
    if not settled(every_one[0]):
        every_one = best_of_each([*every_one, *ambiguous(fitter, every_one[0], every, say)])
    alike = [it for it in every_one if len(it.effects) == len(end.taken.effects)]
    names = frozenset(end.taken.effects)
    first = next(
        it for it in alike if frozenset(it.effects) == names or _belongs(fitter, it, end.fewer)
    )
    return [first, *(it for it in alike if it is not first)]


def _rivals(taken: FittedModel, couples: Sequence[FittedModel]) -> list[FittedModel]:
    """Pairs without any effect of the one that is taken, which leave little more."""
    others = [it for it in couples if not set(it.effects) & set(taken.effects)]
    return [it for it in others if it.loss < RIVAL * taken.loss][:RIVALS]


class _Grown(NamedTuple):
    """A fitted model, that by one effect fewer, and what else was tried in the last step."""

    taken: FittedModel
    fewer: FittedModel
    tried: list[FittedModel]


def _grown(
    fitter: Fitter, taken: FittedModel, every: Sequence[Candidate], say: Teller
) -> _Grown | None:
    """Add effects to a fitted model as long as they earn their place."""
    grown: _Grown | None = None
    while len(taken.effects) < MOST and not settled(taken):
        seen = seen_beside(taken, every)
        seen += screen_discontinuous(fitter, taken, every, seen)
        seen.sort(key=lambda result: result.left)
        likely = promising(seen, (1.0 - THIRD) * taken.cost, ADDED)
        tasks = [added(taken, name, own) for name, own in likely]
        found = best_of_each(side_by_side(fitter, tasks, say))
        better = next((it for it in found if _belongs(fitter, it, taken)), None)
        if better is None:
            break
        needed = _needed(fitter, better)
        # less is left after every step, so that no two of them take turns
        grown = _Grown(needed if needed.loss < taken.loss else better, taken, found)
        taken = grown.taken
    return grown


def _belongs(fitter: Fitter, more: FittedModel, fewer: FittedModel, worth: float = THIRD) -> bool:
    """Whether further effects earn their place, under conditions left out as well."""
    return passes_entry_test(more, fewer, worth) and leave_one_condition_out(
        fitter, more
    ) <= leave_one_condition_out(fitter, fewer)


def _needed(fitter: Fitter, found: FittedModel) -> FittedModel:
    """The same without effects that another one has made needless."""
    for name in found.effects[:-1]:
        fewer = without(fitter, found, name)
        if not passes_entry_test(found, fewer):
            return _needed(fitter, fewer)
    return found
