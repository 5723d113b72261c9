"""What the resolution of an input's column may hide: below it, outputs tell nothing.

A command that is logged in steps may have been sent finer; one that is logged at its next row was
sent some time before.  Copies of a log that would have given the same column are simulated: how far
they differ from each other is what no log like it can tell.  An open loop adds up the smallest
step to a large angle.
Where rows are missing, a command may have changed any time before the next row, and what follows is
another motion.  The difference that it makes if it changed at once is simulated, one for each
change; how much of it is there is anything from none to all.  So is what the steps of a column do,
block by block, where that is more than noise.  ``problem`` weighs errors by the inverse of the
covariance that both give them.
Source: JCGM 101 (2008), Supplement 1 to the GUM (uncertainty of inputs carried to outputs by
simulation of draws).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.experiment import display, in_time
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Array, Mask
from servo_models.core.workers import ALONE, Workers
from servo_models.data.clock import lost_rows, unsure_delays
from servo_models.data.log import Log
from servo_models.data.sensor import reading_step
from servo_models.errors import UserError
from servo_models.identification.simulation import prepared
from servo_models.report.numbers import number, with_unit

COPIES = 8  # copies of a log for each column and reason: the figure is known to a quarter
STEPS_IN_RANGE = 50.0  # steps in the range of a column from which they are no commanded levels
STEP, ROW, STAMP = WHY = "step", "row", "stamp"
BLAMED = 0.25  # share of what is left from which it is said what may carry it
MOST_LOST_SHARE = 0.1  # share of rows far apart, above which rows are uneven and none is lost
MOST_CHANGES = 300  # changes in a log that are simulated, the largest
SAMPLES_PER_CHANGE = 4  # fewest samples for each change: fewer may have been moved anyhow
INSTANTS = 3  # instants between lost rows at which a command is tried
LOOKS = 2  # copies by which it is asked whether the step of a column matters
MATTERS = 0.3  # movement by it [noise floors] from which it does
BLOCKS_PER_FLOOR = 6.0  # blocks of rows over that movement: within one, steps are noise
LEAST_BLOCKS = 20
MOST_BLOCKS = 400


@dataclass(frozen=True)
class Blur:
    """What the resolution of an input's column alone does to the outputs of a log.

    Attributes:
        log: its name.
        column: the input, or ``"time"``.
        why: ``"step"``: it is written in steps; ``"row"``: a change is logged at the next row;
            ``"stamp"``: rows are stamped late, as far as readings tell.
        size: of that step [SI], the median interval between rows [s], or the longest delay [s].
        moves: RMS by which copies differ from their mean [noise floors], by output.
    """

    log: str
    column: str
    why: str
    size: float
    moves: Mapping[str, float]

    @property
    def largest(self) -> float:
        """The largest of ``moves``."""
        return max(self.moves.values(), default=0.0)


def blurs(
    model: Model,
    logs: Sequence[Log],
    floors: Mapping[str, float],
    values: Mapping[str, float],
    workers: Workers = ALONE,
) -> tuple[Blur, ...]:
    """Return what the resolution of each input's column does to outputs, the largest first;
    ``values`` of parameters and noise ``floors`` are in SI.

    Columns with copies that cannot be simulated are left out.
    """
    random = np.random.default_rng(0)
    blurred = []
    for log in logs:
        for name, why, size, copies in _copies(log, random):
            outputs = np.array(list(workers.map(_Copy(model, values), copies)))
            spread = np.sqrt(np.mean((outputs - outputs.mean(axis=0)) ** 2, axis=(0, 1)))
            moves = {out: float(it) / floors[out] for out, it in zip(log.outputs, spread)}
            if np.isfinite(spread).all():
                blurred.append(Blur(log.name, name, why, size, moves))
    return tuple(sorted(blurred, key=lambda it: -it.largest))


def could_carry(blurred: Iterable[Blur], logs: Sequence[Log]) -> dict[str, float]:
    """Return by reason how far all outputs of all logs may be moved [RMS, noise floors], the
    farthest first: each column of each log moves them by itself."""
    samples = {log.name: int(log.fitted.sum()) for log in logs}
    count = sum(samples[log.name] * len(log.outputs) for log in logs) or 1
    squares = dict.fromkeys(WHY, 0.0)
    for blur in blurred:
        squares[blur.why] += samples[blur.log] * sum(it**2 for it in blur.moves.values()) / count
    return {why: float(np.sqrt(squares[why])) for why in sorted(WHY, key=lambda it: -squares[it])}


def supposed(blur: Blur, plant: Plant) -> str:
    """Return "sent finer than in steps of 0.01 V", "sent up to 2 ms before its row", or "stamped up
    to 2 ms late"."""
    if blur.why == STAMP:
        return f"stamped up to {in_time(blur.size)} late"
    if blur.why == ROW:
        return f"sent up to {in_time(blur.size)} before its row"
    scale, unit = display(plant.wire[blur.column])
    return f"sent finer than in steps of {with_unit(number(scale * blur.size, 3), unit)}"


