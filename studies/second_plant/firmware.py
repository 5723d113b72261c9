"""The firmware of a smart servo: encoder codes in, voltage out, once a tick.

What it commands is a table of goals, each held until the next; a goal arrives late by the delay
of the bus.  With a profile the loop follows a goal of its own, which moves no faster than that
allows.  Gain, profile and limit of the duty are those of registers; friction, play and inertia are
none of its business.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.rig.laws import CODE, Array, clip, code_of, duty


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
        duty_limit: largest duty [1].
        speed: of the profile [rad/s], 0 for none.
        acceleration_time: of the profile, from rest to that speed [s].
    """

    stiffness: float
    supply: float
    tick: float
    delay: int = 0
    noise: float = 0.0
    duty_limit: float = 1.0
    speed: float = 0.0
    acceleration_time: float = 0.0


@dataclass
class Profile:
    """The goal that the loop follows, a tick at a time, from rest at an angle of 0."""

    firmware: Firmware
    angle: float = 0.0
    speed: float = 0.0

    def toward(self, goal: float) -> float:
        """Return the angle [rad] at this tick, and go on toward a goal [rad] until the next."""
        if self.firmware.speed <= 0.0:
            return goal
        angle, left = self.angle, goal - self.angle
        if self.firmware.acceleration_time > 0.0:
            self._ramp(left)
        else:
            reach = self.firmware.speed * self.firmware.tick
            self.angle += clip(left, reach)
        return angle

    def _ramp(self, left: float) -> None:
        """Go on for a tick, at a speed from which equal steps down, one a tick, end at the goal.

        With ``w`` the speed after the tick and ``a`` the acceleration, what is left is
        tick (speed + w) / 2 + w^2 / (2 a).
        """
        most, tick = self.firmware.speed, self.firmware.tick
        step = most * tick / self.firmware.acceleration_time
        if abs(left) <= step * tick and abs(self.speed) <= step:
            self.angle, self.speed = self.angle + left, 0.0
            return
        beyond = abs(left - 0.5 * tick * self.speed) / (step * tick)
        wanted = step * (math.sqrt(0.25 + 2.0 * beyond) - 0.5)
        change = math.copysign(min(wanted, most), left - 0.5 * tick * self.speed) - self.speed
        before, self.speed = self.speed, self.speed + clip(change, step)
        self.angle += 0.5 * tick * (before + self.speed)


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
    profile = Profile(firmware)
    for now in range(total):
        code = code_of(plant.angle(), CODE, noise[now])
        row, within = divmod(now - rest, ticks)
        if row >= 0 and within == 0:
            codes[row] = code
        seen = max(now - firmware.delay - rest, 0) // ticks
        goal = profile.toward(float(goals[seen]))
        share = duty(goal, code * CODE, firmware.stiffness, firmware.duty_limit)
        plant.advance(share * firmware.supply, firmware.tick)
    return codes
