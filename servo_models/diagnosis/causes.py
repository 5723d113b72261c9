"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

An effect is taken only if it predicts blocks that its fit has not seen, and beside a pair
each half has to earn its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.evidence import Evidence, advantage, consistency
from servo_models.diagnosis.explanation import Bench, Explanation
from servo_models.diagnosis.screening import Sight, look, pairs
from servo_models.diagnosis.structure import left_over
from servo_models.identification.problem import Free

Tell = Callable[[str], None]

SINGLES, FEW = 10, 5
"""Effects fitted in full, and second ones where nothing is left to explain."""
STAIRCASES = 4
"""Those fitted of which the response is a staircase of the size, after a closer look."""
FIRSTS, SECONDS, PAIRS = 3, 4, 4
"""Effects that get a second one beside them, how many of those, and pairs seen together."""
SWAPS = 3
"""Effects that are tried in the place of one of a pair."""
HALVED = 2
"""Pairs of which each half is tried alone again."""
STARTS = 2
"""Sizes from which the fit of an effect begins, while it leaves more than was promised."""
PROMISED = 1.1
"""Squared errors over those that a look has promised, above which another start is made."""
AGAIN, HALF, SLOWLY = 4, 0.5, 0.98
"""Fits of a staircase at most, the share of the squared errors from which they are worth it,
and that from which another one is not."""
KEPT = 6
"""Sizes of a staircase or a ripple at which it is seen again beside another effect."""
SETTLED = 0.3
"""Structured part of the errors over the noise, below which nothing is left to explain."""
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
    open_question = not _settled(retuned)
    singles = _singles(bench, retuned, sights, SINGLES, say)
    if open_question and not _settled(singles[0]):
        say("looking closer at staircases")
        closer, _ = look((retuned.view,), [_finer(one) for one in every if one.fine])
        singles += _singles(bench, retuned, closer, STAIRCASES, say)
        singles = _best_of_each(singles)
        sights = sorted([*sights, *closer], key=lambda sight: sight.left)
    couples = _couples(bench, singles, sights, every, say) if open_question else []
    singles = _best_of_each([*singles, *_halves(bench, couples[:HALVED])])
    taken = _taken(retuned, singles, couples)
    if taken is not retuned:
        say(f"fitting {' and '.join(taken.effects)} to the end")
        taken = bench.finish(taken)
    return Causes(before, retuned, singles, couples, taken, reach)


def _settled(explanation: Explanation) -> bool:
    """Whether what is left is noise."""
    left = left_over(explanation.problem, explanation.evidence)
    return left.structured < SETTLED * left.noise


def _finer(one: Candidate) -> Candidate:
    return replace(one, sizes=one.fine)


def _nearer(one: Candidate, sights: Sequence[Sight]) -> Candidate:
    """Of the many sizes of a staircase or a ripple, those that were promising once."""
    if not (one.fine or one.ripple):
        return one
    keys = one.sizes[0].keys()
    own = [sight.settings for sight in sights if sight.candidate.name == one.name][:KEPT]
    return replace(one, sizes=tuple({key: it[key] for key in keys} for it in own))


def _singles(
    bench: Bench, retuned: Explanation, sights: Sequence[Sight], count: int, say: Tell
) -> list[Explanation]:
    """Fits of the most promising effects, best first."""
    found: list[Explanation] = []
    for name in _names(sights)[:count]:
        best = f", best so far {found[0].effects[0]}" if found else ""
        say(f"fitting {name}{best}")
        own = [sight for sight in sights if sight.candidate.name == name]
        found.append(beside(bench, retuned, own[:STARTS]))
        found.sort(key=lambda one: one.loss)
    return found


def _best_of_each(found: Iterable[Explanation]) -> list[Explanation]:
    """Explanations by different effects, best first."""
    best: dict[frozenset[str], Explanation] = {}
    for one in sorted(found, key=lambda one: one.loss):
        best.setdefault(frozenset(one.effects), one)
    return list(best.values())


def _names(sights: Iterable[Sight]) -> list[str]:
    return list(dict.fromkeys(sight.candidate.name for sight in sights))


