"""Parameters that no slope leads to: other values of them are tried out beside a search."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from servo_models.core.block import DeadTime, Hints
from servo_models.core.plant import Parameter
from servo_models.core.types import Array
from servo_models.data.log import ROUNDING
from servo_models.diagnosis.fitting.descent import descend
from servo_models.identification.problem import Free, Problem

WIDE_RELATIVE_CHANGES = (0.02, 0.01)
"""Of a discontinuous parameter, tried in turn before a search."""
NARROW_RELATIVE_CHANGES = (0.005, 0.0025, 0.0012, 0.0006, 0.0003)
"""The same after it."""
JUMP_OVER_RANGE = 0.2
"""Between two samples of a reading: every delay of a sample more then puts the jump between two
other ones."""
DELAY_MOVES_IN_SAMPLES = (0.5, 1.0, 1.5, 2.5, 4.0)
"""Of the delay before such a reading."""
DELAY_MOVES_IN_PERIODS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4)
"""Of a delay before a hold."""
MOVED_COST_OVER_COST = 0.98
"""From which a move is taken."""
MOST_MOVES = 8


def discontinuous_of(problem: Problem) -> list[int]:
    """Which free parameters are discontinuous: the response is a staircase of them."""
    return [
        i
        for i, free, parameter, hints in _of_effects(problem)
        if hints.grid and parameter.param.switch and free.prior is None
    ]


def begins_with_jump(problem: Problem) -> bool:
    """Whether effects begin with a part of a jump: small changes then move where it comes by a
    sample, or not at all."""
    return any(
        free.start > 0.0 and parameter.key == hints.jump
        for _, free, parameter, hints in _of_effects(problem)
    )


def _of_effects(problem: Problem) -> Iterator[tuple[int, Free, Parameter, Hints]]:
    """Free parameters of effects: which, as what they were declared, and what is known of them."""
    plant = problem.model.plant
    for i, free in enumerate(problem.free):
        parameter = plant.parameters[free.name]
        if parameter.owner:
            yield i, free, parameter, plant.main(parameter.owner).effect.hints


def others_first(
    problem: Problem,
    vector: Array,
    stepwise: Sequence[int],
    widths: Array | None,
    tolerance: float,
    limit: int,
) -> Array:
    """Least squares by the other parameters alone, see ``descend``."""
    others = [i for i in range(len(vector)) if i not in stepwise]
    values = problem.values(vector)
    sizes = {name: values[name] for name in (problem.free[i].name for i in stepwise)}
    model = replace(problem.model, values={**problem.model.values, **sizes})
    free = [problem.free[i] for i in others]
    rest = Problem(model, problem.logs, free, sigma=problem.sigma, workers=problem.workers)
    found = vector.copy()
    own = None if widths is None else widths[others]
    found[others], _, _ = descend(rest, vector[others], tolerance, limit, own)
    return found


def past_an_edge(
    problem: Problem, vector: Array, widths: Array | None, tolerance: float, limit: int
) -> Array | None:
    """Return a vector with other parameters fitted while delays stay, where they are or on the next
    stair, if that is surely better.

    Where a reading jumps, a search ends on the edge of a stair: each step that moves the delay as
    well falls off it, and the others would go on.
    """
    delays, samples = delays_of(problem), _jumping(problem)
    if not delays or not samples or len(delays) == len(vector):
        return None
    found = []
    for move in (0.0, *(half * sample for sample in samples for half in (-0.5, 0.5))):
        begin = vector.copy()
        begin[delays] += move / problem.scales[delays]
        begin = np.clip(begin, *problem.bounds)
        found.append(others_first(problem, begin, delays, widths, tolerance, limit))
    before, *after = problem.costs([vector, *found])
    return found[int(np.argmin(after))] if min(after) < MOVED_COST_OVER_COST * before else None


def sharpened(
    problem: Problem,
    vector: Array,
    stepwise: Sequence[int],
    widths: Array | None,
    spans: Iterable[float],
) -> Array:
    """Try nearby sizes, ever nearer; other parameters follow each by their slopes."""
    others = [i for i in range(len(vector)) if i not in stepwise]
    low, high = problem.bounds
    slopes = problem.jacobian(vector, widths)[:, others]
    inverse = np.linalg.pinv(slopes, rcond=1e-6)
    best, least = vector, problem.costs([vector])[0]
    for span in spans:
        trials = []
        for i in stepwise:
            for factor in (1.0 - span, 1.0 + span):
                trial = best.copy()
                trial[i] *= factor
                followed = trial.copy()
                followed[others] -= inverse @ problem.residuals(trial)
                trials += [trial, np.clip(followed, low, high)]
        costs = problem.costs(trials)
        if min(costs) < least:
            best, least = trials[int(np.argmin(costs))], min(costs)
    return best


def shifted(problem: Problem, vector: Array) -> Array | None:
    """Return a vector with a delay moved by a few samples, or by parts of the period of a hold, if
    that is surely better.

    Where a reading jumps with the command, the cost falls by a stair a sample: it is flat
    between two of them, and no slope leads on.  Before a hold, every edge of the command waits for
    the next tick, and the delay is such a staircase too.
    """
    moves = [it * sample for sample in _jumping(problem) for it in DELAY_MOVES_IN_SAMPLES]
    moves += [it * period for period in _periods(problem, vector) for it in DELAY_MOVES_IN_PERIODS]
    trials = []
    for i in delays_of(problem):
        for move in (sign * it for it in moves if it for sign in (-1.0, 1.0)):
            trial = vector.copy()
            trial[i] += move / problem.free[i].scale
            trials.append(np.clip(trial, *problem.bounds))
    if not trials:
        return None
    before, costs = problem.costs([vector])[0], problem.costs(trials)
    return trials[int(np.argmin(costs))] if min(costs) < MOVED_COST_OVER_COST * before else None


def turned(problem: Problem, vector: Array) -> Array | None:
    """Return a vector with the phases that lie on a bound moved a turn on, None if there are none.

    The response is the same there, and the search may go on where the bound has stopped it.
    """
    sides, found = problem.sides(vector), vector.copy()
    for i, free, parameter, hints in _of_effects(problem):
        if sides[i] and parameter.key == hints.phase:
            found[i] += (2.0 if sides[i] == "low" else -2.0) * np.pi / free.scale
    found = np.clip(found, *problem.bounds)
    return None if np.array_equal(found, vector) else found


def delays_of(problem: Problem) -> list[int]:
    """Which free parameters are times of a transport delay."""
    return [
        i
        for i, _, parameter, hints in _of_effects(problem)
        if isinstance(hints.small_signal, DeadTime) and parameter.key == hints.small_signal.time
    ]


def _periods(problem: Problem, vector: Array) -> list[float]:
    """Periods [s] of the holds that are on."""
    plant = problem.model.plant
    values = {**problem.model.values, **problem.values(vector)}
    places = [plant.main(name) for name in plant.placements]
    found = [values[it.switch] for it in places if it.effect.hints.signature == "clock"]
    return [period for period in found if period > 0.0]


def _jumping(problem: Problem) -> list[float]:
    """Sampling intervals [s] of readings that jump, those once that only rounding tells apart."""
    found: list[float] = []
    for log in problem.logs:
        for values in log.outputs.values():
            change = np.max(np.abs(np.diff(values)), initial=0.0)
            if change > JUMP_OVER_RANGE * np.ptp(values) > 0.0:
                step = float(np.median(np.diff(log.times)))
                if not any(abs(step - it) <= ROUNDING * it for it in found):
                    found.append(step)
    return found
