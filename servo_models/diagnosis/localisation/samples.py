"""Every weighted error of a diagnosis, with what the actuator was doing at that moment.

Motion is that of the fitted model: it has no noise, so its speed has a sign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.plant import Wire
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.localisation.breakdown import Rows
from servo_models.diagnosis.search.selection import Selection
from servo_models.identification.simulation import Run

STILL = 0.003  # speed over the largest one of a log up to which nothing moves
HELD = 0.01  # change of a command over its range up to which it is held


@dataclass(frozen=True, eq=False)
class Stretch:
    """One output of one log, at the samples that count.

    Attributes:
        log, output: which, and its place among the names of all outputs.
        rows: of the weighted errors, shape (m,).
        times: [s], shape (m,).
        measured: in noise floors, shape (m,).
    """

    log: int
    output: int
    rows: Rows
    times: Array
    measured: Array


@dataclass(frozen=True, eq=False)
class Samples:
    """Errors and circumstances of all samples, each of shape (n,).

    Attributes:
        names: of the outputs.
        logs: measured runs.
        main: wire of the position.
        command: wire of the input that moves.
        stretches: which samples belong together.
        before, after: errors in noise floors, the latter on blocks that no fit has seen.
        parts: block of time.
        times: [s].
        output, log: places among the names and the logs.
        amplitude: half the range of the output in its move, in noise floors.
        commanded: half the range of the command in its move [SI]; a move ends where the
            command turns.
        position, speed: of the fitted model [SI]; the speed is 0 at standstill.
        since, until: time [s] since the last reversal and until the next one, inf for none.
        between: time [s] between reversals, the longer ones take half of all time; 0 for none.
    """

    names: tuple[str, ...]
    logs: Sequence[Log]
    main: Wire
    command: Wire
    stretches: tuple[Stretch, ...]
    before: Array
    after: Array
    parts: Rows
    times: Array
    output: Rows
    log: Rows
    amplitude: Array
    commanded: Array
    position: Array
    speed: Array
    since: Array
    until: Array
    between: float


def collect(selection: Selection) -> Samples:
    """Return all samples that count in a diagnosis."""
    problem = selection.taken.problem
    plant, values = problem.model.plant, selection.taken.values
    names = tuple(problem.sigma)
    column, low, high = problem.moving_input
    stretches: list[Stretch] = []
    columns: list[tuple[Array, ...]] = []
    gaps: list[Array] = []
    for k, run in enumerate(problem.runs):
        log = run.log
        if not log.fitted.any():
            continue
        moves, between, circumstances = _motion(run, values, column, high - low)
        gaps.append(between)
        for name, signal in log.outputs.items():
            record = problem.records[k, name]
            rows = np.arange(record.start, record.stop)
            measured, seen = signal / problem.sigma[name], log.fitted
            stretches.append(Stretch(k, names.index(name), rows, log.times[seen], measured[seen]))
            signals = (log.times, _amplitude(measured, moves), *circumstances)
            columns.append(tuple(part[seen] for part in signals))
    lengths = [len(one.rows) for one in stretches]
    clock, amplitude, commanded, positions, speeds, since, until = (
        np.concatenate(part) for part in zip(*columns)
    )
    return Samples(
        names=names,
        logs=problem.logs,
        main=plant.wire[plant.outputs[0]],
        command=plant.inputs[column],
        stretches=tuple(stretches),
        before=selection.before.errors,
        after=selection.taken.evidence.unseen,
        parts=selection.taken.evidence.parts,
        times=clock,
        output=np.repeat([one.output for one in stretches], lengths),
        log=np.repeat([one.log for one in stretches], lengths),
        amplitude=amplitude,
        commanded=commanded,
        position=positions,
        speed=speeds,
        since=since,
        until=until,
        between=_typical(np.concatenate(gaps)),
    )


def _motion(
    run: Run, values: Mapping[str, float], column: int, reach: float
) -> tuple[Rows, Array, tuple[Array, ...]]:
    """Moves of a log, times between its turns, and of all its samples: amplitude of the command,
    position, speed, and times since the last turn and until the next one."""
    times, position = run.log.times, run.simulate(values)[:, 0]
    speed = _speed(times, position)
    turns = times[_turns(speed)]
    command = run.inputs[-len(times) :, column]
    moves = _moves(command, reach)
    around = _around(times, turns)
    return moves, np.diff(turns), (_amplitude(command, moves), position, speed, *around)


def _speed(times: Array, position: Array) -> Array:
    speed = np.gradient(position, times)
    speed[np.abs(speed) <= STILL * np.abs(speed).max()] = 0.0
    return speed


def _turns(speed: Array) -> Rows:
    """Samples at which motion goes on in the other direction."""
    moving = np.flatnonzero(speed)
    turned = np.diff(np.sign(speed[moving])) != 0.0
    return np.asarray(moving[1:][turned])


def _around(times: Array, turns: Array) -> tuple[Array, Array]:
    """Time since the last turn and until the next one."""
    padded = np.concatenate([[-np.inf], turns, [np.inf]])
    last = np.searchsorted(turns, times, side="right")
    return times - padded[last], padded[last + 1] - times


def _typical(gaps: Array) -> float:
    """The gap up to which half of the time goes by: short ones are many, as in ringing."""
    if len(gaps) == 0:
        return 0.0
    ordered = np.sort(gaps)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.5 * ordered.sum())])


def _moves(command: Array, span: float) -> Rows:
    """First samples of the moves of a command: one goes on until the command turns.

    ``span`` is the range of the command over all logs; changes far below do not count.
    """
    if span == 0.0:
        return np.zeros(1, dtype=np.int64)
    return np.concatenate([[0], 1 + _turns(np.diff(np.rint(command / (HELD * span))))])


def _amplitude(signal: Array, moves: Rows) -> Array:
    """Half the range of a signal in the move that each sample belongs to, its start included."""
    before = signal[np.maximum(moves - 1, 0)]
    high = np.maximum(np.maximum.reduceat(signal, moves), before)
    low = np.minimum(np.minimum.reduceat(signal, moves), before)
    return np.repeat(0.5 * (high - low), np.diff([*moves, len(signal)]))
