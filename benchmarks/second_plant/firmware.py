"""The firmware of a smart servo: encoder codes in, voltage out, once a tick.

What it commands is a table of goals, each held until the next; a goal arrives late by the delay
of the bus.  Position gain and limit of the duty are those of the register; friction, play and
inertia are none of its business.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CODE = 2.0 * math.pi / 4096.0
"""Angle [rad] of a code of a 12 bit encoder."""


class Plant(Protocol):
    """What the firmware moves."""

    def angle(self) -> float:
        """Angle [rad] of the output, where the encoder sits."""

    def advance(self, voltage: float, seconds: float) -> None:
        """Hold a voltage [V] on the motor for some time."""


@dataclass(frozen=True)
class Firmware:
    """A position loop.

    Attributes:
        stiffness: duty [1] per radian of error.
        supply: of the bridge [V].
        tick: of the loop [s].
        delay: ticks between a goal's time and the tick that sees it.
        noise: of the encoder before it counts [codes, standard deviation].
    """

    stiffness: float
    supply: float
    tick: float
    delay: int = 0
    noise: float = 0.0


def run(
    firmware: Firmware,
    plant: Plant,
    goals: Array,
    ticks: int,
    rest: int,
    rng: np.random.Generator,
) -> NDArray[np.int64]:
    """Return the encoder's codes at each goal's time.

    Args:
        firmware, plant: both at rest at an angle of 0.
        goals: goal angles [rad], each held for ``ticks``.
        ticks: of the loop between two rows of the log.
        rest: ticks for which the first goal is held before the log begins.
        rng: of the encoder's noise.
    """
    codes = np.empty(len(goals), dtype=np.int64)
    total = rest + ticks * len(goals)
    noise = firmware.noise * rng.standard_normal(total) if firmware.noise else np.zeros(total)
    for now in range(total):
        code = math.floor(plant.angle() / CODE + noise[now] + 0.5)
        row, within = divmod(now - rest, ticks)
        if row >= 0 and within == 0:
            codes[row] = code
        seen = max(now - firmware.delay - rest, 0) // ticks
        duty = firmware.stiffness * (float(goals[seen]) - code * CODE)
        plant.advance(min(max(duty, -1.0), 1.0) * firmware.supply, firmware.tick)
    return codes
