"""Fits of effects that a look has found promising: one beside others, or two together."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.fitted_model import FittedModel, Fitter
from servo_models.diagnosis.search.screening import Screened
from servo_models.diagnosis.search.starts import Start, best_start
from servo_models.identification.problem import Free

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
