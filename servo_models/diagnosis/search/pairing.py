"""Pairs of effects: seen together, one beside another, and each sought again beside the other."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.fitted_model import FittedModel, Fitter
from servo_models.diagnosis.search.fits import (
    Seen,
    Task,
    Teller,
    beside,
    best_of_each,
    likeliest,
    names_of,
    settled,
    side_by_side,
    starts_of,
    together,
)
from servo_models.diagnosis.search.grid_search import shortlist
from servo_models.diagnosis.search.pair_screening import pairs
from servo_models.diagnosis.search.preselection import Looks, seen_beside
from servo_models.diagnosis.search.screening import Screened, screen
from servo_models.identification.problem import Free

FIRSTS, SECONDS, PAIRS = 3, 4, 6
"""Effects that get a second one beside them, how many of those, and pairs seen together."""
PROMISING = 0.95
"""Squared errors of a pair, as a look predicts them, over those of one effect."""
SAME = 0.99
"""Cosine between changes of the response from which they are the same."""
LESS = 0.98
"""Loss of a pair over that of one effect, from which the pair is worth more fits."""
ABOUT = tuple(k * 4e-4 for k in range(-6, 7))
"""How far from its size in a pair a staircase is sought again, relative to it."""
SWAPS, LOOKALIKES = 3, 8
"""Effects that are tried in the place of one of a pair, while something is left to explain and
after."""
ALIKE = 1.1
"""Squared errors, as a look predicts them, over those of a pair that another one may leave."""
FEW = 5
"""Second effects fitted where nothing is left to explain."""


def paired(
    fitter: Fitter,
    singles: Sequence[FittedModel],
    results: Sequence[Screened],
    every: Sequence[Candidate],
    looks: Looks,
    say: Teller,
    known: Iterable[FittedModel] = (),
) -> list[FittedModel]:
    """Pairs seen together from the start, and second effects seen beside the best first ones.

    One effect, or a pair seen together, that explains everything needs no long search for another.
    Pairs ``known`` are not fitted again.
    """
    if not singles:
        return []
    old = {frozenset(it.effects): it for it in known}
    if settled(singles[0]):
        more = _seconds(singles[:1], every, LESS, FEW, looks, old)
        return best_of_each([*old.values(), *side_by_side(fitter, more, say)])
    seen = pairs(results, PROMISING * singles[0].cost)[:PAIRS]
    new = [pair for pair in seen if frozenset(names_of(pair)) not in old]
    tasks = [(" and ".join(names_of(pair)), partial(together, pair=pair)) for pair in new]
    found = best_of_each([*old.values(), *side_by_side(fitter, tasks, say)])
    if any(map(settled, found)):
        return found
    fitted = {frozenset(it.effects) for it in found}
    more = _seconds(singles[:FIRSTS], every, PROMISING, SECONDS, looks, fitted)
    return best_of_each([*found, *side_by_side(fitter, more, say)])


def _seconds(
    firsts: Iterable[FittedModel],
    every: Sequence[Candidate],
    share: float,
    count: int,
    looks: Looks,
    known: Collection[frozenset[str]],
) -> list[Task]:
    """Fits of so many effects beside each first one, which promise to leave less than a share."""
    tasks: dict[frozenset[str], Task] = {}
    for first in firsts:
        for name, own in promising(looks.beside(first, every), share * first.cost, count):
            tasks.setdefault(frozenset((*first.effects, name)), added(first, name, own))
    return [task for names, task in tasks.items() if names not in known]


def promising(
    seen: Iterable[Screened], enough: float, count: int, unlike: bool = True
) -> Iterator[Seen]:
    """Effects that promise to leave less than enough, and sizes to begin from.

    Those that are to be ``unlike`` each other do not change the response alike: of some that do,
    only the first is worth a fit while the others' places may be taken by the cause.
    """
    chosen: list[Screened] = []
    for name, own in starts_of([it for it in seen if it.left < enough]):
        if len(chosen) == count:
            break
        if not (unlike and any(_same(own[0], it) for it in chosen)):
            chosen.append(own[0])
            yield name, own


def _same(one: Screened, other: Screened) -> bool:
    """Whether two effects change the response alike, beside what parameters imitate."""
    a, b = one.difference, other.difference
    return abs(float(a @ b)) > SAME * float(np.linalg.norm(a) * np.linalg.norm(b))


def discontinuous_beside(
    fitter: Fitter, first: FittedModel, every: Sequence[Candidate], looks: Looks, say: Teller
) -> Iterator[FittedModel]:
    """Fits of staircases beside an effect, at the sizes that look best there."""
    say(f"looking closer at staircases beside {' and '.join(first.effects)}")
    discontinuous = screen_discontinuous(fitter, first, every, looks.beside(first, every))
    likely = promising(discontinuous, PROMISING * first.cost, SECONDS)
    return side_by_side(fitter, [added(first, name, own) for name, own in likely], say)


def screen_discontinuous(
    fitter: Fitter, first: FittedModel, every: Sequence[Candidate], seen: Sequence[Screened]
) -> list[Screened]:
    """What is seen of staircases beside some effects after a closer look, best first.

    ``seen`` is what is seen of all effects there before.
    """
    return screen((first.linearised,), shortlist(fitter, first, every, seen))


def added(first: FittedModel, name: str, own: Sequence[Screened]) -> Task:
    """The fit of an effect beside those of ``first``."""
    return " and ".join((*first.effects, name)), partial(beside, first=first, own=own)


def swap(
    fitter: Fitter, found: FittedModel, every: Sequence[Candidate], say: Teller
) -> list[FittedModel]:
    """Fitted models in which one effect is sought again, the others kept as they are.

    Beside them it may look different: another size, or another effect.  Where nothing is left to
    explain, only those that do as well are sought.
    """
    if settled(found):
        return ambiguous(fitter, found, every, say)
    return _sought(fitter, found, every, PROMISING, SWAPS, say)


def ambiguous(
    fitter: Fitter, found: FittedModel, every: Sequence[Candidate], say: Teller
) -> list[FittedModel]:
    """Fitted models in which another effect takes the place of one, and may do as well.

    They belong to the set that cannot be told apart.
    """
    others = [one for one in every if one.name not in found.effects]
    return _sought(fitter, found, others, ALIKE, LOOKALIKES, say, unlike=False)


def _sought(
    fitter: Fitter,
    found: FittedModel,
    every: Sequence[Candidate],
    enough: float,
    count: int,
    say: Teller,
    unlike: bool = True,
) -> list[FittedModel]:
    """Fitted models with each effect in turn taken out, and another one of ``every`` fitted in its
    place: at most ``count``, which promise to leave less than ``enough`` times as much.

    One that has a shape is tried again whatever it promises: no slope may have led to it.
    """
    tasks: list[Task] = []
    for name in found.effects:
        stays = fitter.unfit(*_without(found, name), found.values)
        seen = seen_beside(stays, [_nearer(one, found) for one in every])
        likely = dict(promising(seen, enough * found.cost, count, unlike))
        own = likeliest([it for it in seen if it.candidate.name == name])
        if len({it.candidate.shape_at(it.settings) for it in own}) > 1:
            likely.setdefault(name, own)
        tasks += [added(stays, other, results) for other, results in likely.items()]
    return list(side_by_side(fitter, tasks, say))


def _nearer(one: Candidate, found: FittedModel) -> Candidate:
    """A staircase with sizes very near that of a fit, if it is part of it: beside another effect
    the needle may lie next to where it was found alone."""
    if not one.discontinuous or one.name not in found.effects:
        return one
    switch = one.free[0].name
    size = found.values[switch]
    return replace(
        one, trial_values=(*one.trial_values, *({switch: size * (1.0 + it)} for it in ABOUT))
    )


def without(fitter: Fitter, found: FittedModel, name: str) -> FittedModel:
    """The fit without one of some effects, begun where that with it has ended."""
    return fitter.fit(*_without(found, name), found.values)


def _without(found: FittedModel, name: str) -> tuple[tuple[str, ...], list[Free]]:
    """The other effects and their free parameters."""
    effects = tuple(it for it in found.effects if it != name)
    own = {free.name: free.name.rpartition(".")[0] for free in found.problem.free}
    return effects, [it for it in found.problem.free if it.prior is None and own[it.name] != name]


def singles_of(fitter: Fitter, couples: Iterable[FittedModel]) -> list[FittedModel]:
    """Each effect of a pair alone, begun where the pair has ended: it may suffice."""
    return [without(fitter, couple, name) for couple in couples for name in couple.effects]