def beside(bench: Bench, first: Explanation, own: Sequence[Sight]) -> Explanation:
    """Fit an effect beside those of ``first``, from sizes at which it was seen from there.

    It begins again from the next of them while it leaves more than a look has promised.
    """
    kept = [free for free in first.problem.free if free.prior is None]
    effects = (*first.effects, own[0].candidate.name)
    best: Explanation | None = None
    for sight in own:
        extra = [*kept, *sight.candidate.at(sight.settings)]
        found = bench.fit(effects, extra, sight.start, sight.seen.slopes)
        found = _polished(bench, found, first) if sight.candidate.fine else found
        if best is None or found.cost < best.cost:
            best = found
        if best.cost < PROMISED * sight.left:
            break
    assert best
    return best


def _polished(bench: Bench, found: Explanation, first: Explanation) -> Explanation:
    """Fit a promising staircase again while that helps: each fit moves its size a little."""
    for _ in range(AGAIN):
        if found.cost > HALF * first.cost:
            break
        before, found = found, bench.again(found)
        if found.cost > SLOWLY * before.cost:
            break
    return found


def together(bench: Bench, pair: Sequence[Sight]) -> Explanation:
    """Fit effects that were seen together."""
    names = tuple(sight.candidate.name for sight in pair)
    extra = [free for sight in pair for free in sight.candidate.at(sight.settings)]
    seen = pair[0].seen
    start = seen.start(sum((sight.whole for sight in pair), np.zeros(1)))
    return bench.fit(names, extra, start, seen.slopes)


def _couples(
    bench: Bench,
    singles: Sequence[Explanation],
    sights: Sequence[Sight],
    every: Sequence[Candidate],
    say: Tell,
) -> list[Explanation]:
    """Pairs seen together from the start, and second effects seen beside the best first ones.

    One that explains everything already needs no long search for a second.
    """
    settled = _settled(singles[0])
    found: list[Explanation] = []
    tried: set[frozenset[str]] = set()
    for pair in [] if settled else pairs(sights)[:PAIRS]:
        tried.add(frozenset(sight.candidate.name for sight in pair))
        say(f"fitting {' and '.join(sight.candidate.name for sight in pair)}")
        found.append(together(bench, pair))
    nearer = [_nearer(one, sights) for one in every]
    for first in singles[: 1 if settled else FIRSTS]:
        others = [one for one in nearer if one.name not in first.effects]
        seconds, _ = look((first.view,), others)
        for name in _names(seconds)[: FEW if settled else SECONDS]:
            names = (*first.effects, name)
            if frozenset(names) not in tried:
                tried.add(frozenset(names))
                say(f"fitting {' and '.join(names)}")
                own = [it for it in seconds if it.candidate.name == name]
                found.append(beside(bench, first, own[:STARTS]))
    found = _best_of_each(found)
    if found and not _settled(found[0]):
        found = _best_of_each([*found, *_swapped(bench, found[0], nearer, say)])
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
        for name in _names(seen)[:SWAPS]:
            say(f"fitting {kept} and {name} again")
            own = [it for it in seen if it.candidate.name == name]
            found.append(beside(bench, stays, own[:STARTS]))
    return found


def _own(couple: Explanation, name: str) -> list[Free]:
    """Free parameters of one effect of a pair."""
    free = couple.problem.free
    return [it for it in free if it.prior is None and it.name.startswith(f"{name}.")]


def _halves(bench: Bench, couples: Iterable[Explanation]) -> list[Explanation]:
    """Each effect of a pair alone, begun where the pair has ended: it may suffice."""
    found = []
    for couple in couples:
        for name in couple.effects:
            found.append(bench.fit((name,), _own(couple, name), couple.values))
    return found


def _taken(
    retuned: Explanation, singles: Sequence[Explanation], couples: Sequence[Explanation]
) -> Explanation:
    best = singles[0] if singles and _better(singles[0], retuned) else retuned
    for couple in couples:
        halves = [one for one in singles if set(one.effects) <= set(couple.effects)]
        if _better(couple, best) and all(_better(couple, half) for half in halves):
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