@dataclass(frozen=True)
class _Copy:
    """Simulates a copy; returns the outputs at the times of its readings, shape (n, k)."""

    model: Model
    values: Mapping[str, float]

    def __call__(self, copy: tuple[Log, Array]) -> Array:
        log, read = copy
        outputs = prepared(self.model, log).outputs_or_nan(self.values)
        return np.column_stack([np.interp(read, log.times, it) for it in outputs.T])


def _copies(
    log: Log, random: np.random.Generator
) -> Iterator[tuple[str, str, float, list[tuple[Log, Array]]]]:
    """Inputs that change, with why their columns are not exact and copies with the same columns,
    each with when it was read; so of stamps that may be late."""
    if (delays := unsure_delays(log)) is not None:
        off = (random.permutation(delays) for _ in range(COPIES))
        yield "time", STAMP, float(delays.max()), [(log, log.times - it) for it in off]
    for name, values in log.inputs.items():
        changes = np.flatnonzero(np.diff(values)) + 1
        if not len(changes):
            continue
        if step := _column_step(values):
            finer = (_finer(log, name, step, random) for _ in range(COPIES))
            yield name, STEP, step, [(copy, log.times) for copy in finer]
        if not _exact(log)[changes].all():
            earlier = (_earlier(log, name, changes, random) for _ in range(COPIES))
            yield name, ROW, log.interval, [(copy, log.times) for copy in earlier]


def _exact(log: Log) -> Mask:
    """Mark samples whose commands have stamps of their own, shape (n,)."""
    return np.zeros(len(log.times), dtype=bool) if log.between is None else log.between


def _column_step(column: Array) -> float:
    """The step in which an input's column is written, 0 for none."""
    step = reading_step(column).size
    return step if np.ptp(column) > STEPS_IN_RANGE * step else 0.0


def _finer(log: Log, name: str, step: float, random: np.random.Generator) -> Log:
    """The log with an input anywhere within its step, the same while it is held."""
    held = np.concatenate([[0], np.cumsum(np.diff(log.inputs[name]) != 0.0)])
    off = random.uniform(-0.5 * step, 0.5 * step, held[-1] + 1)
    return replace(log, inputs={**log.inputs, name: log.inputs[name] + off[held]})


def _earlier(log: Log, name: str, changes: NDArray[np.int64], random: np.random.Generator) -> Log:
    """The log with each change of an input anywhere between the row before and its own."""
    before = (log.times[changes] - log.times[changes - 1]) * ~_exact(log)[changes]
    instants = log.times[changes] - random.uniform(0.0, 1.0, len(changes)) * before
    times = np.union1d(log.times, instants)
    held = np.searchsorted(log.times, times, "right") - 1
    inputs = {other: values[held] for other, values in log.inputs.items()}
    # from its instant on, the value of the next row
    changed = np.searchsorted(instants, times, "right") - 1
    last = np.concatenate([log.inputs[name][:1], log.inputs[name][changes]])
    inputs[name] = last[changed + 1]
    return _at(times, log, inputs)


def _at(times: Array, log: Log, inputs: Mapping[str, Array]) -> Log:
    """The log at its own times and others between, which no fit sees."""
    held = log.at(np.searchsorted(log.times, times, "right") - 1)
    unseen = held.held_out | ~np.isin(times, log.times)
    return replace(held, times=times, inputs=inputs, held_out=unseen)


# What they leave open, as part of the covariance


