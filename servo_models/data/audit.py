"""Audit a measured log before any model sees it: sampling, readings, commands, noise floor.

Everything here is read off the log alone; what it can determine about a model is told by
``identifiability``.  All figures are SI.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.statistics import hann, stretch_powers
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array
from servo_models.data.clock import JITTERY, Sampling, sampling
from servo_models.data.log import Log
from servo_models.data.mistakes import CLIPPING, Mistake, mistakes
from servo_models.data.outliers import POSITIONS
from servo_models.data.sensor import (
    FLAG,
    NO_STEP,
    Floor,
    Step,
    clipped_share,
    noise_floor,
    reading_steps,
    stale_share,
    usual_range,
    usual_width,
)

LEAST_GAP = 2.0  # error [noise floors] from which a model has a gap
EXACT = 1e-6  # least noise floor of a reading over its range
NO_NOISE = "millionth of the range, no noise"  # origin of such a floor
MOVES = 10.0  # usual width of a reading over its noise floor above which it moves
STRETCHES = 100  # stretches of a log, within one of which nothing moves where it rests
SPEEDS = ("m/s", "rad/s")  # units of speeds
ODD = 3.0  # floor over the median of all logs above which a log does not count; of two both do


@dataclass(frozen=True, eq=False)
class Audit:
    """What a log is worth.

    ``at_rest`` is the share of samples in which nothing moves.  ``commanded`` is False where
    neither this log nor those beside it have an input that changes, ``moves`` where no output of
    theirs moves.  ``mistakes`` say what no actuator does, one sentence each.
    """

    log: Log
    sampling: Sampling
    commands: tuple[Command, ...]
    readings: tuple[Reading, ...]
    at_rest: float
    commanded: bool = True
    moves: bool = True
    mistakes: tuple[Mistake, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the log doubtful, one sentence each with its cure."""
        return (
            *self.mistakes,
            *_about_time(self.sampling),
            *_about_commands(self.commands, self.commanded, self.moves),
            *(text for text in self.clipped if text not in self.mistakes),
            *(text for reading in self.readings for text in _about_reading(reading)),
        )

    @property
    def clipped(self) -> tuple[str, ...]:
        """Which readings stay at an end of their range, one sentence each."""
        told = tuple(text for text in self.mistakes if CLIPPING in text)
        return told or tuple(text for reading in self.readings for text in _about_ends(reading))


def audits(logs: Sequence[Log], plant: Plant) -> tuple[Audit, ...]:
    """Audit logs of an actuator with this plant; those of one sensor share its reading step.

    A sensor is an output from a column of one name, unit and scale.  The fast residual supposes
    samples that are almost evenly spaced.
    """
    logs = [log.readings for log in logs]
    audited = [_audit(log, plant, steps) for log, steps in zip(logs, _steps(logs, plant))]
    # single wild readings apart
    moves = any(
        usual_width(it.log.outputs[reading.name]) > MOVES * reading.floor.value
        for it in audited
        for reading in it.readings
    )
    commanded = _commands_vary(logs, plant)
    return tuple(replace(it, commanded=commanded, moves=moves) for it in audited)


def show_motion(logs: Sequence[Log], plant: Plant) -> bool:
    """Return whether an input changes, or an output moves: an arm that is let go needs no command.

    Inputs that differ between logs count as well, and a log that begins in motion.
    """
    return _commands_vary(logs, plant) or audits(logs, plant)[0].moves


def _commands_vary(logs: Sequence[Log], plant: Plant) -> bool:
    """Whether an input changes, in a log or from one to another, or a log begins in motion.

    A step in the first row of a log that begins at rest is a change.
    """
    rest = {wire.name: wire.rest for wire in plant.inputs}
    constants = [{k: v for k, v in log.constants.items() if k in rest} for log in logs]
    firsts = [{name: float(it[0]) for name, it in log.inputs.items()} for log in logs]
    begins = [{**rest, **held, **first} for held, first in zip(constants, firsts)]
    moving = any(np.ptp(values) > 0.0 for log in logs for values in log.inputs.values())
    moving |= any(log.start is not None for log in logs)
    steps = any(log.settle == 0.0 and begin != rest for log, begin in zip(logs, begins))
    return moving or steps or any(begin != begins[0] for begin in begins)


