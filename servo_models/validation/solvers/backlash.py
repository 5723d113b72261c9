"""Play between shaft and output, behind the torque motor and inside the servo's loop.

Source: Nordin, Gutman, Automatica 38 (2002) 1633: the output rests while the shaft
crosses the play, and moves with the shaft at either end of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.validation.sg90 import reference as sg90
from servo_models.validation.solvers.inputs import changes
from servo_models.validation.solvers.switching import Exit, Key, Regime, Values, follow
from servo_models.validation.torque_motor.reference import Constants, Linear


@dataclass(frozen=True)
class Play:
    """x' = A x + B u, y = C x + D u with a play of +/- ``half_width`` before the output.

    The last state is the output's position.  It is still, or moves as fast as the shaft.

    Attributes:
        a, b, c, d: matrices; the last rows of ``a`` and ``b`` are 0.
        shaft: index of the shaft's position, in the unit of ``half_width``.
        turning: row that gives the shaft's speed from x.
        half_width: of the play.
        scale: full scale of each state.
        longest_step: see ``switching.Switching``.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    shaft: int
    turning: Array
    half_width: float
    scale: Sequence[float]
    longest_step: float

    @property
    def start(self) -> Sequence[float]:
        """Shaft and output rest in the middle."""
        return [0.0] * len(self.a)

    def speed(self, x: Array) -> float:
        """Speed of the shaft."""
        return float(self.turning @ x)

    def lead(self, x: Array) -> float:
        """How far the shaft is ahead of the output, at most ``half_width`` either way."""
        return float(x[self.shaft] - x[-1])

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Keys: up and down while the shaft pushes, free between."""
        touching = self.half_width * (1.0 - 1e-9)
        if self.lead(x) >= touching and self.speed(x) > 0.0:
            return "up", x
        if self.lead(x) <= -touching and self.speed(x) < 0.0:
            return "down", x
        return "free", x

    def regime(self, key: Key, u: Values) -> Regime:
        """Pushing until the shaft turns back, or free until it has crossed the play."""
        drive = self.b @ np.array(u)

        def rates(x: Array) -> Array:
            moved: Array = self.a @ x + drive
            moved[-1] = 0.0 if key == "free" else self.speed(x)
            return moved

        if key == "free":
            width, scale = self.half_width, self.scale[-1]
            ahead = Exit(lambda x: width - self.lead(x), scale, lambda x: ("up", x))
            behind = Exit(lambda x: width + self.lead(x), scale, lambda x: ("down", x))
            return Regime(rates, (ahead, behind))
        sign = 1.0 if key == "up" else -1.0
        fastest = float(np.abs(self.turning) @ np.array(self.scale))
        return Regime(
            rates, (Exit(lambda x: sign * self.speed(x), fastest, lambda x: ("free", x)),)
        )

    def outputs(self, key: Key, x: Array, u: Values) -> Sequence[float]:
        """C x + D u, then the output's speed."""
        rate = 0.0 if key == "free" else self.speed(x)
        return [*(self.c @ x + self.d @ np.array(u)), rate]


@dataclass(frozen=True)
class MotorBacklash:
    """Torque motor without stops behind whose rotor is a play of +/- ``half_width`` [rad]."""

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


@dataclass(frozen=True)
class ServoBacklash:
    """The linear servo whose output and potentiometer lag the gearbox by a play [deg]."""

    half_width: float
    k_f: float = 0.1
    k_ap: float = sg90.LOADED

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs pulse_width, load_torque."""
        linear = sg90.Linear(self.k_f, self.k_ap).system()
        a, b = np.zeros((3, 3)), np.zeros((3, 2))
        a[:2, :2], b[:2] = linear.a, linear.b
        a[1, 0], a[1, 2] = 0.0, linear.a[1, 0]
        angle, _, feedback, volts, speed = linear.c
        c = np.array([[0.0, row[1], row[0]] for row in (angle, feedback, volts, speed)])
        system = Play(
            a=a,
            b=b,
            c=c,
            d=linear.d[[0, 2, 3, 4]],
            shaft=0,
            turning=a[0],
            half_width=self.half_width,
            scale=(90.0, 600.0, 90.0),
            longest_step=0.05,
        )
        command = changes(times, sg90.VOLTS_PER_SECOND * (inputs["pulse_width"] - sg90.REST))
        columns = follow(system, times, [command, changes(times, inputs["load_torque"])])
        names = ("angle", "feedback_voltage", "motor_voltage", "motor_speed", "rate")
        out = {name: columns[:, k] for k, name in enumerate(names)}
        out["rate"] = sg90.DEGREE * out["rate"]
        out["feedback_voltage"] += sg90.VOLTS_PER_SECOND * sg90.REST / self.k_f
        return out
