"""Torque motor written from its paper: eqs. 3 to 7, 9 and 12, SI units.

Source: F. Toorani, H. Farahmandzad, M. Aghamirsalim, "Gray-Box Modeling of a Pneumatic
Servo-Valve".  States are current [A], angle [rad], speed [rad/s].
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
    Play,
    Regime,
    Values,
    changes,
    follow,
)

OUTPUTS = ("angle", "rate", "current", "motor_torque", "at_stop")
STOP = 3.0 * math.pi / 180.0  # half range [rad]
DELAY = 0.0011  # delay of the voltage [s]
TORQUE = 0.05  # full scale of torque [N m]


@dataclass(frozen=True)
class Constants:
    """Constants of eqs. 3 to 7, named as in the paper, and the delay of the voltage [s]."""

    k_t: float
    k_b: float
    r: float
    l: float  # noqa: E741
    j: float
    k_f: float
    k_s: float
    delay: float = 0.0

    def equation_9(self) -> tuple[float, tuple[float, float, float, float]]:
        """Numerator and denominator of eq. 9."""
        jl = self.j * self.l
        s1 = (self.r * self.k_f + self.k_b * self.k_t + self.k_s * self.l) / jl
        s2 = self.k_f / self.j + self.r / self.l
        return self.k_t / jl, (1.0, s2, s1, self.r * self.k_s / jl)


TABLE_1 = Constants(6.432, 0.08, 3630.0, 34.0, 7.246e-7, 2.7e-4, 1.1)
TABLE_2 = Constants(5.23, 0.08, 3630.0, 29.9, 7.246e-7, 2.7e-4, 1.1)
EQ_12 = (241560.0, (1.0, 492.0, 1582240.0, 184512000.0))


def _constants_of_eq_12() -> Constants:
    """Constants that make eq. 9 equal eq. 12 with R, J, K_s of Table 1, by elimination.

    Unknowns, linear in this order: 1/(J L) from the last coefficient, K_t, K_f, K_b.
    """
    r, j, k_s = TABLE_1.r, TABLE_1.j, TABLE_1.k_s
    gain, (_, s2, s1, s0) = EQ_12
    per_jl = s0 / (r * k_s)
    inductance = 1.0 / (per_jl * j)
    k_t = gain / per_jl
    k_f = (s2 - r / inductance) * j
    k_b = (s1 / per_jl - r * k_f - k_s * inductance) / k_t
    return Constants(k_t, k_b, r, inductance, j, k_f, k_s, DELAY)


IDENTIFIED = _constants_of_eq_12()


def _inputs(inputs: Mapping[str, Array], times: Array, delay: float) -> list[Edges]:
    voltage = changes(times, inputs["voltage"], delay)
    return [voltage, changes(times, inputs["load_torque"])]


@dataclass(frozen=True)
class Linear:
    """Eqs. 3 to 7 without stops, solved exactly."""

    constants: Constants

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs voltage, load_torque."""
        signals = _inputs(inputs, times, self.constants.delay)
        columns = self.system().response(times, signals)
        named = {name: columns[:, k] for k, name in enumerate(OUTPUTS[:4])}
        return {**named, "at_stop": np.zeros(len(times))}

    def system(self) -> LinearSystem:
        """Inputs voltage (after its delay) and load torque."""
        k = self.constants
        return LinearSystem.of(
            [
                [-k.r / k.l, 0.0, -k.k_b / k.l],
                [0.0, 0.0, 1.0],
                [k.k_t / k.j, -k.k_s / k.j, -k.k_f / k.j],
            ],
            [[1.0 / k.l, 0.0], [0.0, 0.0], [0.0, -1.0 / k.j]],
            [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [k.k_t, 0.0, 0.0]],
            [[0.0, 0.0]] * 4,
        )


