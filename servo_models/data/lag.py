"""How much later a reading does what its command says, before any model: by least squares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from servo_models.core.plant import Plant, Wire
from servo_models.data.log import Log
from servo_models.units import exponents, factor

LONGEST = 1.0  # longest lag that is looked for [s]
COARSE = 60  # lags at which errors are computed first
FOLLOWED = 0.75  # share of a reading's variance from which it follows its command
CLOSE = 1e-5  # tolerance of the lag found [s]


@dataclass(frozen=True)
class Lag:
    """A reading beside its command, which is in the same unit.

    Attributes:
        output, command: names of the signals.
        time: shift of the command that leaves the least squared error [s].
        rows: that shift in rows of the logs.
        left: RMS of that error about its mean [SI of the output].
        explained: share of the reading's variance that the command, so shifted, explains.
    """

    output: str
    command: str
    time: float
    rows: float
    left: float
    explained: float

    @property
    def follows(self) -> bool:
        """Whether most of the reading's motion is that of the command."""
        return self.explained >= FOLLOWED

    def sentence(self, wire: Wire) -> str:
        """Return the lag in words; ``wire`` is the output."""
        unit = wire.display or wire.unit
        left = f"{self.left * factor(wire.unit, unit):.3g} {unit} RMS"
        if self.explained <= 0.0:
            return (
                f"{self.output} does not follow {self.command}: no lag explains any of its motion,"
                f" {left} are left"
            )
        late = f"{1e3 * self.time:.3g} ms ({self.rows:.1f} rows)"
        return (
            f"{self.output} follows {self.command} {late} later: that explains"
            f" {self.explained:.0%} of its variance, {left} are left"
        )


def lag_sentences(logs: Sequence[Log], plant: Plant) -> tuple[str, ...]:
    """Return every lag of ``lags`` in words."""
    return tuple(lag.sentence(plant.wire[lag.output]) for lag in lags(logs, plant))


def lags(logs: Sequence[Log], plant: Plant) -> Iterator[Lag]:
    """Yield the lag of every output that has the unit of a command, over all logs that have both.

    Args:
        logs: their commands may hold between rows; held-out samples count as well.
        plant: says the units.

    Example:
        >>> [round(lag.time, 3) for lag in lags(logs, plant)]  # s
        [0.147]
    """
    units = {wire.name: exponents(wire.unit) for wire in plant.wire.values()}
    for wire in plant.inputs:
        for output in plant.outputs:
            both = [log for log in logs if wire.name in log.inputs and output in log.outputs]
            if both and not wire.flag and units[wire.name] == units[output]:
                lag = _lag(both, wire.name, output)
                if lag:
                    yield lag


def _lag(logs: Sequence[Log], command: str, output: str) -> Lag | None:
    step = float(np.median(np.concatenate([np.diff(log.readings.times) for log in logs])))
    # rows for which every lag has a command
    rows = [log.times >= min(LONGEST, 0.5 * log.duration) for log in logs]
    moves = float(np.std(np.concatenate([it.outputs[output][k] for it, k in zip(logs, rows)])))
    if not moves or all(np.ptp(log.inputs[command]) == 0.0 for log in logs):
        return None

    def left(lag: float) -> float:
        """RMS of the error about its mean."""
        errors = [
            (it.outputs[output] - np.interp(it.times - lag, it.times, it.inputs[command]))[k]
            for it, k in zip(logs, rows)
        ]
        return float(np.std(np.concatenate(errors)))

    coarse = np.linspace(0.0, LONGEST, COARSE)
    best, spacing = float(min(coarse, key=left)), float(coarse[1])
    ends = (max(best - spacing, 0.0), min(best + spacing, LONGEST))
    best = float(minimize_scalar(left, bounds=ends, options={"xatol": CLOSE}).x)
    least = left(best)
    return Lag(output, command, best, best / step, least, 1.0 - (least / moves) ** 2)
