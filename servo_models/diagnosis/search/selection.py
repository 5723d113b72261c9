"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

An effect is taken only if it predicts blocks that its fit has not seen, and beside a pair
each half has to earn its place, also under conditions that were left out.


What is fitted to explain a gap, and in which order: the smooth effects before staircases.

A staircase is looked for in thousands of simulations.  So these are spent only where no smooth
effect, and no pair of them, leaves noise only.


Further effects beside two: forward selection, with backward elimination after each step.

A fit with one more effect begins where that without it has ended.  Which of its rivals do as
well is asked once nothing more is added: each effect in turn is taken out and sought again.
Source: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd ed., sec. 3.3.


Pairs of effects: seen together, one beside another, and each sought again beside the other.

Fits of effects that a look has found promising: one beside others, or two together.

What is seen of effects beside those of a fit, at the sizes that may do something there.

Each size of each effect has been simulated where nominal parameters alone go.  As far as changes
add up, that tells what it would leave beside other effects, and only the likeliest are simulated
there.


Whether a fitted model earns its further parameters."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import inf, log
from typing import NamedTuple

import numpy as np

from servo_models.diagnosis.search.candidates import Candidate, Settings, candidates
from servo_models.diagnosis.search.crossval import CrossValidation, advantage, consistency
from servo_models.diagnosis.search.fitting import FittedModel, Fitter, leave_one_condition_out
from servo_models.diagnosis.search.grid_search import shortlist
from servo_models.diagnosis.search.linearisation import Linearisation
from servo_models.diagnosis.search.masking import MaskedEffect, masked_effects
from servo_models.diagnosis.search.residuals import sure
from servo_models.diagnosis.search.screening import (
    Detectability,
    Screened,
    Start,
    best_scales,
    best_start,
    moving,
    pairs,
    reaches,
    screen,
    screening_results,
)
from servo_models.identification.problem import Free

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
    as_it_is = replace(fitter, steps=None).unfitted()
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
    tried = _tried(fitter, retuned, moving(results), every, say)
    couples, more, taken = _explained(fitter, retuned, tried, say)
    masked: Sequence[MaskedEffect] = ()
    if taken is retuned:
        say("looking for what re-tuned parameters imitate")
        masked = masked_effects(fitter, retuned, results, max(tolerance, LEAST))
        taken = retuned = fitter.told(retuned)
    else:
        say(f"fitting {' and '.join(taken.effects)} to the end")
        retuned, taken = fitter.told(retuned), fitter.told(taken)
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


SINGLES, FIRST = 10, 4
"""Smooth effects fitted in full, and those of them that are fitted first."""
DISCONTINUOUS = 4
"""Those fitted of which the response is a staircase of the size."""
PART = 0.5
"""Part of what an effect closes that leaves noise only, which a look-alike has to promise."""
PAIRED = 0.5
"""Loss of a pair over that of the best effect, from which staircases are not sought beside that."""


class FirstFits(NamedTuple):
    """Fitted models by one and by two effects, best first, and every effect at promising sizes."""

    singles: list[FittedModel]
    couples: list[FittedModel]
    near: list[Candidate]


def first_fits(
    fitter: Fitter,
    retuned: FittedModel,
    results: Sequence[Screened],
    every: Sequence[Candidate],
    say: Teller,
) -> FirstFits:
    """Return fits of the most promising effects, one and two at a time.

    Where one fitted model leaves noise only, others are fitted if they may be its look-alikes.

    Args:
        fitter: model, logs, priors and floors.
        retuned: nominal parameters alone.
        results: of screening ``every`` effect, from the nominal model and from there.
        say: is told what goes on.
    """
    smooth = [it for it in results if not it.candidate.grid]
    singles, near, looks = _smooth(fitter, retuned, smooth, say), preselect(every, results), Looks()
    if any(map(settled, singles)):
        singles = _with_likely_discontinuous(fitter, retuned, results, singles, singles, say)
        couples = paired(fitter, singles, results, near, looks, say)
    else:
        plain = [one for one in near if not one.grid]
        couples = paired(fitter, singles, smooth, plain, looks, say)
        if any(map(settled, couples)):
            singles = _with_likely_discontinuous(fitter, retuned, results, singles, couples, say)
        else:
            closer = _closer(fitter, retuned, singles, results, every, say)
            results = sorted([*results, *closer], key=lambda result: result.left)
            near = preselect(every, results)
            discontinuous = beside_each(fitter, retuned, starts_of(closer, DISCONTINUOUS), say)
            singles = best_of_each([*singles, *discontinuous])
            couples = _paired_with_discontinuous(
                fitter, singles, couples, results, near, looks, say
            )
    if couples and couples[0].loss < LESS * singles[0].loss:
        couples = best_of_each([*couples, *swap(fitter, couples[0], near, say)])
    return FirstFits(singles, couples, near)


