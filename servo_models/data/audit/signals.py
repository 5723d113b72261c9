"""The signals of a log: outputs as they were read, inputs as they were commanded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.plant import Wire
from servo_models.core.types import Array
from servo_models.data.audit.sensor import (
    clipped_share,
    noise_under_steps,
    spread_of_repeats,
    stale_share,
)
from servo_models.data.audit.steps import Step
from servo_models.data.recording import Log

QUANTUM, REPEATS, RESIDUAL = "reading step", "repeated commands", "fast residual"
FLAG = 1.0 / math.sqrt(12.0)
"""Noise floor of a reading that says yes or no."""
SAME_CLOCK = 1.5
"""Intervals below this many shortest ones are one period of a command's clock."""


@dataclass(frozen=True)
class Floor:
    """Noise floor of an output [SI]: how far readings are from the motion, root mean square.

    A reading is off by noise and, independently, by the rounding to its step: their squares add.
    Repeats show both together, and count where they show more.

    Attributes:
        quantum: reading step over the root of 12 (Widrow, Kollar, Quantization Noise, 2008,
            ch. 5), 0 for none.
        repeats: spread of the responses to repeated identical commands, None without any.
        residual: noise before the rounding, from the differences of neighbouring samples.
    """

    quantum: float
    repeats: float | None
    residual: float

    @property
    def parts(self) -> dict[str, float]:
        """Each method's figure by name."""
        return {QUANTUM: self.quantum, REPEATS: self.repeats or 0.0, RESIDUAL: self.residual}

    @property
    def value(self) -> float:
        return max(math.hypot(self.quantum, self.residual), self.repeats or 0.0)

    @property
    def origin(self) -> str:
        """Name of the method that gave the floor, or most of it."""
        if self.repeats and self.repeats >= self.value:
            return REPEATS
        return QUANTUM if self.quantum >= self.residual else RESIDUAL


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
        changes: how often it changes.
        reversals: how often its direction of change turns.
        clock: shortest time between changes if the others are multiples of it, else None.
        at_limit: share of the samples at a limit of the actuator's input; 0 for one that says yes
            or no.
        band: lowest and highest frequency [Hz] at which it would move an output above its
            noise floor, or None.
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


def read_output(log: Log, wire: Wire, found: Step) -> Reading:
    """Return how an output was read, in these steps.

    One that says yes or no has the floor of its step, 1.
    """
    name, values = wire.name, log.outputs[wire.name]
    if wire.flag:
        floor, ends = Floor(FLAG, None, 0.0), (float(values.min()), float(values.max()))
        return Reading(name, *ends, step=0.0, between=0.0, clipped=0.0, stale=0.0, floor=floor)
    step = found.size
    quantum, residual = step / math.sqrt(12.0), noise_under_steps(values, step)
    command = np.column_stack([np.zeros(len(values)), *log.inputs.values()])
    floor = Floor(quantum, spread_of_repeats(values, command), residual)
    return Reading(
        name=name,
        low=float(values.min()),
        high=float(values.max()),
        step=step,
        between=found.between,
        clipped=clipped_share(values, command, floor.value),
        stale=stale_share(values, floor.value),
        floor=floor,
    )


def read_input(log: Log, wire: Wire, step: float, readings: Sequence[Reading]) -> Command:
    """Return how an input was commanded, sampled every ``step`` [s] on the whole."""
    values = log.inputs[wire.name]
    change = np.diff(values)
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
    )


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
    """Where the input's power density, brought to the scale of an output, is above its floor.

    Source: Welch, IEEE Trans. Audio Electroacoust. 15 (1967); the floor is taken as white.
    """
    from scipy.signal import welch

    if not np.ptp(values):
        return None
    grid = np.arange(0.0, log.duration + 0.5 * step, step)
    held = values[np.searchsorted(log.times, grid + 1e-9 * step, side="right") - 1]
    rate, length = 1.0 / step, min(len(grid), 2048)
    frequencies, power = welch(held, rate, nperseg=length)
    above = np.zeros(len(frequencies), dtype=bool)
    for reading in readings:
        gain = np.var(log.outputs[reading.name]) / np.var(values)
        above |= power * gain > 2.0 * reading.floor.value**2 / rate
    covered = frequencies[above & (frequencies > 0.0)]
    return (float(covered[0]), float(covered[-1])) if len(covered) else None
