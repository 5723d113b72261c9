"""A rig of certain true constants that plays certain commands, with any causes acting on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.bench import SUPPLY, Bench
from servo_models.withheld.generator.chain import Command, Sensor, read, travelled
from servo_models.withheld.generator.excitation import Plan
from servo_models.withheld.generator.foreign import Outside, disturbed
from servo_models.withheld.generator.physics import run
from servo_models.withheld.generator.rig import Rig

Array = NDArray[np.float64]

STAGES = (Rig, Command, Sensor, Outside)
RECORD = np.dtype([(name, float) for name in Rig._fields])


@dataclass(frozen=True)
class Experiment:
    """A rig and its plans.

    Attributes:
        bench: which rig.
        true: its constants by the product's names [SI].
        load: constant load torque [N m].
        plans: one per log.
        readings: places of what is logged, the judged one first.
        seed: of what comes and goes by itself.
    """

    bench: Bench
    true: Mapping[str, float]
    load: float
    plans: Sequence[Plan]
    readings: tuple[int, ...]
    seed: int

    @cached_property
    def units(self) -> dict[str, float]:
        return self.bench.units(self.true)

    @cached_property
    def plain(self) -> tuple[Array, ...]:
        """Logs without any cause."""
        return self.logs({})

    def logs(self, settings: Mapping[str, float]) -> tuple[Array, ...]:
        """Return noise-free logs [SI], one of shape (rows, readings) per plan."""
        every = {**self.bench.constants(self.true), "load": self.load, **settings}
        unknown = set(every) - {name for stage in STAGES for name in stage._fields}
        if unknown:
            raise KeyError(f"no such settings: {sorted(unknown)}")
        return tuple(self._log(plan, every, i) for i, plan in enumerate(self.plans))

    def gap(self, logs: Sequence[Array]) -> float:
        """Return the RMS difference [SI] of the judged reading from that without any cause."""
        apart = np.concatenate([a[:, 0] - b[:, 0] for a, b in zip(logs, self.plain)])
        return float(np.sqrt(np.mean(apart * apart)))

    @cached_property
    def ranges(self) -> Array:
        """Range of every reading without any cause [SI], shape (readings,)."""
        return np.asarray(np.ptp(np.concatenate(self.plain), axis=0))

    def _log(self, plan: Plan, settings: Mapping[str, float], number: int) -> Array:
        step = self.bench.step
        before = round(self.bench.settle / step)
        held = np.repeat(plan.command, plan.stride)[: -plan.stride + 1 or None]
        command = np.concatenate([np.full(before, plan.command[0]), held])
        outside, lost = disturbed(
            settings, len(command), step, self.bench.slowest, self.seed + number
        )
        seen = np.empty((len(command), 3))
        drive = travelled(command, lost, _some(Command, settings), step)
        rig: Any = np.rec.array([tuple(_some(Rig, settings))], dtype=RECORD)[0]
        run(rig, np.column_stack([drive, outside]), step, seen)
        seen[:, 0] = read(seen[:, 0].copy(), _some(Sensor, settings), step)
        if settings.get("servo"):
            seen[:, 1] *= SUPPLY
            seen[:, 2] *= self.true["potentiometer_gain"]
        return seen[before :: plan.stride][:, self.readings]


def _some(stage: Any, settings: Mapping[str, float]) -> Any:
    """The settings of one stage."""
    return stage(**{name: settings[name] for name in stage._fields if name in settings})
