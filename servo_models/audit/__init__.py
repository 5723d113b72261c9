"""Audit a measured log before any model sees it: sampling, readings, commands, noise floor.

Everything here is read off the log alone; what it can determine about a model is told by
``excitation``.  All figures are SI.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.actuator import Plant
from servo_models.audit.doubts import doubts
from servo_models.audit.outliers import about_outliers
from servo_models.audit.sampling import Gap, Sampling, sampling
from servo_models.audit.signals import Command, Floor, Reading, read_input, read_output
from servo_models.recording import Log

__all__ = ["Audit", "Command", "Floor", "Gap", "Reading", "Sampling", "audit", "noise_floors"]

EXACT = 1e-6
"""A reading without steps or noise counts as exact to this share of its range."""
NO_NOISE = "millionth of the range, no noise"
"""The origin of such a floor."""


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
    """Audit a log of an actuator with this plant.

    The high-frequency residual supposes samples that are almost evenly spaced.
    """
    clock = sampling(log)
    readings = tuple(read_output(log, plant.wire[name]) for name in log.outputs)
    commands = tuple(read_input(log, plant.wire[name], clock.step, readings) for name in log.inputs)
    odd = tuple(text for name in log.outputs for text in about_outliers(log, plant.wire[name]))
    return Audit(log, clock, commands, readings, _at_rest(log, readings), odd)


def noise_floors(audits: Iterable[Audit]) -> dict[str, float]:
    """Return the noise floor [SI] of each output: the largest of its logs, above 0."""
    floors: dict[str, float] = {}
    for reading in (reading for found in audits for reading in found.readings):
        least = EXACT * (reading.high - reading.low)
        floors[reading.name] = max(floors.get(reading.name, least), reading.floor.value)
    return floors


def _at_rest(log: Log, readings: Sequence[Reading]) -> float:
    still = np.ones(len(log.times) - 2, dtype=bool)
    for values in log.inputs.values():
        still &= values[2:] == values[:-2]
    for reading in readings:
        values = log.outputs[reading.name]
        still &= np.abs(values[2:] - values[:-2]) <= max(4.0 * reading.floor.value, reading.step)
    return float(still.mean())