def _steps(logs: Sequence[Log], plant: Plant) -> list[dict[str, Step]]:
    """The reading step of each output, by log."""
    sensors: dict[tuple[str, str, str, float], list[int]] = {}
    for i, log in enumerate(logs):
        for name in log.outputs:
            channel = log.channels[name]
            sensor = (name, channel.column, channel.unit, channel.scale)
            sensors.setdefault(sensor, []).append(i)
    by_log: list[dict[str, Step]] = [{} for _ in logs]
    for (name, *_), members in sensors.items():
        if plant.wire[name].flag:
            steps = [NO_STEP] * len(members)
        else:
            steps = reading_steps([logs[i].outputs[name][logs[i].counted] for i in members])
        for i, step in zip(members, steps):
            by_log[i][name] = step
    return by_log


def _audit(log: Log, plant: Plant, steps: Mapping[str, Step]) -> Audit:
    clock = sampling(log)
    readings = tuple(_reading(log, plant.wire[name], steps[name]) for name in log.outputs)
    commands = tuple(_command(log, plant, name, clock.step, readings) for name in log.inputs)
    rest = _at_rest(log, plant, readings)
    wrong = tuple(mistakes(log, plant, {name: step.size for name, step in steps.items()}))
    return Audit(log, clock, commands, readings, rest, mistakes=wrong)


def noise_floors(audits: Iterable[Audit]) -> dict[str, float]:
    """Return the noise floor [SI] of each output, above 0.

    It is the largest of its logs, but for those that are far above most (``ODD``).
    """
    return {name: floor for name, (floor, _) in _floors(audits).items()}


def noise_origins(audits: Iterable[Audit]) -> dict[str, str]:
    """Return what the noise floor of each output comes from, in the log that gives it."""
    return {name: origin for name, (_, origin) in _floors(audits).items()}


def _floors(audits: Iterable[Audit]) -> dict[str, tuple[float, str]]:
    readings: dict[str, list[Reading]] = {}
    for reading in (reading for found in audits for reading in found.readings):
        readings.setdefault(reading.name, []).append(reading)
    return {name: _floor(logs) for name, logs in readings.items()}


def _floor(readings: Sequence[Reading]) -> tuple[float, str]:
    least = EXACT * max(reading.high - reading.low for reading in readings)
    noisy = [reading.floor for reading in readings if reading.floor.value > least]
    if not noisy:
        return least, NO_NOISE
    usual = ODD * float(np.median([floor.value for floor in noisy]))
    largest = max((floor for floor in noisy if floor.value <= usual), key=lambda it: it.value)
    return largest.value, largest.origin


