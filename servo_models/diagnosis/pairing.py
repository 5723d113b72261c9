"""Pairs of effects: seen together, one beside another, and each sought again beside the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.fits import (
    STARTS,
    beside,
    best_of_each,
    names_of,
    settled,
    together,
)
from servo_models.diagnosis.screening import Sight, look, pairs
from servo_models.identification.problem import Free

Tell = Callable[[str], None]

FIRSTS, SECONDS, PAIRS = 3, 4, 4
"""Effects that get a second one beside them, how many of those, and pairs seen together."""
PROMISING = 0.95
"""Squared errors of a pair, as a look predicts them, over those of one effect."""
KEPT = 6
"""Sizes of a staircase or a ripple at which it is seen again beside another effect."""
SWAPS = 3
"""Effects that are tried in the place of one of a pair."""
FEW = 5
"""Second effects fitted where nothing is left to explain."""


def couples_of(
    bench: Bench,
    singles: Sequence[Explanation],
    sights: Sequence[Sight],
    every: Sequence[Candidate],
    say: Tell,
) -> list[Explanation]:
    """Pairs seen together from the start, and second effects seen beside the best first ones.

    One that explains everything already needs no long search for a second.
    """
    explained = settled(singles[0])
    found: list[Explanation] = []
    tried: set[frozenset[str]] = set()
    enough = PROMISING * singles[0].cost
    for pair in [] if explained else pairs(sights, enough)[:PAIRS]:
        tried.add(frozenset(sight.candidate.name for sight in pair))
        say(f"fitting {' and '.join(sight.candidate.name for sight in pair)}")
        found.append(together(bench, pair))
    nearer = [_nearer(one, sights) for one in every]
    for first in singles[: 1 if explained else FIRSTS]:
        others = [one for one in nearer if one.name not in first.effects]
        seconds, _ = look((first.view,), others)
        if not explained:
            seconds = [it for it in seconds if it.left < PROMISING * first.cost]
        for name in names_of(seconds)[: FEW if explained else SECONDS]:
            names = (*first.effects, name)
            if frozenset(names) not in tried:
                tried.add(frozenset(names))
                say(f"fitting {' and '.join(names)}")
                own = [it for it in seconds if it.candidate.name == name]
                found.append(beside(bench, first, own[:STARTS]))
    found = best_of_each(found)
    if found and not settled(found[0]):
        found = best_of_each([*found, *_swapped(bench, found[0], nearer, say)])
    return found


def _swapped(
    bench: Bench, couple: Explanation, every: Sequence[Candidate], say: Tell
) -> list[Explanation]:
    """Pairs in which one effect of a pair is kept as it is, and the other is sought again.

    From there the other may look different: another size, or another effect.
    """
    found: list[Explanation] = []
    for kept in couple.effects:
        stays = bench.unfit((kept,), _own(couple, kept), couple.values)
        others = [one for one in every if one.name != kept]
        seen, _ = look((stays.view,), others)
        seen = [it for it in seen if it.left < PROMISING * couple.cost]
        for name in names_of(seen)[:SWAPS]:
            say(f"fitting {kept} and {name} again")
            own = [it for it in seen if it.candidate.name == name]
            found.append(beside(bench, stays, own[:STARTS]))
    return found


def _own(couple: Explanation, name: str) -> list[Free]:
    """Free parameters of one effect of a pair."""
    free = couple.problem.free
    return [it for it in free if it.prior is None and it.name.startswith(f"{name}.")]


def halves_of(bench: Bench, couples: Iterable[Explanation]) -> list[Explanation]:
    """Each effect of a pair alone, begun where the pair has ended: it may suffice."""
    found = []
    for couple in couples:
        for name in couple.effects:
            found.append(bench.fit((name,), _own(couple, name), couple.values))
    return found


def _nearer(one: Candidate, sights: Sequence[Sight]) -> Candidate:
    """Of the many sizes of a staircase or a ripple, those that were promising once."""
    if not (one.fine or one.ripple):
        return one
    keys = one.sizes[0].keys()
    own = [sight.settings for sight in sights if sight.candidate.name == one.name][:KEPT]
    return replace(one, sizes=tuple({key: it[key] for key in keys} for it in own))