def _paired_with_discontinuous(
    fitter: Fitter,
    singles: Sequence[FittedModel],
    known: Sequence[FittedModel],
    results: Sequence[Screened],
    near: Sequence[Candidate],
    looks: Looks,
    say: Teller,
) -> list[FittedModel]:
    """Pairs with staircases too; these are sought anew beside the best effect, unless some pair
    leaves so much less that none beside it need be."""
    couples = paired(fitter, singles, results, near, looks, say, known)
    if not singles:
        return couples
    if any(it.loss < PAIRED * singles[0].loss or settled(it) for it in couples):
        return couples
    return best_of_each([*couples, *discontinuous_beside(fitter, singles[0], near, looks, say)])


def _smooth(
    fitter: Fitter, retuned: FittedModel, results: Sequence[Screened], say: Teller
) -> list[FittedModel]:
    """Fits of the most promising smooth effects, best first."""
    starts = list(starts_of(results, SINGLES))
    found = beside_each(fitter, retuned, starts[:FIRST], say)
    more = _likely(starts[FIRST:], retuned, found)
    return best_of_each([*found, *beside_each(fitter, retuned, more, say)])


def _with_likely_discontinuous(
    fitter: Fitter,
    retuned: FittedModel,
    results: Iterable[Screened],
    singles: Sequence[FittedModel],
    found: Sequence[FittedModel],
    say: Teller,
) -> list[FittedModel]:
    """Single effects with the staircases that may do what one of those ``found`` does."""
    discontinuous = starts_of([it for it in results if it.candidate.grid], DISCONTINUOUS)
    likely = _likely(discontinuous, retuned, found)
    return best_of_each([*singles, *beside_each(fitter, retuned, likely, say)])


def _closer(
    fitter: Fitter,
    retuned: FittedModel,
    singles: Sequence[FittedModel],
    results: Sequence[Screened],
    every: Sequence[Candidate],
    say: Teller,
) -> list[Screened]:
    """What is seen of staircases at the sizes that look best where the best fit has put the
    nominal parameters, from there and from where these alone go."""
    say("looking closer at staircases")
    best = min([retuned, *singles], key=lambda it: it.loss)
    beside_it = fitter.unfit((), (), best.values)
    near = [it for it in results if it.seen is retuned.linearised]
    short = shortlist(fitter, beside_it, every, near)
    return screen((retuned.linearised, beside_it.linearised), short)


def _likely(
    starts: Iterable[Seen], retuned: FittedModel, found: Sequence[FittedModel]
) -> Iterator[Seen]:
    """Effects that promise enough to be a look-alike of one that leaves noise only."""
    least = min((one.cost for one in found if settled(one)), default=-np.inf)
    enough = retuned.cost + PART * (least - retuned.cost) if np.isfinite(least) else np.inf
    return ((name, own) for name, own in starts if own[0].left < enough)


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
    ends = [it for it in others if it and _belongs(fitter, it.taken, taken, ENTRY_SHARE)]
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


Tell = Callable[[str], None]


