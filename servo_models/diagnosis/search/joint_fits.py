"""Fit an effect beside others, from where screening leads.

Screening is linear: it takes a share of the change that an effect makes at one trial value, and
moves the other parameters along their slopes.  The effect at that value, at the share of it, and
the other parameters there are simulated before a fit of dozens of simulations begins.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

from servo_models.diagnosis.search.fitting import HOPELESS_RATIO, FittedModel, Fitter
from servo_models.diagnosis.search.screening import Screened
from servo_models.identification.problem import Free

MOST_REFITS = 4  # further fits of a discontinuous effect
REFIT_COST = 0.5  # cost with a discontinuous effect over without, below which it is fitted again
SLOW_COST_RATIO = 0.98  # cost of a fit over the one before, above which it is the last


def fit_with(
    fitter: Fitter, first: FittedModel, results: Sequence[Screened], enough: float = inf
) -> FittedModel:
    """Fit an effect beside those of ``first``, from its results of screening there.

    It begins where least is left, and while something is left to explain, with another shape and
    with half of a jump as well.  A fit that cannot leave ``enough`` squared errors ends early.
    """
    kept = first.own
    effects = (*first.effects, results[0].candidate.name)
    glances = [best_start(result, thorough=False) for result in results]
    result = min(glances, key=lambda start: start.cost).result
    begin, slopes = best_start(result), result.linearised.slopes
    best = fitter.fit(effects, [*kept, *begin.free], begin.values, slopes, enough=enough)
    best = _polished(fitter, best, first) if result.candidate.discontinuous else best
    further = [(it.free, it.values) for it in _other_shapes(glances, result)]
    further += _half_jumps(begin, best) if result.candidate.jump else ()
    for free, values in further:
        if best.settled or best.cost > HOPELESS_RATIO * enough:
            break
        race = min(enough, best.cost)
        fitted = fitter.fit(effects, [*kept, *free], values, slopes, enough=race)
        best = min(best, fitted, key=lambda it: it.cost)
    return best


def _other_shapes(glances: Iterable[Start], first: Screened) -> Iterator[Start]:
    """The best start of another shape than the first one, to which no slope may lead."""
    shape = first.candidate.shape_at(first.settings)
    others = [it for it in glances if first.candidate.shape_at(it.result.settings) != shape]
    if others:
        yield best_start(min(others, key=lambda start: start.cost).result)


def _half_jumps(
    begin: Start, fitted: FittedModel
) -> Iterator[tuple[tuple[Free, ...], dict[str, float]]]:
    """Two starts at half of the jump, as parameters of the effect and values [SI] of the others:
    at the size that was screened, and at that which loses as much beyond the jump as a fit does.

    Neither suffices: between sizes and parts of a jump are ridges.
    """
    candidate, result = begin.result.candidate, begin.result
    assert candidate.jump
    switch, half = candidate.free[0], 0.5 * candidate.jump.high
    start = best_start(replace(result, settings={**result.settings, candidate.jump.name: half}))
    yield start.free, start.values
    lost = fitted.values[switch.name] * (1.0 - fitted.values[candidate.jump.name])
    size = min(max(lost / (1.0 - half), switch.low), switch.high)
    sizes = {switch.name: size, candidate.jump.name: half}
    yield candidate.at(sizes), {**fitted.values, **sizes}


def _polished(fitter: Fitter, model: FittedModel, first: FittedModel) -> FittedModel:
    """Fit a promising discontinuous effect again while that helps: its value moves a little each
    time."""
    for _ in range(MOST_REFITS):
        if model.cost > REFIT_COST * first.cost:
            break
        before, model = model, fitter.refit(model)
        if model.cost > SLOW_COST_RATIO * before.cost:
            break
    return model


@dataclass(frozen=True, eq=False)
class Start:
    """Where a fit may begin.

    Attributes:
        result: result of screening the effect.
        free: parameters of the effect, with their starts.
        values: estimates [SI] of the other parameters.
        cost: squared errors that are left there, priors included.
    """

    result: Screened
    free: tuple[Free, ...]
    values: dict[str, float]
    cost: float


def best_start(result: Screened, thorough: bool = True) -> Start:
    """Return the best start of a fit of an effect that was screened at one size.

    Other parameters are tried where they make up for the whole effect only, unless ``thorough``.
    """
    scales = (1.0,) if result.share in (0.0, 1.0) else (1.0, result.share)
    return min((_start(result, it, thorough) for it in scales), key=lambda start: start.cost)


def _start(result: Screened, scale: float, thorough: bool) -> Start:
    """The start with the effect at so many times the size at which it was screened."""
    linear, free = result.linearised, result.candidate.at(result.at(scale))
    sizes = {parameter.name: parameter.start for parameter in free}
    shares = [scale / result.share if result.share else 0.0, *((1.0, 0.0) if thorough else ())]
    changes = [share * result.whole for share in dict.fromkeys(shares)]
    tried = [linear.start(change) for change in changes]
    if thorough:
        stays = linear.problem.values(linear.vector)
        tried += [stays, *(linear.near_start(change) for change in changes)]
    starts = (Start(result, free, it, linear.cost({**it, **sizes})) for it in tried)
    return min(starts, key=lambda start: start.cost)
