"""What the resolution of an input's column may hide: below it, outputs tell nothing.

A command that is logged in steps may have been sent finer; one that is logged at its next row was
sent some time before.  Copies of a log that would have given the same column are simulated: how far
they differ from each other is what no log like it can tell.  An open loop adds up the smallest
step to a large angle.
Where rows are missing, a command may have changed any time before the next row, and what follows is
another motion.  The difference that it makes if it changed at once is simulated, one for each
change; how much of it is there is anything from none to all.  Errors are weighed by the inverse of
the covariance that this gives them.
Sources: JCGM 101 (2008), Supplement 1 to the GUM (uncertainty of inputs carried to outputs by
simulation of draws); Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), sec. 2.7
(linear nuisance terms as part of the covariance).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from threading import Lock
from weakref import ref

import numpy as np
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from servo_models.analysis.experiment import display, in_time
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.core.workers import ALONE, Workers
from servo_models.data.audit import lost_rows
from servo_models.data.log import Log
from servo_models.data.reading_steps import reading_step
from servo_models.errors import UserError
from servo_models.identification.simulation import prepared
from servo_models.report.numbers import number, with_unit

COPIES = 8
"""Of a log, for each column and reason: the figure is known to a quarter."""
STEPS_IN_RANGE = 50.0
"""Of a column, from which these are how it is written, and no levels that were commanded."""
STEP, ROW = "step", "row"
MOST_LOST_SHARE = 0.1
"""Of the rows: where more are far apart, rows are uneven, and none is known to be lost."""
MOST_CHANGES = 60
"""In a log: of more only the largest, since each is a simulation."""
MEAN_SQUARE_SHARE = 1.0 / 3.0
"""Of a share that is anything from 0 to 1."""


@dataclass(frozen=True)
class Blur:
    """What the resolution of an input's column alone does to the outputs of a log.

    Attributes:
        log: its name.
        column: the input.
        why: ``"step"``: it is written in steps; ``"row"``: a change is logged at the next row.
        size: of that step [SI], or the median interval between rows [s].
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
    """Return what the resolution of each input's column does to outputs, the largest first.

    Args:
        model: simulated with these ``values`` [SI].
        logs: measured runs.
        floors: noise floor [SI] of each output.
        values: of parameters.
        workers: on which copies are simulated.

    Columns with copies that cannot be simulated are left out.
    """
    random = np.random.default_rng(0)
    found = []
    for log in logs:
        for name, why, size, copies in _copies(log, random):
            outputs = np.array(list(workers.map(_Copy(model, log, values), copies)))
            spread = np.sqrt(np.mean((outputs - outputs.mean(axis=0)) ** 2, axis=(0, 1)))
            moves = {out: float(it) / floors[out] for out, it in zip(log.outputs, spread)}
            if np.isfinite(spread).all():
                found.append(Blur(log.name, name, why, size, moves))
    return tuple(sorted(found, key=lambda it: -it.largest))


def supposed(blur: Blur, plant: Plant) -> str:
    """Return "sent finer than in steps of 0.01 V", or "sent up to 2 ms before its row"."""
    if blur.why == ROW:
        return f"sent up to {in_time(blur.size)} before its row"
    scale, unit = display(plant.wire[blur.column])
    return f"sent finer than in steps of {with_unit(number(scale * blur.size, 3), unit)}"


@dataclass(frozen=True)
class _Copy:
    """Simulates a copy with more rows; returns the outputs at those of the log, shape (n, k)."""

    model: Model
    log: Log
    values: Mapping[str, float]

    def __call__(self, copy: Log) -> Array:
        rows = np.searchsorted(copy.times, self.log.times)
        return prepared(self.model, copy).outputs_or_nan(self.values)[rows]