@dataclass
class Teller:
    """Tells what goes on, with the best fitted model so far."""

    tell: Tell = lambda _: None
    best: FittedModel | None = None

    def __call__(self, text: str) -> None:
        if self.best:
            names, left = " and ".join(self.best.effects), self.best.evidence.rms
            text = f"{text}; best so far {names}, {left:.3g} noise floors"
        self.tell(text)

    def saw(self, one: FittedModel) -> None:
        if self.best is None or one.loss < self.best.loss:
            self.best = one


Task = tuple[str, Callable[[Fitter], FittedModel]]
"""What is fitted, in words, and how."""

Seen = tuple[str, list[Screened]]
"""An effect, and the sizes at which it was seen that promise most."""

TRIED, STARTS = 5, 2
"""Sizes of an effect that are simulated where a look puts the other parameters, and those from
which its fit begins, while it leaves more than was promised."""
PROMISED = 1.1
"""Squared errors over those that a look has promised, above which another start is made."""
FAR = 2.0
"""Squared errors of a start over those without the effect, above which no second fit is made."""
AGAIN, HALF, SLOWLY = 4, 0.5, 0.98
"""Fits of a staircase or a resonance at most, the share of the squared errors from which those of
a staircase are worth it, and that from which another one is not."""
SETTLED = 0.3
"""Structured part of the errors over the noise, below which nothing is left to explain."""


def beside(fitter: Fitter, first: FittedModel, own: Sequence[Screened]) -> FittedModel:
    """Fit an effect beside those of ``first``, from sizes at which it was seen from there.

    It begins where least is left, and again from the next while a look has promised less.  While
    something is left to explain, it begins with another shape, or half of a jump, as well.
    """
    kept = [free for free in first.problem.free if free.prior is None]
    effects = (*first.effects, own[0].candidate.name)
    best: FittedModel | None = None
    glances = (best_start([result], thorough=False) for result in own)
    begins = _unlike(sorted(glances, key=lambda it: it.cost))
    plain = len({_shape(it) for it in begins}) == 1
    for begin in (best_start(it.results) for it in begins[:STARTS]):
        if best and begin.cost > FAR * first.cost:
            break
        (result,) = begin.results
        found = fitter.fit(effects, [*kept, *begin.free], begin.values, result.seen.slopes)
        if found.cost < first.cost:
            found = _followed(fitter, found, kept, result.candidate)
        found = _polished(fitter, found, first) if result.candidate.discontinuous else found
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < PROMISED * min(it.left for it in own) and (settled(best) or plain):
            break
        if result.candidate.fastest and best.cost >= first.cost:
            break  # a resonance is slow to simulate, and from its best start it did nothing
    assert best
    for free, values in _half_jumps(begins[0], best) if own[0].candidate.jump else ():
        if settled(best):
            break
        found = fitter.fit(effects, [*kept, *free], values, begins[0].results[0].seen.slopes)
        best = min(best, found, key=lambda it: it.cost)
    return best


def _unlike(begins: Sequence[Start]) -> list[Start]:
    """The same with those of another shape than the first right after it."""
    first, *others = begins
    return [first, *sorted(others, key=lambda it: _shape(it) == _shape(first))]


def _shape(begin: Start) -> Hashable:
    return begin.results[0].candidate.shape_at(begin.results[0].settings)


def _half_jumps(
    begin: Start, found: FittedModel
) -> Iterator[tuple[tuple[Free, ...], dict[str, float]]]:
    """Two starts at half of the jump, as parameters of the effect and values [SI] of the others:
    at the size that was seen, and at that which loses as much beyond the jump as a fit does.

    Neither suffices: between sizes and parts of a jump are ridges.
    """
    (result,) = begin.results
    one = result.candidate
    assert one.jump
    switch, half = one.free[0], 0.5 * one.jump.high
    seen = best_start([replace(result, settings={**result.settings, one.jump.name: half})])
    yield seen.free, seen.values
    lost = found.values[switch.name] * (1.0 - found.values[one.jump.name])
    size = min(max(lost / (1.0 - half), switch.low), switch.high)
    own = {switch.name: size, one.jump.name: half}
    yield one.at(own), {**found.values, **own}


