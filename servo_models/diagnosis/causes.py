"""Which effects explain a gap: fits of the promising ones, singly and in pairs, judged held out.

Nominal parameters stay free inside their priors in every fit, since frozen ones invent
effects.  An effect is taken only if it predicts blocks that its fit has not seen, and
beside a pair each half has to earn its place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.candidates import Candidate, candidates
from servo_models.diagnosis.evidence import Evidence, advantage, blocks, consistency, judge
from servo_models.diagnosis.screening import Sight, look, pairs
from servo_models.identification.problem import Free, Problem
from servo_models.identification.search import descend
from servo_models.recording import Log
from servo_models.simulate import Model

Array = NDArray[np.float64]
Tell = Callable[[str], None]

SINGLES, FIRSTS, SECONDS, PAIRS = 8, 2, 3, 4
"""Effects fitted in full, how many of them get a second one beside them and how many of
those, and pairs."""
LOOKED_AT = 40
"""Sights from which pairs are made."""
ENOUGH, STEPS = 1e-4, 15
"""Relative tolerance and steps of a fit: differences between effects are larger."""
LIKELY = 20.0
"""Twice the log likelihood ratio by which an effect has to predict unseen blocks better."""
BY_CHANCE = 0.05
"""Probability that so many blocks favour it by chance."""
UNEXPLAINED = 1.5
"""Error left, in noise floors, above which something may be missing."""
DISGUISE = 1.25
"""Factor on the squared errors that an effect on its bound leaves."""
WORTH = 0.02
"""Share of the error left [mean square] that an effect has to take away at least."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A fit with some effects switched on.

    Attributes:
        effects: their names, none for nominal parameters alone.
        problem: with all free parameters.
        evidence: how it predicts.
        converged: whether the search met its tolerance.
    """

    effects: tuple[str, ...]
    problem: Problem
    evidence: Evidence
    converged: bool

    @property
    def values(self) -> dict[str, float]:
        """Free parameters [SI] by name."""
        return self.problem.values(self.evidence.vector)

    @cached_property
    def disguised(self) -> bool:
        """Whether a parameter of an effect sits on a bound: another effect may look so."""
        sides = self.problem.sides(self.evidence.vector)
        free = self.problem.free
        return any(side and one.prior is None for side, one in zip(sides, free))

    @cached_property
    def loss(self) -> float:
        """Sum of squared unseen errors; larger for a disguise, which yields to a plain effect."""
        return float(self.evidence.losses.sum()) * (DISGUISE if self.disguised else 1.0)


@dataclass(frozen=True, eq=False)
class Bench:
    """What every fit of a diagnosis shares.

    Attributes:
        model, logs: of the diagnosis.
        nominal: parameters with a prior, free in every fit.
        floors: noise floor [SI] of each output, its weight.
        jobs: simulations at once.
    """

    model: Model
    logs: Sequence[Log]
    nominal: tuple[Free, ...]
    floors: dict[str, float]
    jobs: int

    def problem(self, extra: Iterable[Free] = ()) -> Problem:
        """Return the question with further free parameters."""
        free = [*self.nominal, *extra]
        return Problem(self.model, self.logs, free, sigma=dict(self.floors), jobs=self.jobs)

    def fit(
        self, effects: tuple[str, ...], extra: Sequence[Free], start: Explanation | None = None
    ) -> Explanation:
        """Fit from the estimates of ``start``, further parameters from their own starts."""
        problem = self.problem(extra)
        if start:
            known = start.values
            begin = [known.get(free.name, free.start) for free in problem.free]
            low, high = problem.bounds
            problem.restart(np.clip(np.array(begin) / problem.scales, low, high))
        if not problem.free:
            vector, converged = np.empty(0), True
        else:
            _, vector, converged = descend(problem, problem.start, tolerance=ENOUGH, limit=STEPS)
        return Explanation(effects, problem, judge(problem, vector, blocks(problem)), converged)

    def finish(self, found: Explanation) -> Explanation:
        """Fit to the end: what the logs leave open goes back to its prior."""
        problem = found.problem
        if not problem.free:
            return found
        _, vector, converged = descend(problem, found.evidence.vector)
        evidence = judge(problem, vector, blocks(problem))
        return replace(found, evidence=evidence, converged=converged)


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
    nominal = bench.problem()
    errors = nominal.residuals(nominal.nominal)[: nominal.samples]
    before = Evidence(nominal.nominal, errors, errors, blocks(nominal))  # no fit, all is unseen
    if before.rms <= tolerance:
        as_it_is = Explanation((), nominal, before, converged=True)
        return Causes(before, as_it_is, [], [], as_it_is, {})
    say("re-tuning nominal parameters")
    retuned = bench.fit((), ())
    every = candidates(bench.model, left_out)
    say(f"looking at {len(every)} effects")
    sights, reach = look(retuned.problem, retuned.evidence.vector, every)
    singles = _fitted(bench, [(one,) for one in _distinct(sights)[:SINGLES]], retuned, say)
    couples: list[Explanation] = []
    if singles and (_better(singles[0], retuned) or retuned.evidence.rms > UNEXPLAINED):
        couples = _couples(bench, retuned, singles, sights, every, say)
    taken = _taken(retuned, singles, couples)
    say(f"fitting {' and '.join(taken.effects) or 'nominal parameters'} to the end")
    taken = bench.finish(taken)
    return Causes(before, retuned, singles, couples, taken, reach)


def _couples(
    bench: Bench,
    retuned: Explanation,
    singles: Sequence[Explanation],
    sights: Sequence[Sight],
    every: Sequence[Candidate],
    say: Tell,
) -> list[Explanation]:
    """Pairs seen together from the start, and second effects seen beside the best first ones."""
    by_name = {one.name: one for one in every}
    wanted = pairs(retuned.problem, retuned.evidence.vector, sights[:LOOKED_AT])[:PAIRS]
    chosen: dict[frozenset[str], tuple[Sight, ...]] = {
        frozenset(s.candidate.name for s in pair): pair for pair in wanted
    }
    found = _fitted(bench, list(chosen.values()), retuned, say)
    tried = set(chosen)
    for first in singles[:FIRSTS]:
        others = [one for one in every if one.name not in first.effects]
        seconds, _ = look(first.problem, first.evidence.vector, others)
        for sight in _distinct(seconds)[:SECONDS]:
            names = (*first.effects, sight.candidate.name)
            if frozenset(names) in tried:
                continue
            tried.add(frozenset(names))
            say(f"fitting {' and '.join(names)}")
            kept = by_name[first.effects[0]].at(first.values)
            extra = (*kept, *sight.candidate.at(sight.settings))
            found.append(bench.fit(names, extra, first))
    return sorted(found, key=lambda one: one.loss)


def _fitted(
    bench: Bench, wanted: Iterable[tuple[Sight, ...]], start: Explanation, say: Tell
) -> list[Explanation]:
    found: list[Explanation] = []
    for sights in wanted:
        names = tuple(sight.candidate.name for sight in sights)
        best = f", best so far {found[0].effects[0]}" if found else ""
        say(f"fitting {' and '.join(names)}{best}")
        extra = [free for sight in sights for free in sight.candidate.at(sight.settings)]
        found.append(bench.fit(names, extra, start))
        found.sort(key=lambda one: one.loss)
    return found


def _distinct(sights: Iterable[Sight]) -> list[Sight]:
    """The best size of each effect."""
    best: dict[str, Sight] = {}
    for sight in sights:
        best.setdefault(sight.candidate.name, sight)
    return list(best.values())


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
