"""What linear theory says of the attitude loops: phase margins, and the limit cycle of a play.

Servo, airframe and autopilot are linearised; the first two are discretised exactly over one frame
of the autopilot, with every delay between its command and the surface.  A loop is opened at one
command of the autopilot, the others stay closed.  python-control does the algebra and reads the
margins.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from pathlib import Path

import control
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

import servo_models as sm
from servo_models.analysis.linear_model import LinearModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
HERE = Path(__file__).parent
LOOPS = ("aileron", "elevator", "rudder")
READINGS = ("roll", "pitch", "roll_rate", "pitch_rate", "yaw_rate")
SURFACES = {"aileron": {"left_aileron": 1.0, "right_aileron": -1.0}}
"""What a command moves, where it is not the surface of its name."""
LOWEST, POINTS = 0.3, 4000
"""Frequencies: from there [rad/s] to half a turn a frame."""


def own(name: str) -> sm.Model:
    """Return a model that is declared in a file beside this one."""
    return sm.model(str(HERE / f"{name}.py"))


@dataclass(frozen=True)
class Margin:
    """Of one loop: phase margin [rad], and the frequency [rad/s] at which it is read."""

    phase: float
    crossover: float


@dataclass(frozen=True)
class LimitCycle:
    """A steady oscillation: amplitudes [rad] of the fundamental, and frequency [rad/s].

    The describing function does not say that of the attitude.
    """

    surface: float
    frequency: float
    attitude: float = math.nan


class Loops:
    """The loops of the UAV with one kind of servo, linear."""

    def __init__(self, servo: sm.Model, step: float) -> None:
        """Linearise.

        Args:
            servo: has an input ``pulse_width`` and an output ``angle``.
            step: communication step [s] of the FMUs.
        """
        pilot, self.servo = own("autopilot"), sm.linearise(servo)
        self.frame = pilot.values["frame"]
        # a command reaches the servos a step late; an ideal servo answers another step later,
        # and the angle of a real one is held over each step
        late = step + (0.5 * step if self.servo.states else step)
        plant = _sampled(
            _series(self.servo, sm.linearise(own("airframe")), pilot.values["pulse_per_angle"]),
            late + sum(self.servo.delays.values()),
            self.frame,
        )
        whole = _law(sm.linearise(pilot)) * plant
        self.open = {}
        for k, name in enumerate(LOOPS):
            others = control.ss([], [], [], np.diag([float(j != k) for j in range(3)]), self.frame)
            self.open[name] = control.feedback(whole, others)[k, k]

    def response(self, name: str, frequencies: ArrayLike) -> Complex:
        """Return minus the command that comes back over the one that was given, at [rad/s]."""
        found = control.frd(self.open[name], np.atleast_1d(frequencies))
        return np.asarray(found.frdata[0, 0], dtype=complex)

    def margin(self, name: str) -> Margin:
        """Return the least phase margin of a loop."""
        grid = np.geomspace(LOWEST, 0.999 * math.pi / self.frame, POINTS)
        _, phase, _, crossover = control.margin(control.frd(self.open[name], grid))
        return Margin(math.radians(phase), float(crossover))

    def limit_cycle(self, name: str, half_width: float) -> LimitCycle | None:
        """Return the limit cycle that a play in the gears of the servos makes, None without one.

        The play lies between the motor and the horn, whose angle is fed back in the servo.  With
        g from the horn to the motor and l the loop, the motor returns what the horn was given
        where N(x) (g + l + l g) = -1 for an amplitude x of the motor.
        """
        grid = np.geomspace(LOWEST, 0.5 * math.pi / self.frame, 500)

        def excess(frequency: float) -> float:
            wanted = self._wanted_gain(name, frequency)
            share = _share_of_phase(cmath.phase(wanted))
            return math.log(abs(wanted) / abs(_play(share))) if share else math.nan

        values = [excess(frequency) for frequency in grid]
        for k in range(len(grid) - 2, -1, -1):  # the fastest is the stable one
            if values[k] * values[k + 1] < 0.0:
                frequency = brentq(excess, grid[k], grid[k + 1])
                wanted = self._wanted_gain(name, frequency)
                motor = half_width / _share_of_phase(cmath.phase(wanted))
                return LimitCycle(abs(wanted) * motor, float(frequency))
        return None

    def _wanted_gain(self, name: str, frequency: float) -> complex:
        """What the play has to be for an oscillation to keep up."""
        hertz = [frequency / (2.0 * math.pi), 0.0]
        late = cmath.exp(1j * frequency * sum(self.servo.delays.values()))
        answer, static = self.servo.response(hertz, "pulse_width", "angle")
        closed = complex(answer * late / static.real)
        inner = closed / (1.0 - closed)
        loop = complex(self.response(name, frequency)[0])
        return -1.0 / (inner + loop + loop * inner)


def _series(
    servo: LinearModel, airframe: LinearModel, pulse_per_angle: float
) -> control.StateSpace:
    """Readings over commands: one servo for each command, then the airframe."""
    a, b, c, d = airframe.matrices()
    rows = [airframe.outputs.index(name) for name in READINGS]
    moved = np.array(
        [[SURFACES.get(k, {k: 1.0}).get(name, 0.0) for k in LOOPS] for name in airframe.inputs]
    )
    servos = control.append(*[control.ss(*servo.channel("pulse_width", "angle"))] * len(LOOPS))
    return control.ss(a, b @ moved, c[rows], d[rows] @ moved) * servos * pulse_per_angle


def _sampled(plant: control.StateSpace, late: float, frame: float) -> control.StateSpace:
    """The plant from frame to frame, its input held, and ``late`` [s].

    Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 4.3.
    """
    frames, part = divmod(late, frame)
    before, after = (control.c2d(plant, time) for time in (part, frame - part))
    n, m = len(plant.A), plant.ninputs
    later = control.ss(  # further states: the commands of the frame before
        np.block([[after.A @ before.A, after.A @ before.B], [np.zeros((m, n + m))]]),
        np.vstack([after.B, np.eye(m)]),
        np.hstack([plant.C, np.zeros((plant.noutputs, m))]),
        plant.D,
        frame,
    )
    hold = control.ss(np.zeros((m, m)), np.eye(m), np.eye(m), np.zeros((m, m)), frame)
    for _ in range(int(frames)):
        later = later * hold
    return later


def _law(pilot: LinearModel) -> control.StateSpace:
    """Minus the commands over the readings: the autopilot, from frame to frame."""
    a, b, c, d = pilot.matrices()
    rows = [pilot.outputs.index(name) for name in LOOPS]
    columns = [pilot.inputs.index(name) for name in READINGS]
    return control.ss(a, b[:, columns], -c[rows], -d[np.ix_(rows, columns)], pilot.period)


def _play(share: float) -> complex:
    """Describing function of a play whose half width is this share of the amplitude before it.

    Source: Slotine, Li, Applied Nonlinear Control, 1991, sec. 5.2 (backlash).
    """
    rest = 1.0 - 2.0 * share
    real = 0.5 * math.pi + math.asin(rest) + 2.0 * rest * math.sqrt(share * (1.0 - share))
    return complex(real, -4.0 * share * (1.0 - share)) / math.pi


def _share_of_phase(phase: float) -> float:
    """The share at which a play has this phase [rad], 0 for none."""
    low, high = 1e-9, 1.0 - 1e-9

    def excess(share: float) -> float:
        return cmath.phase(_play(share)) - phase

    return float(brentq(excess, low, high)) if excess(low) > 0.0 > excess(high) else 0.0