def _followed(
    fitter: Fitter, found: FittedModel, kept: Sequence[Free], one: Candidate
) -> FittedModel:
    """Fit on where an effect stopped at the end of its reach, and can be reached from there."""
    for _ in range(AGAIN):
        further = [*kept, *one.at(found.values)]
        own = slice(-len(further), None)
        sides = found.problem.sides(found.evidence.vector)[own]
        if not any(map(_opened, sides, found.problem.free[own], further)):
            break
        before, found = found, fitter.fit(found.effects, further, found.values)
        if found.cost > SLOWLY * before.cost:
            break
    return found


def _opened(side: str, before: Free, after: Free) -> bool:
    """Whether the bound on which a parameter lies has moved."""
    if side == "low":
        return after.low < before.low
    return side == "high" and after.high > before.high


def _polished(fitter: Fitter, found: FittedModel, first: FittedModel) -> FittedModel:
    """Fit a promising staircase again while that helps: each fit moves its size a little."""
    for _ in range(AGAIN):
        if found.cost > HALF * first.cost:
            break
        before, found = found, fitter.again(found)
        if found.cost > SLOWLY * before.cost:
            break
    return found


def side_by_side(fitter: Fitter, tasks: Sequence[Task], say: Teller) -> Iterator[FittedModel]:
    """Yield fits in the order of their names, found together."""
    found = fitter.workers.map(lambda task: task[1](fitter), tasks)
    for name, _ in tasks:
        say(f"fitting {name}")
        one = next(found)
        say.saw(one)
        yield one


def beside_each(
    fitter: Fitter, first: FittedModel, starts: Iterable[Seen], say: Teller
) -> list[FittedModel]:
    """Fits of some effects, each beside those of ``first``, best first."""
    tasks = [(name, partial(beside, first=first, own=own)) for name, own in starts]
    return best_of_each(side_by_side(fitter, tasks, say))


def together(fitter: Fitter, pair: Sequence[Screened]) -> FittedModel:
    """Fit effects that were seen together."""
    names = tuple(result.candidate.name for result in pair)
    begin = best_start(pair)
    return fitter.fit(names, begin.free, begin.values, pair[0].seen.slopes)


def settled(fitted_model: FittedModel) -> bool:
    """Whether what is left is noise."""
    return fitted_model.left.structured < SETTLED * fitted_model.left.noise


def best_of_each(found: Iterable[FittedModel]) -> list[FittedModel]:
    """Fitted models by different effects, best first."""
    best: dict[frozenset[str], FittedModel] = {}
    for one in sorted(found, key=lambda one: one.loss):
        best.setdefault(frozenset(one.effects), one)
    return list(best.values())


def names_of(results: Iterable[Screened]) -> list[str]:
    return list(dict.fromkeys(result.candidate.name for result in results))


def starts_of(results: Sequence[Screened], count: int | None = None) -> Iterator[Seen]:
    """The effects seen first, each with the sizes from which its fit begins."""
    for name in names_of(results)[:count]:
        yield name, likeliest([result for result in results if result.candidate.name == name])


def likeliest(own: Sequence[Screened]) -> list[Screened]:
    """Of the sizes of one effect, best first, those that are worth a simulation.

    A fit finds the size, but hardly another shape: of each shape the best size is one of them.
    """
    best: dict[Hashable, Screened] = {}
    for result in own:
        best.setdefault(result.candidate.shape_at(result.settings), result)
    first = list(best.values())
    return [*first, *(it for it in own if it not in first)][:TRIED]


SIZES = 6
"""Sizes at which an effect is seen again beside others."""


