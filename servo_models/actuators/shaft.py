"""A rigid shaft with exact standstill and inelastic end stops, shared by all actuators.

Friction effects only raise one level, ``friction`` [N m], which may depend on speed: its
value at zero speed is the breakaway torque.  The law of motion with it is written here
once.  Within a sub-step the direction of sliding is the one at its start, so the
Runge-Kutta stages see a smooth right hand side; the projection then puts a reversal right.
Source: Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30 (1994), sec. 3.
"""

from __future__ import annotations

from typing import Annotated

from servo_models.core.block import Mode, block


@block("acceleration")
def shaft_acceleration(
    torque: float,
    friction: float,
    shaft_inertia: float,
    travel: float,
    shaft_speed: float,
    start_shaft_angle: float,
    start_shaft_speed: float,
    sliding: Annotated[float, Mode()],
) -> tuple[float, float]:
    """Acceleration [rad/s^2] of the shaft under ``torque`` [N m], friction and stops.

    At rest nothing moves until the torque exceeds ``friction``; on a stop (half range
    ``travel`` [rad], 0 for none) nothing moves until the torque points back.  With friction
    the direction of sliding is a mode, so reversal and breakaway are located.
    """
    sliding = 0.0
    if friction > 0.0:
        if shaft_speed > 0.0:
            sliding = 1.0
        elif shaft_speed < 0.0:
            sliding = -1.0
    if start_shaft_speed > 0.0:
        return (torque - friction) / shaft_inertia, sliding
    if start_shaft_speed < 0.0:
        return (torque + friction) / shaft_inertia, sliding
    if travel > 0.0:
        if start_shaft_angle >= travel and torque > 0.0:
            return 0.0, sliding
        if start_shaft_angle <= -travel and torque < 0.0:
            return 0.0, sliding
    if abs(torque) <= friction:
        return 0.0, sliding
    if torque > 0.0:
        return (torque - friction) / shaft_inertia, sliding
    return (torque + friction) / shaft_inertia, sliding


@block("shaft_angle", "shaft_speed")
def shaft_contact(
    shaft_angle: float,
    shaft_speed: float,
    start_shaft_speed: float,
    torque: float,
    friction: float,
    shaft_inertia: float,
    angle_unit: float,
    travel: float,
    dt: float,
) -> tuple[float, float]:
    """State after a sub-step of ``dt`` [s]: standstill at a reversal, rest at a stop.

    A step that reversed used the friction of the old direction to its end.  From the
    instant of zero speed on friction points the other way: the shaft either sticks where
    it was then, or has lost twice the friction impulse, and the way that goes with it.
    """
    if friction > 0.0 and start_shaft_speed * shaft_speed < 0.0:
        since = dt * shaft_speed / (shaft_speed - start_shaft_speed)
        lost = 2.0 * friction / shaft_inertia * since
        if abs(torque) <= friction or abs(shaft_speed) <= lost:
            lost = abs(shaft_speed)
        if shaft_speed < 0.0:
            lost = -lost
        shaft_speed = shaft_speed - lost
        shaft_angle = shaft_angle - 0.5 * angle_unit * lost * since
    if travel > 0.0 and shaft_angle >= travel:
        shaft_angle = travel
        if shaft_speed > 0.0:
            shaft_speed = 0.0
    if travel > 0.0 and shaft_angle <= -travel:
        shaft_angle = -travel
        if shaft_speed < 0.0:
            shaft_speed = 0.0
    return shaft_angle, shaft_speed


@block("friction", "travel")
def free_shaft() -> tuple[float, float]:
    """No dry friction and no stops, unless an effect says so."""
    return 0.0, 0.0


@block("load_rate", "load_acceleration")
def no_second_mass() -> tuple[float, float]:
    """Nothing moves behind the shaft, unless an effect says so."""
    return 0.0, 0.0


@block("residual", "since_reversal")
def no_residual() -> tuple[float, float]:
    """Nothing is learnt, unless a residual map says so."""
    return 0.0, 0.0


@block(
    "coasting_inertia",
    "play_twist",
    "play_slip",
    "coasting_rate",
    "coasting_torque",
    "coasting_acceleration",
)
def no_play() -> tuple[float, float, float, float, float, float]:
    """Nothing coasts behind a play, unless an effect says so."""
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@block("load")
def external_load(load_torque: float) -> float:
    """Load torque [N m] against positive motion."""
    return load_torque


@block("shaft_angle", "shaft_speed")
def driven_shaft(
    joint_position: float, joint_velocity: float, joint_acceleration: float, input_age: float
) -> tuple[float, float]:
    """Angle and speed of a joint that a physics engine moves, at constant acceleration from its
    last point on."""
    gained = joint_acceleration * input_age
    angle = joint_position + (joint_velocity + 0.5 * gained) * input_age
    return angle, joint_velocity + gained


@block("load")
def unloaded() -> float:
    """No load [N m] from outside: a physics engine has it."""
    return 0.0


@block("angle", "rate")
def shaft_output(shaft_angle: float, shaft_rate: float) -> tuple[float, float]:
    """The output is the shaft."""
    return shaft_angle, shaft_rate
