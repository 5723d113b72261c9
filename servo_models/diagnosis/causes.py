"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

An effect is taken only if it predicts blocks that its fit has not seen, and beside a pair
each half has to earn its place, also under conditions that were left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import log

import numpy as np

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.conditions import carried_over
from servo_models.diagnosis.evidence import Evidence
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.fits import (
    Seen,
    Tell,
    beside,
    best_of_each,
    settled,
    side_by_side,
    starts_of,
)
from servo_models.diagnosis.further import further
from servo_models.diagnosis.pairing import LESS, couples_of, halves_of, narrowed
from servo_models.diagnosis.screening import Sight, look
from servo_models.diagnosis.staircases import shortlist
from servo_models.diagnosis.worth import earns

SINGLES, FIRST, QUIET = 10, 4, 4
"""Effects fitted in full, those of them that are fitted first, and all of them where nominal
parameters leave noise only."""
PART = 0.5
"""Part of what an effect closes that leaves noise only, which a look-alike has to promise."""
STAIRCASES = 4
"""Those fitted of which the response is a staircase of the size, after a closer look."""
FINALISTS, NEARLY = 5, 2.0
"""Explanations that are fitted on, if they leave less than this over the best."""
FINER, LONGER = 1e-6, 60
"""Relative tolerance and steps of these fits."""
HALVED = 2
"""Pairs of which each half is tried alone again."""


@dataclass(frozen=True, eq=False)
class Causes:
    """What was tried and what was taken.

    Attributes:
        before: the nominal model.
        retuned: nominal parameters alone.
        singles, pairs: explanations by one and by two effects, best first.
        more: by as many as were taken, where further ones were added to a pair.
        taken: the explanation that earns its place.
        reach: how far each effect can move the outputs [noise floors].
    """

    before: Evidence
    retuned: Explanation
    singles: list[Explanation]
    pairs: list[Explanation]
    more: list[Explanation]
    taken: Explanation
    reach: dict[str, float]

    @property
    def alike(self) -> list[Explanation]:
        """Explanations by as many effects as were taken."""
        return self.more or (self.pairs if len(self.taken.effects) == 2 else self.singles)


def find_causes(
    bench: Bench,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
    tolerance: float = 0.0,
) -> Causes:
    """Explain a gap by nominal parameters, by one effect, or by several.

    Args:
        bench: model, logs, priors and floors.
        left_out: effects that are not considered.
        tell: is told what goes on.
        tolerance: gap [noise floors] up to which there is nothing to explain.
    """
    say = tell or (lambda _: None)
    as_it_is = bench.unfitted()
    before = as_it_is.evidence
    if before.rms <= tolerance:
        return Causes(before, as_it_is, [], [], [], as_it_is, {})
    say("re-tuning nominal parameters")
    bench = bench.surveyed()
    retuned = bench.finish(bench.fit((), ()))
    every = candidates(bench.model, bench.logs, left_out)
    bench = replace(bench, trials={one.name: log(one.trials) for one in every})
    say(f"looking at {len(every)} effects")
    open_question = not settled(retuned)
    plain = [retuned]
    if open_question:
        nominal = {free.name: free.nominal for free in bench.nominal}
        plain.insert(0, bench.unfit((), (), nominal))
    sights, reach = look([it.view for it in plain], every)
    if open_question:
        singles, sights = _singles(bench, retuned, sights, every, say)
    else:
        singles = _fitted(bench, retuned, starts_of(sights, QUIET), say)
    near = narrowed(every, sights)
    couples = couples_of(bench, singles, sights, near, say) if open_question else []
    better = [it for it in couples[:HALVED] if it.loss < LESS * singles[0].loss]
    singles = best_of_each([*singles, *halves_of(bench, better)])
    if open_question:
        say("fitting the best to the end")
        least = min(it.loss for it in (*singles, *couples))
        singles, couples = _finals(bench, singles, least), _finals(bench, couples, least)
    taken = _taken(bench, retuned, singles, couples)
    more = further(bench, taken, couples, near, say) if len(taken.effects) > 1 else []
    taken = more[0] if more else taken
    if taken is not retuned:
        say(f"fitting {' and '.join(taken.effects)} to the end")
        taken = bench.finish(taken)
    return Causes(before, retuned, singles, couples, more, taken, reach)


def _singles(
    bench: Bench,
    retuned: Explanation,
    sights: list[Sight],
    every: Sequence[Candidate],
    say: Tell,
) -> tuple[list[Explanation], list[Sight]]:
    """Fits of the most promising effects, best first, and all that was seen of any.

    Where one leaves noise only, the others are fitted if they may be its look-alikes.
    """
    smooth = list(starts_of([it for it in sights if not it.candidate.fine], SINGLES))
    found = _fitted(bench, retuned, smooth[:FIRST], say)
    found += _fitted(bench, retuned, _likely(smooth[FIRST:], retuned, found), say)
    if any(map(settled, found)):
        stairs = starts_of([it for it in sights if it.candidate.fine], STAIRCASES)
        found += _fitted(bench, retuned, _likely(stairs, retuned, found), say)
    else:
        say("looking closer at staircases")
        best = min([retuned, *found], key=lambda it: it.loss)
        beside_it = bench.unfit((), (), best.values)
        closer = _closer(bench, (retuned, beside_it), sights, every)
        found += _fitted(bench, retuned, starts_of(closer, STAIRCASES), say)
        sights = sorted([*sights, *closer], key=lambda sight: sight.left)
    return best_of_each(found), sights


def _closer(
    bench: Bench,
    plain: tuple[Explanation, Explanation],
    sights: Sequence[Sight],
    every: Sequence[Candidate],
) -> list[Sight]:
    """What is seen of staircases from the first and second of ``plain``, at the sizes that look
    best from the second, best first."""
    first, second = plain
    near = [it for it in sights if it.seen is first.view]
    short = shortlist(bench, second, every, near)
    return look((first.view, second.view), short)[0]


def _likely(
    starts: Iterable[Seen], retuned: Explanation, found: Sequence[Explanation]
) -> Iterator[Seen]:
    """Effects that promise enough to be a look-alike of one that leaves noise only."""
    least = min((one.cost for one in found if settled(one)), default=-np.inf)
    enough = retuned.cost + PART * (least - retuned.cost) if np.isfinite(least) else np.inf
    return ((name, own) for name, own in starts if own[0].left < enough)


def _fitted(
    bench: Bench, retuned: Explanation, starts: Iterable[Seen], say: Tell
) -> list[Explanation]:
    """Fits of some effects, best first."""
    tasks = [(name, partial(beside, first=retuned, own=own)) for name, own in starts]
    return best_of_each(side_by_side(bench, tasks, say))


def _finals(bench: Bench, found: Sequence[Explanation], least: float) -> list[Explanation]:
    """The same with those near the least loss fitted on: a search may have stopped short."""
    near = [it for it in found[:FINALISTS] if it.loss < NEARLY * least]
    further = [bench.again(it, FINER, LONGER) for it in near if not settled(it)]
    return best_of_each([*further, *found])


def _taken(
    bench: Bench,
    retuned: Explanation,
    singles: Sequence[Explanation],
    couples: Sequence[Explanation],
) -> Explanation:
    best = singles[0] if singles and earns(singles[0], retuned) else retuned
    lost: float | None = None
    for couple in couples:
        halves = [one for one in singles if set(one.effects) <= set(couple.effects)]
        if earns(couple, best) and all(earns(couple, half) for half in halves):
            lost = carried_over(bench, best) if lost is None else lost
            if carried_over(bench, couple) <= lost:
                return couple
    return best
