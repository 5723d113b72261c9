"""Whether steps of a command are answered on the ticks of a hold.

A step of the command waits for the next tick.  By how much each one is late follows from when it
comes and from the period alone; a delay or a lag makes all of them late alike, and other effects
make them late in ways that know no clock.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servo_models.core.block import DeadTime
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.identification.simulation import prepared

LEAST_ROWS_AT_REST = 5  # rows of rest before a step of a command, and after
LEAST_STEPS = 4  # steps of a command from which a clock is told from chance
MOVES_IN_A_PERIOD = 12  # moves of a command per period, to find when it is answered
RANDOM_ORDERS = 1999  # random orders that answers are compared with
HEIGHT_ROUNDING = 1e-9  # difference of equal heights by rounding
LEAST_ROWS_IN_A_PERIOD = 2.0  # rows below which a log is too coarse to tell when a step is answered


@dataclass(frozen=True)
class Answers:
    """When steps of a command were answered, and when a clock would have them answered.

    Attributes:
        effect: the hold, and its ``period`` [s].
        due: lateness [s] by the clock, shape (k,).
        late: measured lateness [s], shape (k,), and its standard error ``error``.
    """

    effect: str
    period: float
    due: Array
    late: Array
    error: Array

    @property
    def bunched(self) -> float:
        """Length of the mean of the phases of the answers on the clock: 1 on ticks, 0 anywhere."""
        return float(_length_of_mean((self.late - self.due) / self.period))

    @property
    def chance(self) -> float:
        """Probability that answers that know no clock are as bunched: in any order (permutation
        test).  Where a clock would have all late alike, as steps at one phase of it, no order
        differs."""
        orders = np.random.default_rng(0).permuted(np.tile(self.late, (RANDOM_ORDERS, 1)), axis=1)
        heights = _length_of_mean((orders - self.due) / self.period)
        as_high = np.count_nonzero(heights >= self.bunched - HEIGHT_ROUNDING)
        return float((1.0 + as_high) / (1.0 + RANDOM_ORDERS))


def answers(fitted: FittedModel, effect: str) -> Answers | None:
    """When steps of the command are answered beside the other effects of a fitted model.

    None where the hold does not act on a command, or too few steps of it, or rows, tell.
    """
    problem = fitted.problem
    plant = problem.model.plant
    wire, switch = plant.main_wire(effect), plant.main(effect).switch
    period = fitted.values[switch]
    if wire not in {it.name for it in plant.inputs}:
        return None
    values = {**fitted.values, switch: 0.0}
    before = _delay_before(fitted, effect, wire)
    parts = [_of_log(fitted, log, wire, values, (period, before)) for log in problem.logs]
    due, late, error = (np.concatenate(part) for part in zip(*parts))
    if len(due) < LEAST_STEPS:
        return None
    return Answers(effect, period, due, late, error)


def _length_of_mean(turns: Array) -> Array:
    """Length of the mean of phases [turns] along the last axis: 1 if all are one."""
    return np.asarray(np.abs(np.mean(np.exp(2j * np.pi * turns), axis=-1)))


def _delay_before(fitted: FittedModel, effect: str, wire: str) -> float:
    """Transport delay [s] of a command before it comes to a hold."""
    plant, total = fitted.problem.model.plant, 0.0
    values = {**fitted.problem.model.values, **fitted.values}
    for name in plant.placements:
        if name == effect:
            break
        linear = plant.main(name).effect.hints.small_signal
        if isinstance(linear, DeadTime) and plant.main_wire(name) == wire:
            total += values[f"{name}.{linear.time}"]
    return total


def _of_log(
    fitted: FittedModel,
    log: Log,
    wire: str,
    values: dict[str, float],
    clock: tuple[float, float],
) -> tuple[Array, Array, Array]:
    """Lateness by the clock, measured lateness and its standard error for each step of a log.

    ``clock`` is its period [s] and by how much a command comes to it later than it was given.
    """
    none = np.empty(0), np.empty(0), np.empty(0)
    period, before = clock
    windows = _steps(log, wire)
    if not windows or period < LEAST_ROWS_IN_A_PERIOD * log.interval:
        return none
    moves = _moves(period, log.interval)
    squares = np.array([_squares(fitted, _moved(log, wire, k), values) for k in moves])
    times = np.asarray(moves * log.interval)
    rows = []
    for begin, end in windows:
        cost = squares[:, begin:end].sum(axis=1)
        best = int(np.argmin(cost))
        if 0 < best < len(moves) - 1:
            late, curvature = _vertex(times[best - 1 : best + 2], cost[best - 1 : best + 2])
            dispersion = max(cost[best] / (end - begin), 1.0)
            now = log.times[begin] + log.settle + before
            due = np.ceil(now / period - 1e-9) * period - now
            rows.append((due, late, np.sqrt(2.0 * dispersion / curvature)))
    return tuple(np.array(rows).T) if rows else none


def _steps(log: Log, wire: str) -> list[tuple[int, int]]:
    """Rows from a step of a command to its next change, where it rests before and after."""
    if wire not in log.inputs:
        return []
    changes = 1 + np.flatnonzero(np.diff(log.inputs[wire]))
    edges = np.concatenate([[0], changes, [len(log.times)]])
    return [
        (int(edge), int(after))
        for before, edge, after in zip(edges, edges[1:], edges[2:])
        if edge - before >= LEAST_ROWS_AT_REST and after - edge >= LEAST_ROWS_AT_REST
    ]


def _moves(period: float, interval: float) -> NDArray[np.int_]:
    """By how many rows commands are moved, half a period sooner to one and a half later."""
    rows = period / interval
    apart = max(int(rows / MOVES_IN_A_PERIOD), 1)
    return np.arange(-math.ceil(0.5 * rows), math.ceil(1.5 * rows) + apart, apart)


def _moved(log: Log, wire: str, rows: int) -> Log:
    """A log whose command comes so many usual rows later."""
    command, half = log.inputs[wire], 0.5 * float(np.min(np.diff(log.times)))
    sent = log.times - rows * log.interval + half
    places = np.maximum(np.searchsorted(log.times, sent, side="right") - 1, 0)
    return replace(log, inputs={**log.inputs, wire: command[places]})


def _squares(fitted: FittedModel, log: Log, values: dict[str, float]) -> Array:
    """Squared errors of each row of a log [noise floors^2], all outputs together, shape (n,)."""
    problem = fitted.problem
    run = prepared(problem.model, log)
    errors = (run.outputs(values) - np.column_stack(list(log.outputs.values()))) / np.array(
        [problem.sigma[name] for name in log.outputs]
    )
    return np.asarray(np.sum(errors**2, axis=1) * log.counted)


def _vertex(at: Array, cost: Array) -> tuple[float, float]:
    """Where a parabola through three points is least, and its second derivative."""
    second, first, _ = np.polyfit(at - at[1], cost, 2)
    second = max(second, 1e-300)
    return float(at[1] - 0.5 * first / second), float(2.0 * second)
