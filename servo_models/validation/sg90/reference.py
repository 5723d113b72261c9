"""SG90 servo written from its paper, in its units: volts, rad/s of the motor, degrees.

Source: S. Kochuk et al., "Methodology of synthesis nonlinear mathematical model of a
servo"; secs. 4.1 to 4.4, eqs. 5 to 7.  The angle is counted from the middle of the
potentiometer, where the servo rests at a pulse of 1.5 ms.  ``RealServo`` is another one: the
servo that people have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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
    sampled,
)

VOLTS_PER_SECOND = 5.0 / 0.020  # command [V] over pulse [s]
REST = 1.5e-3  # pulse in the middle of the range [s]
K_FS = 0.025  # potentiometer [V/deg]
GEAR = 24.0  # turns of the motor in a turn of the output
POLE = 1.307  # pole of the motor, negated [1/s]
VOLTS_PER_LOAD = 1.923 / 0.1765  # motor voltage over load torque [V/(N m)]
LOADED = 7.47  # gain of the amplifier with a load [V/V]
UNLOADED = 5.79  # gain of the amplifier without a load [V/V]
STOP = 90.0  # half range [deg]
DEGREE = math.pi / 180.0

LINE = 425.64  # slope of the characteristic [rad/s/V]
CURVE = (
    (-math.inf, -1.5, 0.0, -544.0),
    (-1.5, -0.6, LINE, 1.5 * LINE - 544.0),
    (-0.6, 0.5, 0.0, 0.0),
    (0.5, 0.6 + (670.0 - 106.76) / LINE, LINE, 106.76 - 0.6 * LINE),
    (0.6 + (670.0 - 106.76) / LINE, math.inf, 0.0, 670.0),
)
"""Motor characteristic by pieces: from and to [V], slope [rad/s/V], value at 0 V [rad/s]."""

OUTPUTS = ("angle", "rate", "feedback_voltage", "motor_voltage", "motor_speed", "saturated")


def _named(columns: Array) -> dict[str, Array]:
    return {name: columns[:, k] for k, name in enumerate(OUTPUTS)}


@dataclass(frozen=True)
class Linear:
    """The servo of eq. 7: no frame, no limits.

    ``degrees`` is the output angle in the paper's degrees per motor radian over the gear:
    1 as printed, 180/pi read strictly.  ``rejected`` takes the motor of eq. 5 for eq. 6.
    """

    k_f: float = 0.1
    k_ap: float = LOADED
    degrees: float = 1.0
    rejected: bool = False

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Exact response; inputs pulse_width, load_torque, supply_voltage."""
        command = changes(times, VOLTS_PER_SECOND * (inputs["pulse_width"] - REST))
        load = changes(times, inputs["load_torque"])
        columns = self.system().response(times, [command, load])
        out = _named(np.column_stack([columns, np.zeros(len(times))]))
        out["feedback_voltage"] += VOLTS_PER_SECOND * REST / self.k_f
        full = np.abs(out["motor_voltage"]) >= np.abs(inputs["supply_voltage"])
        out["saturated"] = full.astype(float)
        return out

    def system(self) -> LinearSystem:
        """States angle [deg], motor speed [rad/s] (and its rate); inputs command [V], load."""
        turn = self.degrees / GEAR
        back = -self.k_ap * self.k_f * K_FS
        static, rest = (686.9, 2.255) if self.rejected else (633.3, POLE)
        drive = [static * self.k_ap, -static * VOLTS_PER_LOAD]
        a = [[0.0, turn], [static * back, -rest]]
        b = [[0.0, 0.0], drive]
        c = [[DEGREE, 0.0], [0.0, turn * DEGREE], [K_FS, 0.0], [back, 0.0], [0.0, 1.0]]
        if self.rejected:
            a = [[0.0, turn, 0.0], [0.0, 0.0, 1.0], [static * back, -rest, -3.434e-11]]
            b = [[0.0, 0.0], *b]
            c = [[*row, 0.0] for row in c]
        d = [[0.0, 0.0]] * 3 + [[self.k_ap, 0.0], [0.0, 0.0]]
        return LinearSystem.of(a, b, c, d)


def equation_7_coefficients(
    k_f: float = 0.1, k_ap: float = LOADED
) -> tuple[float, tuple[float, float, float]]:
    """Numerator and denominator of angle [deg] over command [V], unrounded (eq. 7, K_f = 0.1)."""
    gain = 633.3 * k_ap / GEAR
    return gain, (1.0, POLE, gain * k_f * K_FS)


