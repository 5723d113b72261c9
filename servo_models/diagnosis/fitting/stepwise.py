"""Parameters that no slope leads to: other values of them are tried out beside a search."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from servo_models.core.block import Block, DeadTime
from servo_models.core.types import Array
from servo_models.data.log import ROUNDING
from servo_models.diagnosis.fitting.descent import descend
from servo_models.identification.problem import Problem

WIDE, NARROW = (0.02, 0.01), (0.005, 0.0025, 0.0012, 0.0006, 0.0003)
"""Relative changes of a stepwise size that are tried in turn, before a search and after it."""
JUMP = 0.2
"""Part of the range of a reading that it jumps between two samples, from which every delay of a
sample more puts the jump between two other ones."""
SAMPLES = (0.5, 1.0, 1.5, 2.5, 4.0)
"""Samples by which such a delay is moved."""
PARTS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4)
"""Parts of its period by which a delay before a hold is moved."""
WORTH, SHIFTED = 0.98, 8
"""Cost over that before from which a move is taken, and how often."""


def staircases_of(problem: Problem) -> list[int]:
    """Which free parameters are discontinuous: the response is a staircase of them."""
    return [
        i
        for i, free in enumerate(problem.free)
        if free.prior is None and _is(problem, free.name, _discontinuous)
    ]


def begins_with_jump(problem: Problem) -> bool:
    """Whether effects begin with a part of a jump: small changes then move where it comes by a
    sample, or not at all."""
    return any(it.start > 0.0 and _is(problem, it.name, _jump) for it in problem.free)


def _is(problem: Problem, name: str, keys: Callable[[Block], tuple[str, ...]]) -> bool:
    """Whether a parameter is among those ``keys`` of the effect that it belongs to."""
    plant = problem.model.plant
    effect = plant.owner(name)
    return effect is not None and plant.parameters[name].key in keys(effect)


def _discontinuous(effect: Block) -> tuple[str, ...]:
    return effect.switches if effect.search.grid else ()


def _jump(effect: Block) -> tuple[str, ...]:
    return (effect.search.jump,)


def _phase(effect: Block) -> tuple[str, ...]:
    return (effect.search.phase,)


def _delay(effect: Block) -> tuple[str, ...]:
    linear = effect.small_signal
    return (linear.time,) if isinstance(linear, DeadTime) else ()


def _period(effect: Block) -> tuple[str, ...]:
    return effect.switches if effect.signature == "clock" else ()


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
    return found[int(np.argmin(after))] if min(after) < WORTH * before else None


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
    moves = [it * sample for sample in _jumping(problem) for it in SAMPLES]
    moves += [it * period for period in _periods(problem, vector) for it in PARTS]
    trials = []
    for i in delays_of(problem):
        for move in (sign * it for it in moves if it for sign in (-1.0, 1.0)):
            trial = vector.copy()
            trial[i] += move / problem.free[i].scale
            trials.append(np.clip(trial, *problem.bounds))
    if not trials:
        return None
    before, costs = problem.costs([vector])[0], problem.costs(trials)
    return trials[int(np.argmin(costs))] if min(costs) < WORTH * before else None


def turned(problem: Problem, vector: Array) -> Array | None:
    """Return a vector with the phases that lie on a bound moved a turn on, None if there are none.

    The response is the same there, and the search may go on where the bound has stopped it.
    """
    sides, found = problem.sides(vector), vector.copy()
    for i, free in enumerate(problem.free):
        if sides[i] and _is(problem, free.name, _phase):
            found[i] += (2.0 if sides[i] == "low" else -2.0) * np.pi / free.scale
    found = np.clip(found, *problem.bounds)
    return None if np.array_equal(found, vector) else found


def delays_of(problem: Problem) -> list[int]:
    """Which free parameters are times of a transport delay."""
    names = [free.name for free in problem.free]
    return [i for i, name in enumerate(names) if _is(problem, name, _delay)]


def _periods(problem: Problem, vector: Array) -> list[float]:
    """Periods [s] of the holds that are on."""
    values = {**problem.model.values, **problem.values(vector)}
    return [it for name, it in values.items() if it > 0.0 and _is(problem, name, _period)]


def _jumping(problem: Problem) -> list[float]:
    """Sampling intervals [s] of readings that jump, those once that only rounding tells apart."""
    found: list[float] = []
    for log in problem.logs:
        for values in log.outputs.values():
            change = np.max(np.abs(np.diff(values)), initial=0.0)
            if change > JUMP * np.ptp(values) > 0.0:
                step = float(np.median(np.diff(log.times)))
                if not any(abs(step - it) <= ROUNDING * it for it in found):
                    found.append(step)
    return found