@dataclass(frozen=True)
class Equation12:
    """Angle and rate from the expanded form of eq. 12 with its delay, by python-control."""

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; input voltage."""
        gain, poles = EQ_12
        signals = [changes(times, inputs["voltage"], DELAY)]
        angle = LinearSystem.transfer([gain], poles).response(times, signals)
        rate = LinearSystem.transfer([gain, 0.0], poles).response(times, signals)
        return {"angle": angle[:, 0], "rate": rate[:, 0]}


@dataclass(frozen=True)
class Contact:
    """Eqs. 3 to 7 with inelastic stops and dry friction.

    ``stop`` is the half range [rad], infinite for none.  Friction is ``friction`` [N m],
    more by ``excess`` exp(-(v / stribeck)^2); at rest it holds any torque up to that.
    """

    constants: Constants
    stop: float = math.inf
    friction: float = 0.0
    excess: float = 0.0
    stribeck: float = 1.0
    start: ClassVar[Sequence[float]] = (0.0, 0.0, 0.0)
    scale: ClassVar[Sequence[float]] = (0.01, 0.05, 50.0)
    longest_step: ClassVar[float] = 2e-4

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs voltage, load_torque."""
        signals = _inputs(inputs, times, self.constants.delay)
        columns = follow(self, times, signals)
        return {name: columns[:, k] for k, name in enumerate(OUTPUTS)}

    def torque(self, x: Array, u: Values) -> float:
        """Torque [N m] on the rotor without dry friction."""
        k = self.constants
        return float(k.k_t * x[0] - k.k_s * x[1] - k.k_f * x[2] - u[1])

    def sliding(self, speed: float) -> float:
        """Dry friction [N m] at a speed [rad/s]."""
        return self.friction + self.excess * math.exp(-((speed / self.stribeck) ** 2))

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Keys: stop, stuck, forward, backward."""
        if x[2] != 0.0:
            return ("forward" if x[2] > 0.0 else "backward"), x
        torque = self.torque(x, u)
        if abs(x[1]) >= self.stop and torque * x[1] > 0.0:
            return "stop", x
        if abs(torque) <= self.sliding(0.0) and self.sliding(0.0) > 0.0:
            return "stuck", x
        return ("forward" if torque > 0.0 else "backward"), x

    def regime(self, key: Key, u: Values) -> Regime:
        """On a stop, stuck, or moving."""
        k = self.constants

        def current(x: Array) -> float:
            return float((u[0] - k.r * x[0] - k.k_b * x[2]) / k.l)

        def standing(x: Array) -> tuple[float, float, float]:
            return current(x), 0.0, 0.0

        def moving(x: Array) -> tuple[float, float, float]:
            dry = direction * self.sliding(float(x[2]))
            return current(x), float(x[2]), (self.torque(x, u) - dry) / k.j

        def again(x: Array) -> tuple[Key, Array]:
            return self.enter(x, u)

        def halted(x: Array) -> tuple[Key, Array]:
            return self.enter(np.array([x[0], x[1], 0.0]), u)

        def landed(x: Array) -> tuple[Key, Array]:
            return self.enter(np.array([x[0], math.copysign(self.stop, x[1]), 0.0]), u)

        hold = self.sliding(0.0)
        if key == "stop":
            push = Exit(lambda x: self.torque(x, u) * math.copysign(1.0, x[1]), TORQUE, again)
            return Regime(standing, (push,))
        if key == "stuck":
            up = Exit(lambda x: hold - self.torque(x, u), TORQUE, again)
            down = Exit(lambda x: hold + self.torque(x, u), TORQUE, again)
            return Regime(standing, (up, down))
        direction = 1.0 if key == "forward" else -1.0
        exits = []
        if hold > 0.0:
            exits.append(Exit(lambda x: direction * float(x[2]), self.scale[2], halted))
        if math.isfinite(self.stop):
            exits.append(Exit(lambda x: self.stop - abs(float(x[1])), self.stop, landed))
        return Regime(moving, tuple(exits))

    def outputs(self, key: Key, x: Array, u: Values) -> tuple[float, ...]:
        """See ``OUTPUTS``; SI."""
        on_stop = 1.0 if abs(float(x[1])) >= self.stop else 0.0
        return float(x[1]), float(x[2]), float(x[0]), self.constants.k_t * float(x[0]), on_stop


@dataclass(frozen=True)
class TwoMasses:
    """The output is the load's side of the spring; the load torque acts there.

    ``compliance`` [rad/(N m)], ``inertia`` of the load [kg m^2], ``damping`` ratio of the
    load on its spring with the rotor held.
    """

    constants: Constants
    compliance: float
    inertia: float
    damping: float

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs voltage, load_torque."""
        voltage = changes(times, inputs["voltage"], self.constants.delay)
        signals = [voltage, changes(times, inputs["load_torque"])]
        columns = self.system().response(times, signals)
        named = {name: columns[:, k] for k, name in enumerate(OUTPUTS[:4])}
        return {**named, "at_stop": np.zeros(len(times))}

    def system(self) -> LinearSystem:
        """States current, rotor angle and speed, load angle and speed."""
        k, stiffness = self.constants, 1.0 / self.compliance
        drag = 2.0 * self.damping * math.sqrt(self.inertia * stiffness)
        twist = np.array([0.0, stiffness, drag, -stiffness, -drag])
        rotor_torque = np.array([k.k_t, -k.k_s, -k.k_f, 0.0, 0.0])
        a = [
            np.array([-k.r / k.l, 0.0, -k.k_b / k.l, 0.0, 0.0]),
            np.eye(5)[2],
            (rotor_torque - twist) / k.j,
            np.eye(5)[4],
            twist / self.inertia,
        ]
        b = np.zeros((5, 2))
        b[0, 0], b[4, 1] = 1.0 / k.l, -1.0 / self.inertia
        c = np.array([np.eye(5)[3], np.eye(5)[4], np.eye(5)[0], k.k_t * np.eye(5)[0]])
        return LinearSystem(np.array(a), b, c, np.zeros((4, 2)))


@dataclass(frozen=True)
class MotorBacklash:
    """Torque motor without stops, with a play of +/- ``half_width`` [rad] behind the rotor."""

    constants: Constants
    half_width: float

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs voltage, load_torque."""
        linear, k = Linear(self.constants).system(), self.constants
        a, b = np.zeros((4, 4)), np.zeros((4, 2))
        a[:3, :3], b[:3] = linear.a, linear.b
        system = Play(
            a=a,
            b=b,
            c=np.array([np.eye(4)[3], np.eye(4)[0], k.k_t * np.eye(4)[0]]),
            d=np.zeros((3, 2)),
            shaft=1,
            turning=np.eye(4)[2],
            half_width=self.half_width,
            scale=(0.01, 0.05, 50.0, 0.05),
            longest_step=2e-4,
        )
        voltage = changes(times, inputs["voltage"], k.delay)
        columns = follow(system, times, [voltage, changes(times, inputs["load_torque"])])
        names = ("angle", "current", "motor_torque", "rate")
        return {name: columns[:, k] for k, name in enumerate(names)}