def _at_rest(log: Log, plant: Plant, readings: Sequence[Reading]) -> float:
    """Share of samples that begin or end a stretch of the log in which nothing has moved.

    Within two samples slow motion hides in noise; and a speed that does not change is no rest.
    """
    count = len(log.times)
    ahead = max(2, count // STRETCHES)
    still = np.ones(count - ahead, dtype=bool)
    for values in log.inputs.values():
        still &= values[ahead:] == values[:-ahead]
    units = {reading.name: plant.wire[reading.name].unit for reading in readings}
    has_position = any(unit in POSITIONS for unit in units.values())
    for reading in readings:
        values, hidden = log.outputs[reading.name], max(4.0 * reading.floor.value, reading.step)
        still &= np.abs(values[ahead:] - values[:-ahead]) <= hidden
        if units[reading.name] in SPEEDS and not has_position:
            still &= np.abs(values[ahead:]) <= hidden
    rest = np.zeros(count, dtype=bool)
    rest[ahead:] |= still
    rest[:-ahead] |= still
    return float(rest.mean())


# Outputs and inputs

SAME_CLOCK = 1.5  # interval over the shortest below which it is one period of a command's clock


@dataclass(frozen=True)
class Reading:
    """An output as it was read.

    Attributes:
        low, high: range.
        step: smallest common step of the readings, 0 where they have none.
        between: share of the readings between those steps: not 0 if they were resampled.
        clipped: share of the samples held at an extreme while the command moved on.
        stale: share of the moving samples that repeat the one before.
        floor: noise floor.
    """

    name: str
    low: float
    high: float
    step: float
    between: float
    clipped: float
    stale: float
    floor: Floor


@dataclass(frozen=True)
class Command:
    """An input as it was commanded.

    Attributes:
        low, high: range.
        levels: number of different values.
        changes: number of its changes.
        reversals: number of turns of its direction of change.
        clock: shortest time between changes if the others are multiples of it, else None.
        at_limit: share of the samples at a limit of the actuator's input; 0 for a flag.
        band: lowest and highest frequency [Hz] at which it would move an output above its
            noise floor, or None.
        reach: its largest value over that of the readings of the same position; 0 without such.
    """

    name: str
    low: float
    high: float
    levels: int
    changes: int
    reversals: int
    clock: float | None
    at_limit: float
    band: tuple[float, float] | None
    reach: float = 0.0


def _reading(log: Log, wire: Wire, step: Step) -> Reading:
    """Return how an output was read, with this reading step."""
    values = log.outputs[wire.name][log.counted]
    command = np.column_stack([np.zeros(len(log.times)), *log.inputs.values()])[log.counted]
    floor = Floor(FLAG, None, 0.0) if wire.flag else noise_floor(values, step.size, command)
    return Reading(
        name=wire.name,
        low=float(values.min()),
        high=float(values.max()),
        step=step.size,
        between=step.between,
        clipped=0.0 if wire.flag else clipped_share(values, command, floor.value),
        stale=0.0 if wire.flag else stale_share(values, floor.value),
        floor=floor,
    )


def _command(
    log: Log, plant: Plant, name: str, step: float, readings: Sequence[Reading]
) -> Command:
    """Return how an input was commanded, sampled every ``step`` [s] on average."""
    wire = plant.wire[name]
    values = log.inputs[wire.name]
    change = np.diff(values)
    beside = [it for name, it in log.outputs.items() if plant.wire[name].unit == wire.unit]
    moves = np.sign(change[change != 0.0])
    limited = np.ptp(values) and not wire.flag
    low, high = (np.nan if bound is None else bound for bound in (wire.low, wire.high))
    return Command(
        name=wire.name,
        low=float(values.min()),
        high=float(values.max()),
        levels=len(np.unique(values)),
        changes=len(moves),
        reversals=int(np.count_nonzero(np.diff(moves))),
        clock=_clock(log.times[1:][change != 0.0], step),
        at_limit=float(np.mean((values <= low) | (values >= high))) if limited else 0.0,
        band=_band(log, values, step, readings),
        reach=_reach(values, beside) if wire.unit in POSITIONS else 0.0,
    )


def _reach(command: Array, readings: Sequence[Array]) -> float:
    """Largest command over the largest reading, single wild ones apart; 0 without a reading."""
    largest, *others = (max(map(abs, usual_range(it))) for it in (command, *readings))
    return largest / max(others) if any(others) else 0.0


def _clock(changes: Array, step: float) -> float | None:
    """Shortest interval between changes if nearly all are multiples of it within a sample."""
    intervals = np.diff(changes)
    if len(intervals) < 3:
        return None
    shortest = float(np.percentile(intervals, 5.0))
    base = float(np.median(intervals[intervals < SAME_CLOCK * shortest]))
    off = np.abs(intervals - base * np.round(intervals / base))
    return base if np.mean(off <= 1.01 * step) > 0.9 else None


def _band(
    log: Log, values: Array, step: float, readings: Sequence[Reading]
) -> tuple[float, float] | None:
    """Lowest and highest frequency [Hz] at which the input's power, scaled to an output, is above
    the noise floor of that output, which is taken as white.
    """
    if not np.ptp(values):
        return None
    grid = np.arange(0.0, log.duration + 0.5 * step, step)
    held = values[np.searchsorted(log.times, grid + 1e-9 * step, side="right") - 1]
    length = min(len(grid), 2048)
    power = stretch_powers(held - held.mean(), hann(length)).mean(axis=0)
    frequencies = np.fft.rfftfreq(length, step)
    above = np.zeros(len(frequencies), dtype=bool)
    for reading in readings:
        gain = np.var(log.outputs[reading.name]) / np.var(values)
        above |= power * gain > reading.floor.value**2
    covered = frequencies[above & (frequencies > 0.0)]
    return (float(covered[0]), float(covered[-1])) if len(covered) else None


# What makes a log doubtful, each with its cure

STALE = 0.2  # share of moving samples that repeat the one before, above which it is told
CLIPPED = 0.01  # share of samples at a limit, or between reading steps, above which it is told
TOO_FAR = 10.0  # largest command over the largest reading above which it is asked for its unit
LEAST_STEPS_PER_RANGE = 10.0  # range of a reading over its step below which it is told


def _about_time(sampling: Sampling) -> Iterator[str]:
    if sampling.gaps:
        first = sampling.gaps[0]
        many = f"{len(sampling.gaps)} gaps, the first" if len(sampling.gaps) > 1 else "a gap"
        yield (
            f"{many} of {first.length:.3g} s after row {first.row}: what happened there is unknown;"
            " cut the log with 'window' or log again"
        )
    if sampling.rounded:
        yield (
            f"time stamps in steps of {1e3 * sampling.stamp:.4g} ms are coarser than the clock:"
            f" rows are {1e3 * sampling.step:.4g} ms apart on the whole, but on no even grid, and a"
            " time is off by up to a step of the stamps; log with finer stamps"
        )
    if sampling.jitter > max(JITTERY * sampling.step, sampling.stamp):
        yield (
            f"the sampling step jitters by {sampling.jitter / sampling.step:.0%}: time stamps must"
            " come from where the signals are read"
        )


def _about_commands(commands: Sequence[Command], commanded: bool, moves: bool) -> Iterator[str]:
    if not commanded and moves:
        yield (
            "something moves though no input ever changes: it was let go or runs on, or its command"
            " is missing; log the command if there was one"
        )
    elif not commanded:
        yield (
            "no input ever changes, and nothing moves: nothing can be determined; log a command"
            " that moves"
        )
    for command in commands:
        if command.at_limit > CLIPPED:
            yield (
                f"'{command.name}' is at the actuator's limit in {command.at_limit:.1%} of the"
                " samples: the real command may have gone on; log what was sent, or less of it"
            )
        if command.reach > TOO_FAR:
            yield (
                f"'{command.name}' goes {command.reach:.0f} times as far as anything that was read:"
                " is it in another unit, such as degrees, or another column? Correct its unit or"
                " column"
            )


def _about_ends(reading: Reading) -> Iterator[str]:
    if reading.clipped > CLIPPED:
        yield (
            f"'{reading.name}' stays at an extreme in {reading.clipped:.1%} of the samples while"
            " the command moves on: clipped reading or end stop; log smaller moves"
        )


def _about_reading(reading: Reading) -> Iterator[str]:
    name = reading.name
    if reading.stale > STALE:
        yield (
            f"'{name}' repeats the value before in {reading.stale:.0%} of the moving samples: it is"
            " read less often than logged; keep one row per reading"
        )
    if reading.between > CLIPPED and reading.step > reading.floor.residual:  # else: few digits
        yield (
            f"'{name}' lies between its steps in {reading.between:.0%} of the samples: the file was"
            " resampled, so its time stamps and noise are not those of the sensor"
        )
    if reading.high - reading.low < LEAST_STEPS_PER_RANGE * reading.step:
        yield (
            f"'{name}' moves by only {(reading.high - reading.low) / reading.step:.0f} reading"
            " steps: log larger moves or a finer sensor"
        )