def _copies(log: Log, random: np.random.Generator) -> Iterator[tuple[str, str, float, list[Log]]]:
    """Inputs that change, with why their columns are not exact and copies with the same columns."""
    for name, values in log.inputs.items():
        changes = np.flatnonzero(np.diff(values)) + 1
        if not len(changes):
            continue
        step = reading_step(values).size
        if step and np.ptp(values) > STEPS_IN_RANGE * step:
            yield name, STEP, step, [_finer(log, name, step, random) for _ in range(COPIES)]
        interval = float(np.median(np.diff(log.times)))
        yield name, ROW, interval, [_earlier(log, name, changes, random) for _ in range(COPIES)]


def _finer(log: Log, name: str, step: float, random: np.random.Generator) -> Log:
    """The log with an input anywhere within its step, the same while it is held."""
    held = np.concatenate([[0], np.cumsum(np.diff(log.inputs[name]) != 0.0)])
    off = random.uniform(-0.5 * step, 0.5 * step, held[-1] + 1)
    return replace(log, inputs={**log.inputs, name: log.inputs[name] + off[held]})


def _earlier(log: Log, name: str, changes: NDArray[np.int64], random: np.random.Generator) -> Log:
    """The log with each change of an input anywhere between the row before and its own."""
    before = log.times[changes] - log.times[changes - 1]
    instants = log.times[changes] - random.uniform(0.0, 1.0, len(changes)) * before
    times = np.union1d(log.times, instants)
    held = np.searchsorted(log.times, times, "right") - 1
    inputs = {other: values[held] for other, values in log.inputs.items()}
    # from its instant on, the value of the next row
    changed = np.searchsorted(instants, times, "right") - 1
    last = np.concatenate([log.inputs[name][:1], log.inputs[name][changes]])
    inputs[name] = last[changed + 1]
    return replace(log, times=times, inputs=inputs)


# Commands between lost rows


def with_lost_rows(
    model: Model, logs: Sequence[Log], values: Mapping[str, float]
) -> tuple[Log, ...]:
    """Return logs that know what commands between lost rows may have done to their outputs.

    Args:
        model: simulated with these ``values`` [SI].
        logs: those without lost rows stay as they are.
        values: of parameters.
    """
    return tuple(_with_lost_rows(model, log, values) for log in logs)


def _with_lost_rows(model: Model, log: Log, values: Mapping[str, float]) -> Log:
    before = lost_rows(log)
    if not 0 < len(before) <= MOST_LOST_SHARE * len(log.times):
        return log
    sizes = np.zeros(len(before))
    for held in log.inputs.values():
        sizes += np.abs(held[before + 1] - held[before]) / (np.ptp(held) or 1.0)
    changed = before[np.argsort(-sizes)[: min(MOST_CHANGES, np.count_nonzero(sizes))]]
    try:
        usual = prepared(model, log).outputs(values)
        moved = [prepared(model, _at_once(log, k)).outputs(values) - usual for k in changed]
    except UserError:
        return log
    if not moved:
        return log
    unsure = np.stack(moved, axis=-1)
    return replace(log, unsure={name: unsure[:, i] for i, name in enumerate(log.outputs)})


def _at_once(log: Log, row: int) -> Log:
    """The log with its next commands in this row already."""
    inputs = {name: values.copy() for name, values in log.inputs.items()}
    for values in inputs.values():
        values[row] = values[row + 1]
    return replace(log, inputs=inputs)


@cached(LRUCache(64), key=lambda log, sigma: (ref(log), sigma), lock=Lock())
def nuisances(log: Log, sigma: tuple[float, ...]) -> tuple[Array, Array]:
    """Return directions of weighted errors in which lost rows may have moved them, shape (m, k),
    and by which share the covariance takes each away, shape (k,).

    Args:
        log: with ``unsure``.
        sigma: weight [SI] of each of its outputs.
    """
    assert log.unsure
    parts = [log.unsure[name][log.fitted] / size for name, size in zip(log.outputs, sigma)]
    spread = np.sqrt(MEAN_SQUARE_SHARE) * np.concatenate(parts)
    left, singular, _ = np.linalg.svd(spread, full_matrices=False)
    return left, 1.0 - 1.0 / np.sqrt(1.0 + singular**2)