def preselect(every: Iterable[Candidate], results: Sequence[Screened]) -> list[Candidate]:
    """Return effects with what ``results``, best first, have shown of their sizes alone.

    Of the thousands of sizes of a staircase, those stay that were promising once.  Others keep all:
    alone, each takes the size that imitates what is missing as well.
    """
    found = []
    for one in every:
        own = [result for result in results if result.candidate.name == one.name]
        first = {_place(one, it.settings): it for it in reversed(own)}
        if one.grid and own:
            sizes = {_place(one, it.settings): it.settings for it in own}
            found.append(replace(one, trial_values=tuple(sizes.values())[:SIZES]))
        elif one.discontinuous or not own:
            found.append(one)
        else:
            none = np.zeros_like(own[0].columns)
            known = (first.get(_place(one, size)) for size in one.trial_values)
            found.append(replace(one, alone=tuple(it.columns if it else none for it in known)))
    return found


def _place(one: Candidate, settings: Settings) -> Hashable:
    """Which of its sizes some settings are: of a ripple they come with another size and phase."""
    return tuple(it for it in settings.items() if it[0] not in (one.ripple or ()))


def seen_beside(first: FittedModel, every: Iterable[Candidate]) -> list[Screened]:
    """Return what is seen of other effects beside those of ``first``, best first."""
    others = [
        _at_likely_sizes(first.linearised, one) for one in every if one.name not in first.effects
    ]
    return screen((first.linearised,), others)


def _at_likely_sizes(seen: Linearisation, one: Candidate) -> Candidate:
    """An effect at the sizes that would leave least from there if changes add up."""
    if len(one.alone) <= SIZES:
        return one
    left, _ = best_scales(seen, [one] * len(one.alone), one.alone)
    best = np.argsort(left, kind="stable")[:SIZES]
    return replace(one, trial_values=tuple(one.trial_values[i] for i in sorted(best)), alone=())


class Looks:
    """What is seen of effects beside fitted models, at the same sizes only once.

    Of smooth effects the sizes are kept from which a fit may begin: every one holds a response.
    """

    def __init__(self) -> None:
        self._known: dict[Hashable, list[Screened]] = {}

    def beside(self, first: FittedModel, every: Iterable[Candidate]) -> list[Screened]:
        """Return the same as ``seen_beside``."""
        keys = {_key(first, one): one for one in every if one.name not in first.effects}
        new = {one.name: key for key, one in keys.items() if key not in self._known}
        self._known |= {key: [] for key in new.values()}
        found = seen_beside(first, [keys[key] for key in new.values()])
        for name in names_of(found):
            own = [result for result in found if result.candidate.name == name]
            self._known[new[name]] = own if own[0].candidate.discontinuous else likeliest(own)
        known = chain.from_iterable(self._known[key] for key in keys)
        return sorted(known, key=lambda result: result.left)


def _key(first: FittedModel, one: Candidate) -> Hashable:
    """An effect at its sizes, seen from a fit."""
    return first, one.name, tuple(tuple(size.items()) for size in one.trial_values)


ENTRY_ADVANTAGE = 20.0
"""Twice the log likelihood ratio by which an effect has to predict unseen blocks better, beyond
what the best of so many trials does by chance."""
ENTRY_PROBABILITY = 0.05
"""Probability that so many blocks favour it by chance."""
ENTRY_SHARE, ENTRY_SHARE_ON_BOUND = 0.02, 0.2
"""Share of the error left [mean square] that an effect has to take away at least, and one that
a bound holds back: what it imitates may be another effect."""


def passes_entry_test(one: FittedModel, other: FittedModel, worth: float = ENTRY_SHARE) -> bool:
    """Return whether ``one`` predicts what its fit has not seen surely better than ``other``.

    ``worth`` is the share of the squared errors that it has to take away.
    """
    if one.held_by_bound and not other.held_by_bound:
        worth = max(worth, ENTRY_SHARE_ON_BOUND)
    trials = 2.0 * max(one.chance - other.chance, 0.0)
    by_chance = not sure(other.left)
    saved = 1.0 - one.loss / other.loss if other.loss > 0.0 else 0.0
    return (
        saved > worth
        and advantage(one.evidence, other.evidence, by_chance) > ENTRY_ADVANTAGE + trials
        and consistency(one.evidence, other.evidence) < ENTRY_PROBABILITY
    )
