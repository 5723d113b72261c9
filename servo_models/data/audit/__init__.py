"""Audit a measured log before any model sees it: sampling, readings, commands, noise floor.

Everything here is read off the log alone; what it can determine about a model is told by
``excitation``.  All figures are SI.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.plant import Plant
from servo_models.data.audit.doubts import doubts
from servo_models.data.audit.outliers import about_outliers
from servo_models.data.audit.sampling import Gap, Sampling, sampling
from servo_models.data.audit.signals import Command, Floor, Reading, read_input, read_output
from servo_models.data.audit.steps import NO_STEP, Step, reading_steps
from servo_models.data.recording import Log

__all__ = [
    "Audit",
    "Command",
    "Floor",
    "Gap",
    "Reading",
    "Sampling",
    "audit",
    "audits",
    "noise_floors",
    "noise_origins",
]

EXACT = 1e-6
"""A reading without steps or noise counts as exact to this share of its range."""
NO_NOISE = "millionth of the range, no noise"
"""The origin of such a floor."""
ODD = 3.0
"""Medians of all logs above which the floor of one is its own: of two logs both always count."""


@dataclass(frozen=True, eq=False)
class Audit:
    """What a log is worth.

    ``at_rest`` is the share of samples in which nothing moves; ``outliers`` names single readings
    far from their neighbours, one sentence an output.
    """

    log: Log
    sampling: Sampling
    commands: tuple[Command, ...]
    readings: tuple[Reading, ...]
    at_rest: float
    outliers: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What makes the log doubtful, one sentence each with its cure."""
        return (*self.outliers, *doubts(self.sampling, self.commands, self.readings))


def audit(log: Log, plant: Plant) -> Audit:
    """Audit a log of an actuator with this plant, by itself.

    The high-frequency residual supposes samples that are almost evenly spaced.
    """
    return audits([log], plant)[0]


def audits(logs: Sequence[Log], plant: Plant) -> tuple[Audit, ...]:
    """Audit logs of an actuator with this plant; those of one sensor share its reading step.

    A sensor is an output from a column of one name, unit and scale.
    """
    steps = _steps(logs, plant)
    return tuple(_audit(log, plant, found) for log, found in zip(logs, steps))


def _steps(logs: Sequence[Log], plant: Plant) -> list[dict[str, Step]]:
    """The reading step of each output, by log."""
    sensors: dict[tuple[str, str, str, float], list[int]] = {}
    for i, log in enumerate(logs):
        for name in log.outputs:
            channel = log.channels[name]
            sensor = (name, channel.column, channel.unit, channel.scale)
            sensors.setdefault(sensor, []).append(i)
    found: list[dict[str, Step]] = [{} for _ in logs]
    for (name, *_), members in sensors.items():
        if plant.wire[name].flag:
            steps = [NO_STEP] * len(members)
        else:
            steps = reading_steps([logs[i].outputs[name] for i in members])
        for i, step in zip(members, steps):
            found[i][name] = step
    return found


def _audit(log: Log, plant: Plant, steps: Mapping[str, Step]) -> Audit:
    clock = sampling(log)
    readings = tuple(read_output(log, plant.wire[name], steps[name]) for name in log.outputs)
    commands = tuple(read_input(log, plant.wire[name], clock.step, readings) for name in log.inputs)
    odd = tuple(text for name in log.outputs for text in about_outliers(log, plant.wire[name]))
    return Audit(log, clock, commands, readings, _at_rest(log, readings), odd)


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


def _at_rest(log: Log, readings: Sequence[Reading]) -> float:
    still = np.ones(len(log.times) - 2, dtype=bool)
    for values in log.inputs.values():
        still &= values[2:] == values[:-2]
    for reading in readings:
        values = log.outputs[reading.name]
        still &= np.abs(values[2:] - values[:-2]) <= max(4.0 * reading.floor.value, reading.step)
    return float(still.mean())
