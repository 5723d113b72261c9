"""A geared motor as two masses: rotor, gear with play, output.

    J_m w_m' = k i - c_m w_m - friction - gear,   i = (V - k w_m) / R within a limit
    J_o w_o' = gear - gravity sin(a_o + phase) - c_o w_o - friction

All is seen at the output.  The gear is a spring and a damper that push only outside the play.
Steps are semi-implicit (velocities first, then angles with these).  Friction of Coulomb and
Stribeck takes from each velocity what it can within a step and stops at 0, so a mass that sticks
has a velocity of exactly 0 (Moreau's time stepping: Acary, Brogliato, Numerical Methods for
Nonsmooth Dynamical Systems, 2008, ch. 10).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field, fields
from typing import Any

import numpy as np

from servo_models.withheld.rig.laws import Array, clip, compiled, dead, pressed

STEP = 2e-5  # longest step [s]: a contact of 300 Hz takes 167 of them for a period


@dataclass(frozen=True)
class Drive:
    """A plant in SI, seen at the output.  Both engines take it.

    Attributes:
        torque_constant: also the constant of the back-EMF.
        resistance: of the winding.
        motor_inertia, output_inertia: before and behind the gear.
        motor_friction, output_friction: of Coulomb [N m].
        breakaway: friction at standstill over that of Coulomb, at least 1 (Stribeck).
        stribeck_speed: where that excess has fallen to 1/e [rad/s].
        smooth_speed: friction is proportional to tanh(speed / this) [rad/s]; 0 for stiff friction.
        motor_drag, output_drag: viscous [N m s/rad].
        play: whole free travel of the output [rad].
        contact: natural frequency [Hz] of the output on the gear.
        contact_damping: damping ratio of that.
        gravity: torque [N m] of the arm held level; at angle + ``phase`` = 0 it hangs.
        torque_limit: of the current, as the torque [N m] that it makes; 0 for none.
    """

    torque_constant: float
    resistance: float
    motor_inertia: float
    output_inertia: float
    motor_friction: float = 0.0
    output_friction: float = 0.0
    breakaway: float = 1.0
    stribeck_speed: float = 1.0
    smooth_speed: float = 0.0
    motor_drag: float = 0.0
    output_drag: float = 0.0
    play: float = 0.0
    contact: float = 200.0
    contact_damping: float = 0.3
    gravity: float = 0.0
    phase: float = 0.0
    torque_limit: float = 0.0


MOTOR_ANGLE, MOTOR_SPEED, OUTPUT_ANGLE, OUTPUT_SPEED = range(4)


@dataclass
class TwoMass:
    """The plant with its state: angle and speed of the motor, then of the output."""

    drive: Drive
    state: Array = field(default_factory=lambda: np.zeros(4))

    def __post_init__(self) -> None:
        form = [(it.name, float) for it in fields(Drive)]
        self.constants: Any = np.rec.array([astuple(self.drive)], dtype=form)[0]

    def angle(self) -> float:
        """Angle [rad] of the output."""
        return float(self.state[OUTPUT_ANGLE])

    def advance(self, voltage: float, seconds: float) -> None:
        """Hold a voltage on the motor for some time."""
        steps = max(1, math.ceil(seconds / STEP - 1e-9))
        _advance(self.state, self.constants, voltage, seconds / steps, steps)


@compiled
def _slowed(speed: float, level: float, inverse: float, c: Drive, step: float) -> float:
    """The speed of a mass of this inverse inertia after a step of dry friction."""
    if level <= 0.0:
        return speed
    if c.smooth_speed > 0.0:
        return speed - step * inverse * level * math.tanh(speed / c.smooth_speed)
    ratio = speed / c.stribeck_speed
    lost = step * inverse * level * (1.0 + (c.breakaway - 1.0) * math.exp(-ratio * ratio))
    return max(speed - lost, 0.0) if speed > 0.0 else min(speed + lost, 0.0)


@compiled
def _advance(state: Array, c: Drive, voltage: float, step: float, steps: int) -> None:
    frequency = 2.0 * math.pi * c.contact
    stiffness = c.output_inertia * frequency * frequency
    damping = 2.0 * c.contact_damping * c.output_inertia * frequency
    half = 0.5 * c.play
    a_m, w_m, a_o, w_o = state
    for _ in range(steps):
        twist, rate = a_m - a_o, w_m - w_o
        gear = stiffness * twist + damping * rate
        if half > 0.0:
            gear = pressed(dead(twist, half), rate, stiffness, damping)
        motor = c.torque_constant * (voltage - c.torque_constant * w_m) / c.resistance
        if c.torque_limit > 0.0:
            motor = clip(motor, c.torque_limit)
        weight = c.gravity * math.sin(a_o + c.phase)
        w_m += step * (motor - c.motor_drag * w_m - gear) / c.motor_inertia
        w_o += step * (gear - weight - c.output_drag * w_o) / c.output_inertia
        w_m = _slowed(w_m, c.motor_friction, 1.0 / c.motor_inertia, c, step)
        w_o = _slowed(w_o, c.output_friction, 1.0 / c.output_inertia, c, step)
        a_m += step * w_m
        a_o += step * w_o
    state[:] = a_m, w_m, a_o, w_o
