"""Further effects beside two: forward selection, with backward elimination after each step.

A fit with one more effect begins where that without it has ended.  Which of its rivals do as
well is asked once nothing more is added: each effect in turn is taken out and sought again.
Source: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd ed., sec. 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.conditions import carried_over
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.fits import Tell, best_of_each, settled, side_by_side
from servo_models.diagnosis.pairing import added, promising, seen_beside, swapped, without
from servo_models.diagnosis.worth import earns

MOST = 5
"""Effects in an explanation."""
THIRD = 0.2
"""Share of the error left [mean square] that a third effect and each after it has to take away:
many effects together imitate what is none of them."""
ADDED = 4
"""Effects that are fitted beside those that were taken."""


def further(
    bench: Bench, taken: Explanation, every: Sequence[Candidate], say: Tell
) -> list[Explanation]:
    """Return explanations by more effects than ``taken``, the one that earns its place first.

    None where no further effect does.  All have as many effects as the first.
    """
    tried: list[Explanation] = []
    fewer = taken
    while len(taken.effects) < MOST and not settled(taken):
        seen = promising(seen_beside(taken, every), (1.0 - THIRD) * taken.cost, ADDED)
        tasks = [added(taken, name, own) for name, own in seen]
        found = best_of_each(side_by_side(bench, tasks, say))
        better = next((it for it in found if _belongs(bench, it, taken)), None)
        if better is None:
            break
        needed = _needed(bench, better)
        # less is left after every step, so that no two of them take turns
        fewer, taken, tried = taken, needed if needed.loss < taken.loss else better, found
    if taken is fewer:
        return []
    every_one = best_of_each([taken, *tried, *swapped(bench, taken, every, say)])
    alike = [it for it in every_one if len(it.effects) == len(taken.effects)]
    names = frozenset(taken.effects)
    first = next(it for it in alike if frozenset(it.effects) == names or _belongs(bench, it, fewer))
    return [first, *(it for it in alike if it is not first)]


def _belongs(bench: Bench, more: Explanation, fewer: Explanation) -> bool:
    """Whether one effect more earns its place, under conditions left out as well."""
    return earns(more, fewer, THIRD) and carried_over(bench, more) <= carried_over(bench, fewer)


def _needed(bench: Bench, found: Explanation) -> Explanation:
    """The same without effects that another one has made needless."""
    for name in found.effects[:-1]:
        fewer = without(bench, found, name)
        if not earns(found, fewer):
            return _needed(bench, fewer)
    return found
