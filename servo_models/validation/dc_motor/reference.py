"""A DC motor written from its circuit, seen at the motor: everything else is over the gear ratio.

    L di/dt = v - R i - k w,    J dw/dt = k i - b w - load / N

Within its limits every form is linear and solved by the matrix exponential.  The speed loop with
its limit is followed from one located event to the next.
Source: Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2015, sec. 2.3; Astrom,
Hagglund, Advanced PID Control, 2006, sec. 3.5.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

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

OUTPUTS = ("encoder_angle", "encoder_speed", "current")


@dataclass(frozen=True)
class Motor:
    """Constants of a data sheet.

    Attributes:
        k: torque constant [mN m/A].
        j: inertia of the rotor [g cm^2], and of what turns with it.
        b: viscous friction [mN m s/rad].
        ratio: of the gearbox.
    """

    k: float
    j: float
    b: float
    ratio: float = 1.0

    @property
    def per_ampere(self) -> float:
        """Acceleration [rad/s^2] of a current."""
        return self.k * 1e-3 / (self.j * 1e-7)

    @property
    def slowing(self) -> float:
        """Inverse of the time constant of drag alone [1/s]."""
        return self.b * 1e-3 / (self.j * 1e-7)

    def pushed(self, times: Array, load: Array) -> Edges:
        """Acceleration [rad/s^2] of the motor by a load at the output [N m]."""
        return changes(times, load / self.ratio / (self.j * 1e-7))

    def named(self, columns: Array) -> dict[str, Array]:
        """Outputs from angle, speed and current of the motor."""
        outputs = {name: columns[:, k] for k, name in enumerate(OUTPUTS)}
        angle, speed, _ = columns.T
        return {**outputs, "angle": angle / self.ratio, "rate": speed / self.ratio}


@dataclass(frozen=True)
class OnVoltage:
    """The motor on a voltage; resistance [Ohm], inductance [mH], 0 for none."""

    motor: Motor
    resistance: float
    inductance: float = 0.0

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs voltage, load_torque."""
        signals = [
            changes(times, inputs["voltage"]),
            self.motor.pushed(times, inputs["load_torque"]),
        ]
        return self.motor.named(self.system().response(times, signals))

    def system(self) -> LinearSystem:
        """States angle, speed and, with an inductance, current."""
        m, emf = self.motor, self.motor.k * 1e-3
        if self.inductance == 0.0:
            drag = m.slowing + m.per_ampere * emf / self.resistance
            return LinearSystem.of(
                [[0.0, 1.0], [0.0, -drag]],
                [[0.0, 0.0], [m.per_ampere / self.resistance, -1.0]],
                [[1.0, 0.0], [0.0, 1.0], [0.0, -emf / self.resistance]],
                [[0.0, 0.0], [0.0, 0.0], [1.0 / self.resistance, 0.0]],
            )
        slow = self.inductance * 1e-3
        return LinearSystem.of(
            [
                [0.0, 1.0, 0.0],
                [0.0, -m.slowing, m.per_ampere],
                [0.0, -emf / slow, -self.resistance / slow],
            ],
            [[0.0, 0.0], [0.0, -1.0], [1.0 / slow, 0.0]],
            np.eye(3).tolist(),
            [[0.0, 0.0]] * 3,
        )


@dataclass(frozen=True)
class OnCurrent:
    """The motor on a current."""

    motor: Motor

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs current_command, load_torque."""
        m = self.motor
        system = LinearSystem.of(
            [[0.0, 1.0], [0.0, -m.slowing]],
            [[0.0, 0.0], [m.per_ampere, -1.0]],
            [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]],
            [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]],
        )
        signals = [
            changes(times, inputs["current_command"]),
            m.pushed(times, inputs["load_torque"]),
        ]
        return m.named(system.response(times, signals))


@dataclass(frozen=True)
class InSpeedLoop:
    """The motor under i = limited(K e + I), T I' = i - I; the key is the side of the limit.

    Attributes:
        gain: K [A s/rad].
        time: T [s].
        limit: of the current [A].
        position_gain: of a position loop around it [1/s], 0 for none.
    """

    motor: Motor
    gain: float
    time: float
    limit: float
    position_gain: float = 0.0
    start: ClassVar[Sequence[float]] = (0.0, 0.0, 0.0)
    scale: ClassVar[Sequence[float]] = (10.0, 300.0, 5.0)
    longest_step: ClassVar[float] = 5e-3

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs speed_command, position_command, load_torque."""
        position = self.position_gain * inputs["position_command"]
        asked = changes(times, inputs["speed_command"] + position)
        columns = follow(self, times, [asked, self.motor.pushed(times, inputs["load_torque"])])
        return self.motor.named(columns)

    def wanted(self, x: Array, u: Values) -> float:
        """Current [A] that the loop asks for, unlimited."""
        asked = u[0] - self.position_gain * float(x[0])
        return self.gain * (asked - float(x[1])) + float(x[2])

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Side of the limit: -1, 0 within, 1."""
        wanted = self.wanted(x, u)
        return (0 if abs(wanted) <= self.limit else int(math.copysign(1, wanted))), x

    def current(self, key: Key, x: Array, u: Values) -> float:
        """Current [A]."""
        return self.wanted(x, u) if key == 0 else self.limit if key == 1 else -self.limit

    def regime(self, key: Key, u: Values) -> Regime:
        """Within the limit, or on one side of it."""
        m = self.motor

        def rates(x: Array) -> tuple[float, float, float]:
            current = self.current(key, x, u)
            faster = m.per_ampere * current - m.slowing * float(x[1]) - u[1]
            return float(x[1]), faster, (current - float(x[2])) / self.time

        if key == 0:
            up = Exit(lambda x: self.limit - self.wanted(x, u), self.limit, lambda x: (1, x))
            down = Exit(lambda x: self.limit + self.wanted(x, u), self.limit, lambda x: (-1, x))
            return Regime(rates, (up, down))
        side = 1.0 if key == 1 else -1.0
        back = Exit(lambda x: side * self.wanted(x, u) - self.limit, self.limit, lambda x: (0, x))
        return Regime(rates, (back,))

    def outputs(self, key: Key, x: Array, u: Values) -> tuple[float, ...]:
        """See ``OUTPUTS``."""
        return float(x[0]), float(x[1]), self.current(key, x, u)

    def system(self) -> LinearSystem:
        """The loop within its limit: states angle, speed, integral."""
        m, k = self.motor, self.gain
        push = m.per_ampere
        return LinearSystem.of(
            [[0.0, 1.0, 0.0], [0.0, -m.slowing - push * k, push], [0.0, -k / self.time, 0.0]],
            [[0.0, 0.0], [push * k, -1.0], [k / self.time, 0.0]],
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -k, 1.0]],
            [[0.0, 0.0], [0.0, 0.0], [k, 0.0]],
        )
