"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

An effect is taken only if it predicts blocks that its fit has not seen, and beside a pair
each half has to earn its place, also under conditions that were left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import log

from servo_models.diagnosis.candidates import candidates
from servo_models.diagnosis.conditions import carried_over
from servo_models.diagnosis.evidence import Evidence, advantage, consistency
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.fits import (
    Tell,
    beside,
    best_of_each,
    settled,
    side_by_side,
    starts_of,
)
from servo_models.diagnosis.pairing import couples_of, halves_of
from servo_models.diagnosis.screening import Sight, look
from servo_models.diagnosis.staircases import shortlist

SINGLES = 10
"""Effects fitted in full."""
STAIRCASES = 4
"""Those fitted of which the response is a staircase of the size, after a closer look."""
FINALISTS, NEARLY = 5, 2.0
"""Explanations that are fitted on, if they leave less than this over the best."""
FINER, LONGER = 1e-6, 60
"""Relative tolerance and steps of these fits."""
HALVED = 2
"""Pairs of which each half is tried alone again."""
LIKELY = 20.0
"""Twice the log likelihood ratio by which an effect has to predict unseen blocks better."""
BY_CHANCE = 0.05
"""Probability that so many blocks favour it by chance."""
WORTH = 0.02
"""Share of the error left [mean square] that an effect has to take away at least."""


@dataclass(frozen=True, eq=False)
class Causes:
    """What was tried and what was taken.

    Attributes:
        before: the nominal model.
        retuned: nominal parameters alone.
        singles, pairs: explanations by one and by two effects, best first.
        taken: the explanation that earns its place.
        reach: how far each effect can move the outputs [noise floors].
    """

    before: Evidence
    retuned: Explanation
    singles: list[Explanation]
    pairs: list[Explanation]
    taken: Explanation
    reach: dict[str, float]


def find_causes(
    bench: Bench,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
    tolerance: float = 0.0,
) -> Causes:
    """Explain a gap by nominal parameters, by one effect, or by two.

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
        return Causes(before, as_it_is, [], [], as_it_is, {})
    say("re-tuning nominal parameters")
    bench = bench.surveyed()
    retuned = bench.finish(bench.fit((), ()))
    every = candidates(bench.model, bench.logs, left_out)
    bench = replace(bench, trials={one.name: log(one.trials) for one in every})
    say(f"looking at {len(every)} effects")
    sights, reach = look((bench.view(), retuned.view), every)
    open_question = not settled(retuned)
    singles = _singles(bench, retuned, sights, SINGLES, say)
    if open_question and not settled(singles[0]):
        say("looking closer at staircases")
        closer, _ = look((retuned.view,), shortlist(bench, retuned, every))
        singles += _singles(bench, retuned, closer, STAIRCASES, say)
        singles = best_of_each(singles)
        sights = sorted([*sights, *closer], key=lambda sight: sight.left)
    couples = couples_of(bench, singles, sights, every, say) if open_question else []
    singles = best_of_each([*singles, *halves_of(bench, couples[:HALVED])])
    if open_question:
        say("fitting the best to the end")
        singles, couples = _finals(bench, singles), _finals(bench, couples)
    taken = _taken(bench, retuned, singles, couples)
    if taken is not retuned:
        say(f"fitting {' and '.join(taken.effects)} to the end")
        taken = bench.finish(taken)
    return Causes(before, retuned, singles, couples, taken, reach)


def _singles(
    bench: Bench, retuned: Explanation, sights: Sequence[Sight], count: int, say: Tell
) -> list[Explanation]:
    """Fits of the most promising effects, best first."""
    tasks = []
    for name, own in starts_of(sights, count):
        tasks.append((name, partial(beside, first=retuned, own=own)))
    return sorted(side_by_side(bench, tasks, say), key=lambda one: one.loss)


def _finals(bench: Bench, found: Sequence[Explanation]) -> list[Explanation]:
    """The same with those near the best fitted on: a short search may have stopped short."""
    near = [it for it in found[:FINALISTS] if it.loss < NEARLY * found[0].loss]
    further = [bench.again(it, FINER, LONGER) for it in near if not settled(it)]
    return best_of_each([*further, *found])


def _taken(
    bench: Bench,
    retuned: Explanation,
    singles: Sequence[Explanation],
    couples: Sequence[Explanation],
) -> Explanation:
    best = singles[0] if singles and _better(singles[0], retuned) else retuned
    lost: float | None = None
    for couple in couples:
        halves = [one for one in singles if set(one.effects) <= set(couple.effects)]
        if _better(couple, best) and all(_better(couple, half) for half in halves):
            lost = carried_over(bench, best) if lost is None else lost
            if carried_over(bench, couple) <= lost:
                return couple
    return best


def _better(one: Explanation, other: Explanation) -> bool:
    """Whether ``one`` earns its further parameters."""
    saved = 1.0 - one.loss / other.loss if other.loss > 0.0 else 0.0
    return (
        saved > WORTH
        and advantage(one.evidence, other.evidence) > LIKELY
        and consistency(one.evidence, other.evidence) < BY_CHANCE
    )
