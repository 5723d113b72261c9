"""Which of a discontinuous parameter's thousands of values to screen: a short list from short logs.

No slope leads to the best value.  The first part of the logs tells quickly which values are near
it; the whole logs then tell them apart.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from servo_models.data.log import Log
from servo_models.diagnosis.search.candidates import Candidate, Values, candidates
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.screening import Screened, residual_beside, screen
from servo_models.identification.linear_inference import linearised

BRIEF_SAMPLES = 1000  # length of the first parts of the logs, in which every value is screened
LONG_SAMPLES = 5000  # length of the parts for the best: the longer, the narrower is the minimum
BRIEF_MEAN_SQUARE_RATIO = 0.5  # least residual power, excerpt over longer part, to screen there
VALUES_IN_LONG = 60  # values screened in the longer part after that
VALUES_CORRECTED = 24  # values screened there with other parameters corrected, half with neighbours
AROUND_RELATIVE = (-0.0005, 0.0005)  # offsets of these neighbours relative to the value
AROUND_PERIOD_RELATIVE = (-0.00075, -0.0005, -0.00025, 0.00025, 0.0005, 0.00075)
"""Offsets for the period of a hold, by which the end of a log is a sample off."""
FIRST_RELATIVE_SPACING = 0.01  # spacing of the values screened first, unless an effect is a hold
NEIGHBOURS_LEFT_SHARE = 0.7  # share of squared errors that the best leaves, to screen neighbours
NEIGHBOURS_FACTOR = 2.0  # factor to either side of the best within which neighbours lie
LEAST_MOVE = 0.2  # least change by a discontinuous effect over the residual, to be its cause
LARGEST_MOVE = 3.0  # largest change over the residual, to be its cause
VALUES_LISTED = 12  # values screened with the whole logs, and neighbours only these tell apart


def shortlist(
    fitter: Fitter, first: FittedModel, every: Sequence[Candidate], known: Sequence[Screened] = ()
) -> tuple[Candidate, ...]:
    """Return the discontinuous ones of some effects, with the values that leave least beside
    ``first``.

    What is ``known`` of effects, from the whole logs, tells how much a value moves, and what smooth
    effects may do beside it.
    """
    moving = {it.candidate.name for it in known} or {one.name for one in every}
    discontinuous = [one for one in every if one.grid and one.name in moving]
    if not discontinuous:
        return ()
    smooth = [it for it in known if not it.candidate.grid]
    brief, long = (_Part(fitter, first, n, smooth) for n in (BRIEF_SAMPLES, LONG_SAMPLES))
    return tuple(_listed(one, brief, long, known) for one in discontinuous)


class _Part:
    """The first part of some logs, linearised about a fit."""

    def __init__(
        self, fitter: Fitter, first: FittedModel, samples: int, smooth: Iterable[Screened] = ()
    ) -> None:
        brief = replace(fitter, logs=shortened(fitter.logs, samples))
        problem = brief.problem(first.own)
        self.linearised = linearised(problem, first.evidence.vector, first.widths)
        self.candidates = {one.name: one for one in candidates(fitter.model, brief.logs)}
        rows = _rows(fitter.logs, brief.logs)
        cut = [self._cut(it, rows) for it in smooth]
        self.smooth = [it for it in cut if it.difference.any()]

    def screen(self, name: str, sizes: Iterable[Values], corrected: bool = False) -> list[Screened]:
        """Results of a discontinuous effect at some values, best first."""
        candidate = replace(self.candidates[name], trial_values=tuple(sizes))
        return screen((self.linearised,), [candidate], corrected)

    def _cut(self, result: Screened, rows: NDArray[np.int_]) -> Screened:
        """A result of an effect with the whole logs, as far as this part goes."""
        linear = self.linearised
        change = np.zeros(len(linear.errors))
        change[: len(rows)] = result.change[rows]
        difference = linear.without(change)
        return replace(result, linearised=linear, change=change, difference=difference)

    def best(self, results: Sequence[Screened], count: int) -> list[Screened]:
        """So many that leave least alone, and half as many that do beside a smooth effect: that
        may hide the size as nominal parameters do."""
        if not results or not self.smooth:
            return list(results[:count])
        order = np.argsort(residual_beside(results, self.smooth))[: count // 2]
        return [*results[:count], *(results[i] for i in order if i >= count)]


def _rows(whole: Sequence[Log], parts: Sequence[Log]) -> NDArray[np.int_]:
    """Which errors of whole logs are those of their first parts."""
    places, start = [np.empty(0, dtype=int)], 0
    for full, part in zip(whole, parts):
        for _ in full.outputs:
            places.append(start + np.arange(part.fitted.sum()))
            start += int(full.fitted.sum())
    return np.concatenate(places)


def _listed(full: Candidate, brief: _Part, long: _Part, known: Iterable[Screened]) -> Candidate:
    """An effect with the values that leave least."""
    left, whole = (it.linearised.left / it.linearised.problem.samples for it in (brief, long))
    # the shorter part, if what is left to explain shows there
    part = brief if left > BRIEF_MEAN_SQUARE_RATIO * whole else long
    every = (brief if full.late else long).candidates[full.name].grid
    # a hold whose ticks fall on the edges of a command does nothing, one a bit longer does much
    likely = every if full.late else _fitting(every, full.name, known)
    grid, results = _over_all(full, part, every, likely)
    if not full.late and part is not long:
        results = long.screen(full.name, [it.settings for it in part.best(results, VALUES_IN_LONG)])
        part = long
    results = _closer(full, long, [it.settings for it in part.best(results, VALUES_CORRECTED)])
    best = [it.settings for it in long.best(results, VALUES_LISTED)]
    near = [it for size in best for it in _between(full.grid, grid, size)]
    sizes = {tuple(it.items()): it for it in (*best, *near)}
    return replace(full, trial_values=tuple(sizes.values()))


def _over_all(
    full: Candidate, part: _Part, every: Sequence[Values], likely: Sequence[Values]
) -> tuple[list[Values], list[Screened]]:
    """The values that are screened in a part of the logs, and the results there, best first."""
    chosen = likely if full.late else _thinned(likely)
    grid = [*full.trial_values, *chosen]  # those between are screened later
    results = part.screen(full.name, grid)
    # a narrow minimum may lie beside what resembles it
    if not full.late and results and results[0].left < NEIGHBOURS_LEFT_SHARE * part.linearised.left:
        nearer = [it for it in _about(results[0].settings, every) if it not in grid]
        grid += nearer
        results = sorted([*results, *part.screen(full.name, nearer)], key=lambda it: it.left)
    return grid, results


def _closer(full: Candidate, part: _Part, best: Sequence[Values]) -> list[Screened]:
    """Results of some sizes and of those around the best half, other parameters corrected."""
    results = part.screen(full.name, best, corrected=True)
    apart = AROUND_PERIOD_RELATIVE if full.late else AROUND_RELATIVE
    half = [it.settings for it in part.best(results, VALUES_CORRECTED // 2)]
    # a needle is narrower than sizes are apart
    closer = [{name: it[name] * (1.0 + off)} for it in half for name in it for off in apart]
    more = part.screen(full.name, closer, corrected=True)
    return sorted([*results, *more], key=lambda it: it.left)


def _about(best: Values, every: Sequence[Values]) -> list[Values]:
    """Sizes within a factor of the best."""
    (size,) = best.values()
    return [
        it for it in every if size / NEIGHBOURS_FACTOR < max(it.values()) < size * NEIGHBOURS_FACTOR
    ]


def _thinned(every: Sequence[Values]) -> list[Values]:
    """Of sizes that fall, those that are apart from each other."""
    kept: list[Values] = []
    last = np.inf
    for settings in every:
        size = max(settings.values())
        if size < last * (1.0 - FIRST_RELATIVE_SPACING):
            kept.append(settings)
            last = size
    return kept


def _fitting(sizes: Sequence[Values], name: str, known: Iterable[Screened]) -> Sequence[Values]:
    """Sizes that move about as much as there is left to explain."""
    moved = {
        max(result.settings.values()): np.linalg.norm(result.difference)
        / sqrt(result.linearised.left)
        for result in known
        if result.candidate.name == name
    }
    if not moved:
        return sizes
    at, moves = np.log(sorted(moved.items())).T
    wanted = np.log([max(size.values()) for size in sizes])
    # beyond the results, as far as the size does
    expected = np.interp(wanted, at, moves) + wanted - np.clip(wanted, at[0], at[-1])
    return [it for it, move in zip(sizes, expected) if log(LEAST_MOVE) < move < log(LARGEST_MOVE)]


def shortened(logs: Sequence[Log], samples: int) -> tuple[Log, ...]:
    """Return the first parts of some logs, the same share of each; more of each, twice as much at
    a time, where a fit may see too little of them.

    A simulation can only begin where a log does.
    """
    share = samples / sum(len(log.times) for log in logs)
    while share < 1.0:
        parts = tuple(log.at(slice(max(2, int(share * len(log.times))))) for log in logs)
        if sum(int(log.fitted.sum()) for log in parts) > 0.5 * samples:
            return parts
        share *= 2.0
    return tuple(logs)


def _between(every: Sequence[Values], grid: Sequence[Values], size: Values) -> list[Values]:
    """Sizes nearer to one of a grid than to its neighbours there, and near it."""
    (switch,) = size
    value = size[switch]
    others = np.array([it[switch] for it in grid])
    below = max(others[others < value], default=0.0)
    above = min(others[others > value], default=np.inf)
    low = max(0.5 * (value + below), value * (1.0 - FIRST_RELATIVE_SPACING))
    high = min(0.5 * (value + above), value * (1.0 + FIRST_RELATIVE_SPACING))
    return [it for it in every if low <= it[switch] <= high]