def with_unsure_inputs(
    model: Model,
    logs: Sequence[Log],
    values: Mapping[str, float],
    floors: Mapping[str, float],
    between_rows: bool = False,
) -> tuple[Log, ...]:
    """Return logs that know what lost rows and steps of their inputs' columns may have done.

    Where ``between_rows``, commands may have changed any time before the row that has them.
    ``values`` of parameters and noise ``floors`` are in SI.
    """
    return tuple(_with_unsure_inputs(model, log, values, floors, between_rows) for log in logs)


def _with_unsure_inputs(
    model: Model,
    log: Log,
    values: Mapping[str, float],
    floors: Mapping[str, float],
    between_rows: bool,
) -> Log:
    sigma = np.array([floors[name] for name in log.outputs])
    try:
        usual = prepared(model, log).outputs(values)

        def moved(copy: Log) -> Array:
            rows = np.searchsorted(copy.times, log.times)
            return prepared(model, copy).outputs(values)[rows] - usual

        changes = [share * moved(copy) for copy, share in _sent_before(log, between_rows)]
        for name, column in log.inputs.items():
            if not (step := _column_step(column)):
                continue
            copies = [_finer(log, name, step, np.random.default_rng(k)) for k in range(LOOKS)]
            squares = np.mean([moved(copy) ** 2 for copy in copies], axis=(0, 1))
            far = float(np.sqrt(np.max(squares / sigma**2)))
            if far > MATTERS:
                count = int(np.clip(BLOCKS_PER_FLOOR * far, LEAST_BLOCKS, MOST_BLOCKS))
                blocks = _block_by_block(log, name, step, count)
                changes += [share * moved(copy) for copy, share in blocks]
    except UserError:
        return log
    if not changes:
        return log
    unsure = np.stack(changes, axis=-1)
    return replace(log, unsure={name: unsure[:, i] for i, name in enumerate(log.outputs)})


def _sent_before(log: Log, every: bool) -> Iterator[tuple[Log, float]]:
    """Logs whose command after lost rows, or after ``every`` row, has come before, those of the
    largest changes; each with how much of what that moves is a standard deviation.

    It may have come at any time since the last row: the covariance is the mean over that time, by
    Gauss's quadrature.
    """
    before = np.arange(len(log.times) - 1) if every else lost_rows(log)
    if not every and len(before) > MOST_LOST_SHARE * len(log.times):
        return
    sizes = np.zeros(len(before))
    for held in log.inputs.values():
        sizes += np.abs(held[before + 1] - held[before]) / (np.ptp(held) or 1.0)
    if every:
        sizes[_exact(log)[1:]] = 0.0
    changed = before[np.argsort(-sizes)[: np.count_nonzero(sizes)]]
    most = min(MOST_CHANGES, int(log.fitted.sum()) // SAMPLES_PER_CHANGE)
    alone, blocks = most, list[NDArray[np.int64]]()
    if every and len(changed):
        # the others block by block, and all as a logger does that is late by itself
        alone = most if len(changed) <= most else most // 2
        others = np.sort(changed[alone:])
        blocks = [it for it in np.array_split(others, max(most - alone, 1)) if len(it)]
        yield _moved_before(log, np.sort(changed), 0.0), 1.0
    nodes, weights = np.polynomial.legendre.leggauss(1 if every else INSTANTS)
    for rows in (*changed[:alone, None], *blocks):
        for node, weight in zip(nodes, weights):
            yield _moved_before(log, rows, node), np.sqrt(0.5 * weight / len(rows))


def _moved_before(log: Log, rows: NDArray[np.int64], node: float) -> Log:
    """The log with what follows some rows come before, at -1 with the row and at 1 with the next"""
    begin, end = log.times[rows], log.times[rows + 1]
    instants = 0.5 * (begin + end + node * (end - begin))
    inputs = {name: np.insert(it, rows + 1, it[rows + 1]) for name, it in log.inputs.items()}
    return _at(np.insert(log.times, rows + 1, instants), log, inputs)


def _block_by_block(log: Log, name: str, step: float, count: int) -> Iterator[tuple[Log, float]]:
    """Logs with an input off by its step in one block of rows, and how much of that is a standard
    deviation of what the values of the block are off on average."""
    column = log.inputs[name]
    for rows in np.array_split(np.arange(len(column)), count):
        off = column.copy()
        off[rows] += step
        held = 1 + np.count_nonzero(np.diff(column[rows]))
        yield replace(log, inputs={**log.inputs, name: off}), 1.0 / np.sqrt(12.0 * held)
