"""Pairs of effects: seen together, one beside another, and each sought again beside the other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.fits import (
    Task,
    Tell,
    beside,
    best_of_each,
    names_of,
    settled,
    side_by_side,
    starts_of,
    together,
)
from servo_models.diagnosis.screening import Sight, look, pairs
from servo_models.identification.problem import Free

FIRSTS, SECONDS, PAIRS = 3, 4, 4
"""Effects that get a second one beside them, how many of those, and pairs seen together."""
PROMISING = 0.95
"""Squared errors of a pair, as a look predicts them, over those of one effect."""
KEPT = 6
"""Sizes of a staircase or a ripple at which it is seen again beside another effect."""
SHOWN = 40
"""Sizes of a staircase that are all looked at."""
LESS = 0.98
"""Loss of a pair over that of one effect, from which the pair is worth more fits."""
SWAPS, LOOKALIKES = 3, 8
"""Effects that are tried in the place of one of a pair, while something is left to explain and
after."""
ALIKE = 1.1
"""Squared errors, as a look predicts them, over those of a pair that another one may leave."""
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
    seen = [] if explained else pairs(sights, PROMISING * singles[0].cost)[:PAIRS]
    tasks: dict[frozenset[str], Task] = {}
    for pair in seen:
        names = names_of(pair)
        tasks[frozenset(names)] = " and ".join(names), partial(together, pair=pair)
    nearer = [_nearer(one, sights) for one in every]
    for first in singles[: 1 if explained else FIRSTS]:
        enough = np.inf if explained else PROMISING * first.cost
        for name, own in _seconds(first, nearer, enough, FEW if explained else SECONDS):
            names = [*first.effects, name]
            task = " and ".join(names), partial(beside, first=first, own=own)
            tasks.setdefault(frozenset(names), task)
    found = best_of_each(side_by_side(bench, list(tasks.values()), say))
    if found and found[0].loss < LESS * singles[0].loss:
        found = best_of_each([*found, *_swapped(bench, found[0], nearer, say)])
    return found


def _seconds(
    first: Explanation, every: Sequence[Candidate], enough: float, count: int
) -> Iterator[tuple[str, list[Sight]]]:
    """Effects that look promising beside some others, with the sizes to begin from."""
    others = [one for one in every if one.name not in first.effects]
    seen = [sight for sight in look((first.view,), others)[0] if sight.left < enough]
    yield from starts_of(seen, count)


def _swapped(
    bench: Bench, couple: Explanation, every: Sequence[Candidate], say: Tell
) -> list[Explanation]:
    """Pairs in which one effect of a pair is kept as it is, and the other is sought again.

    From there the other may look different: another size, or another effect.  Where nothing is
    left to explain, those that do as well belong to the set that cannot be told apart.
    """
    done = settled(couple)
    enough, count = (ALIKE, LOOKALIKES) if done else (PROMISING, SWAPS)
    others = [one for one in every if not done or one.name not in couple.effects]
    tasks: list[Task] = []
    for kept in couple.effects:
        stays = bench.unfit((kept,), _own(couple, kept), couple.values)
        for name, own in _seconds(stays, others, enough * couple.cost, count):
            tasks.append((f"{kept} and {name} again", partial(beside, first=stays, own=own)))
    return list(side_by_side(bench, tasks, say))


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
    """Of the many sizes of a staircase or a ripple, those that were promising once.

    The few that a code histogram shows are good beside any other effect.
    """
    if not (one.fine or one.ripple):
        return one
    keys = one.sizes[0].keys()
    own = [sight.settings for sight in sights if sight.candidate.name == one.name][:KEPT]
    shown = one.fine if len(one.fine) <= SHOWN else ()
    return replace(one, sizes=(*({key: it[key] for key in keys} for it in own), *shown))
