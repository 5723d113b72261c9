"""A servo of second order written from its transfer function, in degrees and milliseconds.

Within its limits it is omega^2 / (s^2 + 2 zeta omega s + omega^2), solved by the matrix
exponential.  Beyond them every combination of a limited speed, a limited acceleration and a
direction of sliding is a regime with a right-hand side of its own, left at a located event.
Source: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2015, sec. 3.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.solvers import (
    Edges,
    Exit,
    Key,
    LinearSystem,
    Regime,
    Values,
    changes,
    follow,
)

CENTRE = 1.5  # pulse at rest [ms]
DEGREE = math.pi / 180.0
OUTPUTS = ("angle", "rate", "drive")
NONE = math.inf
Regimes = tuple[int, int, int]  # speed limited, acceleration limited, sliding: each -1, 0 or 1


@dataclass(frozen=True)
class Servo:
    """Constants as a data sheet would have them.

    Attributes:
        per_ms, per_degree: angle per pulse width [deg/ms] and per goal [deg/deg].
        omega, zeta: natural frequency [rad/s] and damping ratio of the bare servo.
        delay: of the command [ms].
        inertia, added: of the bare servo, and of what it carries [kg m^2].
        fastest, hardest: largest speed [deg/s] and acceleration [deg/s^2].
        friction: Coulomb friction [N m].
    """

    per_ms: float
    omega: float
    zeta: float
    delay: float
    inertia: float
    per_degree: float = 1.0
    added: float = 0.0
    fastest: float = NONE
    hardest: float = NONE
    friction: float = 0.0

    @property
    def share(self) -> float:
        """Fraction of the torque that accelerates the servo itself."""
        return self.inertia / (self.inertia + self.added)

    def signals(self, times: Array, inputs: Mapping[str, Array]) -> list[Edges]:
        """Delayed reference [deg], and acceleration by the load torque [deg/s^2]."""
        asked = self.per_ms * (1e3 * inputs["pulse_width"] - CENTRE)
        asked = asked + self.per_degree * inputs["goal"] / DEGREE
        pushed = inputs["load_torque"] / (self.inertia + self.added) / DEGREE
        return [changes(times, asked, self.delay / 1e3), changes(times, pushed)]


@dataclass(frozen=True)
class Linear:
    """The servo within its limits, solved exactly; a command, no load."""

    servo: Servo

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs pulse_width, goal, load_torque."""
        columns = self.system().response(times, self.servo.signals(times, inputs)) * DEGREE
        return {name: columns[:, k] for k, name in enumerate(OUTPUTS)}

    def system(self) -> LinearSystem:
        """From the reference and the load's acceleration to angle, rate and drive."""
        s = self.servo
        spring, damper = s.share * s.omega**2, s.share * 2.0 * s.zeta * s.omega
        slope = s.omega / (2.0 * s.zeta)
        return LinearSystem.of(
            [[0.0, 1.0], [-spring, -damper]],
            [[0.0, 0.0], [spring, -1.0]],
            [[1.0, 0.0], [0.0, 1.0], [-slope, 0.0]],
            [[0.0, 0.0], [0.0, 0.0], [slope, 0.0]],
        )


@dataclass(frozen=True)
class Limited:
    """The servo with limits of speed and acceleration, load and friction; keys are ``Regimes``."""

    servo: Servo
    start: ClassVar[Sequence[float]] = (0.0, 0.0)
    scale: ClassVar[Sequence[float]] = (90.0, 500.0)
    longest_step: ClassVar[float] = 1e-3

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs pulse_width, goal, load_torque."""
        columns = follow(self, times, self.servo.signals(times, inputs)) * DEGREE
        return {name: columns[:, k] for k, name in enumerate(OUTPUTS)}

    def asked(self, x: Array, u: Values) -> float:
        """Speed [deg/s] that the error asks for, unlimited."""
        return self.servo.omega / (2.0 * self.servo.zeta) * (u[0] - float(x[0]))

    def drive(self, fast: int, x: Array, u: Values) -> float:
        """Speed [deg/s] that the loop asks for."""
        return fast * self.servo.fastest if fast else self.asked(x, u)

    def wanted(self, fast: int, x: Array, u: Values) -> float:
        """Acceleration [deg/s^2] of the bare servo, unlimited."""
        s = self.servo
        return 2.0 * s.zeta * s.omega * (self.drive(fast, x, u) - float(x[1]))

    def net(self, fast: int, hard: int, x: Array, u: Values) -> float:
        """Acceleration [deg/s^2] without dry friction."""
        acceleration = hard * self.servo.hardest if hard else self.wanted(fast, x, u)
        return self.servo.share * acceleration - u[1]

    @property
    def dry(self) -> float:
        """Dry friction as an acceleration [deg/s^2]."""
        return self.servo.friction / (self.servo.inertia + self.servo.added) / DEGREE

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Choose all three regimes by the laws."""
        fast = _beyond(self.asked(x, u), self.servo.fastest)
        hard = _beyond(self.wanted(fast, x, u), self.servo.hardest)
        return (fast, hard, self.sliding(fast, hard, x, u)), x

    def sliding(self, fast: int, hard: int, x: Array, u: Values) -> int:
        """Direction in which it slides, or 0 where friction holds it."""
        if x[1] != 0.0:
            return int(math.copysign(1, x[1]))
        return _beyond(self.net(fast, hard, x, u), self.dry)

    def regime(self, key: Key, u: Values) -> Regime:
        """A regime that ends where a limit is met or left, at standstill and at breakaway."""
        fast, hard, way = cast("Regimes", key)
        s = self.servo

        def rates(x: Array) -> tuple[float, float]:
            if self.dry > 0.0 and way == 0:
                return 0.0, 0.0
            return float(x[1]), self.net(fast, hard, x, u) - way * self.dry

        exits = [
            *_limit(fast, s.fastest, lambda x: self.asked(x, u), lambda k: (k, hard, way)),
            *_limit(hard, s.hardest, lambda x: self.wanted(fast, x, u), lambda k: (fast, k, way)),
        ]
        if self.dry > 0.0 and way:
            exits.append(Exit(lambda x: way * float(x[1]), self.scale[1], self._halted(key, u)))
        return Regime(rates, tuple(exits))

    def _halted(self, key: Key, u: Values) -> Callable[[Array], tuple[Key, Array]]:
        fast, hard, _ = cast("Regimes", key)

        def land(x: Array) -> tuple[Key, Array]:
            still = np.array([x[0], 0.0])
            return (fast, hard, self.sliding(fast, hard, still, u)), still

        return land

    def outputs(self, key: Key, x: Array, u: Values) -> tuple[float, ...]:
        """See ``OUTPUTS``; degrees."""
        fast, _, _ = cast("Regimes", key)
        return float(x[0]), float(x[1]), self.drive(fast, x, u)


def _beyond(value: float, limit: float) -> int:
    return 0 if abs(value) <= limit else int(math.copysign(1, value))


def _limit(
    side: int, limit: float, value: Callable[[Array], float], to: Callable[[int], Key]
) -> Iterator[Exit]:
    """Ways out of a limit on ``side``, or into one of both."""
    if math.isinf(limit):
        return
    if side:
        yield Exit(lambda x: side * value(x) - limit, limit, lambda x: (to(0), x))
        return
    yield Exit(lambda x: limit - value(x), limit, lambda x: (to(1), x))
    yield Exit(lambda x: limit + value(x), limit, lambda x: (to(-1), x))
