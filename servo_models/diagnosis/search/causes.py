"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

An effect is taken only if it predicts blocks that its fit has not seen, and beside a pair
each half has to earn its place, also under conditions that were left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf, log

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.fitting.conditions import carried_over
from servo_models.diagnosis.fitting.evidence import Evidence
from servo_models.diagnosis.fitting.explanation import Bench, Explanation
from servo_models.diagnosis.fitting.worth import earns
from servo_models.diagnosis.search.attempts import Attempts, attempts
from servo_models.diagnosis.search.fits import (
    Tell,
    Teller,
    beside_each,
    best_of_each,
    settled,
    starts_of,
)
from servo_models.diagnosis.search.further import further
from servo_models.diagnosis.search.imitated import Imitated, imitated_effects
from servo_models.diagnosis.search.looks import narrowed
from servo_models.diagnosis.search.pairing import LESS, halves_of, lookalikes
from servo_models.diagnosis.search.reach import Reach, reaches
from servo_models.diagnosis.search.screening import Sight, promising, sights_of

TOLERANCE = 2.0
"""Gap in noise floors that counts as none."""
QUIET = 4
"""Effects that are fitted where nominal parameters leave noise only."""
FINALISTS, NEARLY = 3, 1.5
"""Explanations that are fitted on, if they leave less than this over the best."""
FINER, LONGER = 1e-6, 60
"""Relative tolerance and steps of these fits."""
HALVED = 2
"""Pairs of which each half is tried alone again."""
LEAST = 1.0
"""Movement of the outputs [RMS, noise floors] from which what parameters imitate is told."""


@dataclass(frozen=True, eq=False)
class Causes:
    """What was tried and what was taken.

    Attributes:
        before: the nominal model.
        retuned: nominal parameters alone.
        singles, pairs: explanations by one and by two effects, best first.
        more: by as many as were taken, where further ones were added to a pair.
        taken: the explanation that earns its place.
        reach: how far each effect can move the outputs, by its name.
        imitated: effects that may be there beside nominal parameters alone, if these were taken.
    """

    before: Evidence
    retuned: Explanation
    singles: list[Explanation]
    pairs: list[Explanation]
    more: list[Explanation]
    taken: Explanation
    reach: dict[str, Reach]
    imitated: Sequence[Imitated] = ()

    @property
    def alike(self) -> list[Explanation]:
        """Explanations by as many effects as were taken."""
        return self.more or (self.pairs if len(self.taken.effects) == 2 else self.singles)

    @property
    def fitted(self) -> dict[str, Explanation]:
        """By each effect that was fitted: alone, or else the best explanation that has it."""
        found: dict[str, Explanation] = {}
        for one in (*self.singles, *self.pairs, *self.more):
            for name in one.effects:
                found.setdefault(name, one)
        return found


def find_causes(
    bench: Bench,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
    tolerance: float = TOLERANCE,
) -> Causes:
    """Explain a gap by nominal parameters, by one effect, or by several.

    Args:
        bench: model, logs, priors and floors.
        left_out: effects that are not considered.
        tell: is told what goes on.
        tolerance: gap [noise floors] up to which there is nothing to explain.
    """
    say = Teller(tell) if tell else Teller()
    as_it_is = bench.unfitted()
    before = as_it_is.evidence
    if before.rms <= tolerance:
        return Causes(before, as_it_is, [], [], [], as_it_is, {})
    say("re-tuning nominal parameters")
    bench = bench.surveyed()
    retuned = bench.finish(bench.fit((), ()))
    # an effect with an uncertain size is one of the nominal ones, and free in every fit
    owners = {bench.model.plant.parameters[free.name].owner for free in bench.nominal}
    every = candidates(bench.model, bench.logs, owners.union(left_out))
    bench = replace(bench, trials={one.name: log(one.trials) for one in every})
    say(f"looking at {len(every)} effects")
    plain = [retuned]
    if not settled(retuned):
        nominal = {free.name: free.nominal for free in bench.nominal}
        plain.insert(0, bench.unfit((), (), nominal))
    sights = sights_of([it.view for it in plain], every)
    reach = reaches(sights, every)
    tried = _tried(bench, retuned, promising(sights), every, say)
    couples, more, taken = _explained(bench, retuned, tried, say)
    imitated: Sequence[Imitated] = ()
    if taken is retuned:
        say("looking for what re-tuned parameters imitate")
        imitated = imitated_effects(bench, retuned, sights, max(tolerance, LEAST))
    else:
        say(f"fitting {' and '.join(taken.effects)} to the end")
        taken = bench.finish(taken)
    return Causes(before, retuned, tried.singles, couples, more, taken, reach, imitated)


def _tried(
    bench: Bench,
    retuned: Explanation,
    sights: Sequence[Sight],
    every: Sequence[Candidate],
    say: Teller,
) -> Attempts:
    """Fits of one and of two effects, those to the end that leave least."""
    if settled(retuned):
        few = beside_each(bench, retuned, starts_of(sights, QUIET), say)
        found = Attempts(few, [], narrowed(every, sights))
    else:
        found = attempts(bench, retuned, sights, every, say)
    singles, couples, near = found
    better = [it for it in couples[:HALVED] if it.loss < LESS * singles[0].loss]
    singles = best_of_each([*singles, *halves_of(bench, better)])
    if not settled(retuned):
        say("fitting the best to the end")
        least = min((it.loss for it in (*singles, *couples)), default=inf)
        singles, couples = _finals(bench, singles, least), _finals(bench, couples, least)
    return Attempts(singles, couples, near)


def _explained(
    bench: Bench, retuned: Explanation, tried: Attempts, say: Teller
) -> tuple[list[Explanation], list[Explanation], Explanation]:
    """Explanations by two effects, by more, and the one that is taken."""
    couples = tried.couples
    taken = _taken(bench, retuned, tried.singles, couples)
    if len(taken.effects) < 2:
        return couples, [], taken
    more = further(bench, taken, couples, tried.near, say)
    if more:
        return couples, more, more[0]
    if not settled(taken):
        # beside a pair that leaves noise only they have been sought already
        couples = best_of_each([*couples, *lookalikes(bench, taken, tried.near, say)])
        taken = _taken(bench, retuned, tried.singles, couples)
    return couples, [], taken


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