def equation_7(k_f: float = 0.1, k_ap: float = LOADED) -> LinearSystem:
    """Eq. 7 as a system."""
    gain, poles = equation_7_coefficients(k_f, k_ap)
    return LinearSystem.transfer([gain], poles)


def equation_7_response(times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
    """Angle [rad] by eq. 7; input pulse_width."""
    command = changes(times, VOLTS_PER_SECOND * (inputs["pulse_width"] - REST))
    return {"angle": DEGREE * equation_7().response(times, [command])[:, 0]}


@dataclass(frozen=True)
class Printed:
    """The servo element by element: frame, levels, supply, motor characteristic, stops."""

    k_f: float = 0.1
    k_ap: float = LOADED
    start: ClassVar[Sequence[float]] = (0.0, 0.0)
    scale: ClassVar[Sequence[float]] = (90.0, 600.0)
    longest_step: ClassVar[float] = 0.05

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs pulse_width, load_torque, supply_voltage."""
        pulses = sampled(changes(times, inputs["pulse_width"]), 0.020, float(times[-1]))
        level = 5.0 / 1024.0
        command: Edges = []
        for time, pulse in pulses:
            volts = level * math.floor(VOLTS_PER_SECOND * pulse / level)
            if not command or volts != command[-1][1]:
                command.append((time, volts))
        others = [changes(times, inputs[name]) for name in ("load_torque", "supply_voltage")]
        return _named(follow(self, times, [command, *others]))

    def wanted(self, x: Array, u: Values) -> float:
        """Voltage [V] that the amplifier would give without a limit."""
        rest = VOLTS_PER_SECOND * REST / self.k_f
        return self.k_ap * (u[0] - self.k_f * (rest + K_FS * float(x[0])))

    def pieces(self, u: Values) -> list[tuple[float, float, float, float]]:
        """Characteristic over the wanted voltage: from, to, slope, value at 0."""
        lost, limit = VOLTS_PER_LOAD * u[1], abs(u[2])
        edges = [low + lost for low, *_ in CURVE[1:]]
        cuts = sorted([-limit, limit, *(edge for edge in edges if -limit < edge < limit)])
        made = []
        for low, high in zip([-math.inf, *cuts], [*cuts, math.inf]):
            inside = low + 1.0 if high == math.inf else high - 1.0
            inside = 0.5 * (low + high) if math.isfinite(low + high) else inside
            applied = min(max(inside, -limit), limit) - lost
            slope, at_0 = next((s, f) for a, b, s, f in CURVE if a <= applied <= b)
            if abs(inside) > limit:
                made.append((low, high, 0.0, slope * applied + at_0))
            else:
                made.append((low, high, slope, at_0 - slope * lost))
        return made

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """Find the piece of the characteristic, and whether a stop still holds."""
        volts = self.wanted(x, u)
        piece = next(k for k, (a, b, _, _) in enumerate(self.pieces(u)) if a <= volts <= b)
        return self._rest_or_go(piece, x, u)

    def _rest_or_go(self, piece: int, x: Array, u: Values) -> tuple[Key, Array]:
        """A regime on a stop: nothing moves while the servo is pushed against it."""
        _, _, slope, at_0 = self.pieces(u)[piece]
        push = slope * self.wanted(x, u) + at_0
        held = x[1] == 0.0 and abs(x[0]) >= STOP and push * x[0] > 0.0
        return ("stop" if held else piece), x

    def regime(self, key: Key, u: Values) -> Regime:
        """On a stop, or on a piece of the characteristic."""
        if key == "stop":
            return Regime(lambda x: (0.0, 0.0))
        assert isinstance(key, int)
        low, high, slope, at_0 = self.pieces(u)[key]

        def rates(x: Array) -> tuple[float, float]:
            return x[1] / GEAR, POLE * (slope * self.wanted(x, u) + at_0 - x[1])

        def landed(x: Array) -> tuple[Key, Array]:
            return self._rest_or_go(key, np.array([math.copysign(STOP, x[0]), 0.0]), u)

        exits = [
            Exit(lambda x: STOP - float(x[0]), STOP, landed),
            Exit(lambda x: STOP + float(x[0]), STOP, landed),
        ]
        if math.isfinite(low):
            exits.append(Exit(lambda x: self.wanted(x, u) - low, 1.0, lambda x: (key - 1, x)))
        if math.isfinite(high):
            exits.append(Exit(lambda x: high - self.wanted(x, u), 1.0, lambda x: (key + 1, x)))
        return Regime(rates, tuple(exits))

    def outputs(self, key: Key, x: Array, u: Values) -> tuple[float, ...]:
        """See ``OUTPUTS``; SI."""
        wanted, limit = self.wanted(x, u), abs(u[2])
        volts = min(max(wanted, -limit), limit)
        drive = volts - VOLTS_PER_LOAD * u[1]
        top = drive >= CURVE[-1][0] or drive <= CURVE[0][1]
        rest = VOLTS_PER_SECOND * REST / self.k_f
        speed = float(x[1])
        return (
            float(x[0]) * DEGREE,
            speed / GEAR * DEGREE,
            rest + K_FS * float(x[0]),
            volts,
            speed,
            1.0 if top or abs(volts) >= limit else 0.0,
        )


@dataclass(frozen=True)
class ServoBacklash:
    """The linear servo whose output and potentiometer lag the gearbox by a play [deg]."""

    half_width: float
    k_f: float = 0.1
    k_ap: float = LOADED

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs pulse_width, load_torque."""
        linear = Linear(self.k_f, self.k_ap).system()
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
        command = changes(times, VOLTS_PER_SECOND * (inputs["pulse_width"] - REST))
        columns = follow(system, times, [command, changes(times, inputs["load_torque"])])
        names = ("angle", "feedback_voltage", "motor_voltage", "motor_speed", "rate")
        out = {name: columns[:, k] for k, name in enumerate(names)}
        out["rate"] = DEGREE * out["rate"]
        out["feedback_voltage"] += VOLTS_PER_SECOND * REST / self.k_f
        return out


REAL_T = 0.0347  # time constant of the motor [s]
REAL_G = 51.1  # gain of the motor [rad/s/V]
REAL_A = 77.7  # gain of the amplifier [V/V]
REAL_DELAY = 0.0289  # delay of the command [s]
REAL_BACK = VOLTS_PER_SECOND * 1856e-6 / math.pi  # k_f k_FS [V/rad]
REAL_VOLTS_PER_LOAD = 4.8 / 0.1765  # motor voltage over load torque [V/(N m)]


@dataclass(frozen=True)
class RealServo:
    """A real SG90 as its steps show it: first-order motor, drive limit, delayed command.

    theta' = w / 24, T w' = G u - w, u = A (U - K_f k_FS theta) limited to the supply, less the
    volts of a load; in SI.  The structure is that of eqs. 2 and 6, with K_f k_FS such that 544 to
    2400 us are 180 degrees.  States angle [rad] from that of 1.5 ms, and motor speed [rad/s].
    """

    start: ClassVar[Sequence[float]] = (0.0, 0.0)
    scale: ClassVar[Sequence[float]] = (1.6, 250.0)
    longest_step: ClassVar[float] = 2e-3
    middle: ClassVar[float] = REST

    def __call__(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Response with located events; inputs pulse_width, load_torque, supply_voltage."""
        pulses = changes(times, inputs["pulse_width"], REAL_DELAY, REST)
        others = [changes(times, inputs[name]) for name in ("load_torque", "supply_voltage")]
        return _named(follow(self, times, [pulses, *others]))

    def wanted(self, x: Array, u: Values) -> float:
        """Voltage [V] that the amplifier would give without a limit."""
        return REAL_A * (VOLTS_PER_SECOND * (u[0] - self.middle) - REAL_BACK * float(x[0]))

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """At either limit, or between."""
        wanted, limit = self.wanted(x, u), abs(u[2])
        return ("low" if wanted < -limit else "high" if wanted > limit else "free"), x

    def regime(self, key: Key, u: Values) -> Regime:
        """One side of a limit or between them."""
        limit = abs(u[2])

        def rates(x: Array) -> tuple[float, float]:
            volts = {"low": -limit, "high": limit}.get(str(key), self.wanted(x, u))
            pull = REAL_G * (volts - REAL_VOLTS_PER_LOAD * u[1])
            return x[1] / GEAR, (pull - x[1]) / REAL_T

        above = Exit(lambda x: self.wanted(x, u) + limit, 1.0, lambda x: ("low", x))
        below = Exit(lambda x: limit - self.wanted(x, u), 1.0, lambda x: ("high", x))
        if key == "free":
            return Regime(rates, (above, below))
        inward = -1.0 if key == "low" else 1.0
        back = Exit(lambda x: inward * self.wanted(x, u) - limit, 1.0, lambda x: ("free", x))
        return Regime(rates, (back,))

    def outputs(self, key: Key, x: Array, u: Values) -> tuple[float, ...]:
        """See ``OUTPUTS``; SI."""
        limit = abs(u[2])
        volts = min(max(self.wanted(x, u), -limit), limit)
        angle, speed = float(x[0]), float(x[1])
        feedback = (VOLTS_PER_SECOND * self.middle + REAL_BACK * angle) / 0.1
        full = 1.0 if abs(volts) >= limit else 0.0
        return angle, speed / GEAR, feedback, volts, speed, full


STILL = "still"
FRICTION = 0.00355  # dry friction [N m]
SLOWING = FRICTION * REAL_G * REAL_VOLTS_PER_LOAD / REAL_T  # of the motor by it [rad/s2]
TRAVEL = 95.0 * DEGREE  # to either side [rad]
FEWEST = 400e-6  # a shorter pulse is none [s]


class Airframe(RealServo):
    """That servo between stops that it hits without a bounce, with dry friction, and without torque
    where there are no pulses.  A regime is a drive and a direction of motion.
    """

    middle: ClassVar[float] = 0.5 * (544e-6 + 2400e-6)

    def wanted(self, x: Array, u: Values) -> float:
        """Voltage [V] that the amplifier would give without a limit."""
        return super().wanted(x, u) if u[0] >= FEWEST else 0.0

    def pull(self, drive: str, x: Array, u: Values) -> float:
        """Acceleration [rad/s^2] of the motor without friction."""
        loss = REAL_G * REAL_VOLTS_PER_LOAD * u[1]
        if u[0] < FEWEST:
            return -loss / REAL_T
        limit = abs(u[2])
        volts = {"low": -limit, "high": limit}.get(drive, self.wanted(x, u))
        return (REAL_G * volts - loss - float(x[1])) / REAL_T

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        """The drive, and which way it moves."""
        drive = str(super().enter(x, u)[0])
        if x[1] != 0.0:
            return f"{drive} {'up' if x[1] > 0.0 else 'down'}", x
        return self.from_standstill(drive, x, u)

    def from_standstill(self, drive: str, x: Array, u: Values) -> tuple[Key, Array]:
        """It stays where friction or a stop holds it."""
        pull = self.pull(drive, x, u)
        at_stop = abs(x[0]) >= TRAVEL and pull * x[0] > 0.0
        if at_stop or abs(pull) <= SLOWING:
            return STILL, x
        return f"{drive} {'up' if pull > 0.0 else 'down'}", x

    def regime(self, key: Key, u: Values) -> Regime:
        """At rest until something changes, or moving with one drive."""
        if key == STILL:
            return Regime(lambda x: (0.0, 0.0))
        drive, way = str(key).split()
        sign, limit = (1.0 if way == "up" else -1.0), abs(u[2])

        def rates(x: Array) -> tuple[float, float]:
            return float(x[1]) / GEAR, self.pull(drive, x, u) - sign * SLOWING

        def halted(x: Array) -> tuple[Key, Array]:
            return self.from_standstill(drive, np.array([x[0], 0.0]), u)

        def struck(x: Array) -> tuple[Key, Array]:
            return self.from_standstill(drive, np.array([sign * TRAVEL, 0.0]), u)

        def now(other: str) -> Callable[[Array], tuple[Key, Array]]:
            return lambda x: (f"{other} {way}", x)

        exits = [
            Exit(lambda x: sign * float(x[1]), 250.0, halted),
            Exit(lambda x: TRAVEL - sign * float(x[0]), TRAVEL, struck),
        ]
        if drive == "free":
            exits.append(Exit(lambda x: limit + self.wanted(x, u), 1.0, now("low")))
            exits.append(Exit(lambda x: limit - self.wanted(x, u), 1.0, now("high")))
        else:
            inward = -1.0 if drive == "low" else 1.0
            exits.append(Exit(lambda x: inward * self.wanted(x, u) - limit, 1.0, now("free")))
        return Regime(rates, tuple(exits))
