"""Sketch: a smart servo (XL330, STS3215): P loop in firmware on encoder counts, pendulum.

No block of its own knows of time: the loop's clock is the effect sample_hold on the duty.
Source of the loop factor: (4096 / 2 pi) / (256 x 885) duty per gain unit and radian.
"""

from __future__ import annotations

import math
from typing import Annotated

from plants.bench import step_constant
from servo_models.actuator import Plant, State, Wire, place
from servo_models.block import Param, block
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.load_friction import load_friction
from servo_models.effects.quantisation import quantisation
from servo_models.effects.sample_hold import sample_hold
from servo_models.effects.saturation import saturation
from servo_models.effects.stribeck_friction import stribeck_friction
from servo_models.plants.shaft import shaft_acceleration, shaft_contact
from servo_models.plants.shaft_defaults import external_load, free_shaft

COUNT = 2.0 * math.pi / 4096.0


@block("shaft_inertia", "full_speed", "angle_unit")
def arm(
    inertia: Annotated[float, Param("kg.m2", "arm and rotor", default=6e-3, high=1.0)],
) -> tuple[float, float, float]:
    """Inertia, the speed [rad/s] that friction parameters call full, angles in radians."""
    return inertia, 10.0, 1.0


@block("reading", "angle")
def encoder(shaft_angle: float) -> tuple[float, float]:
    """Measured angle, and the angle that gravity sees [rad]."""
    return shaft_angle, shaft_angle


@block("duty")
def position_loop(
    goal: float,
    reading: float,
    gain: Annotated[float, Param("1", "position gain", default=400.0, high=2000.0)],
) -> float:
    """Duty cycle that the P loop asks for."""
    return gain * 0.0028773 * (goal - reading)


@block("torque")
def dc_motor(
    duty: float,
    enabled: float,
    supply: float,
    load: float,
    shaft_speed: float,
    torque_constant: Annotated[float, Param("N.m/A", "k_t at the output", default=0.6, high=5.0)],
    resistance: Annotated[float, Param("Ohm", "winding resistance", default=4.0, high=100.0)],
) -> float:
    """Torque [N m] that accelerates the arm; switched off, the winding is open."""
    if enabled <= 0.5:
        return -load
    current = (duty * supply - torque_constant * shaft_speed) / resistance
    return torque_constant * current - load


@block("rate")
def arm_rate(shaft_speed: float) -> float:
    """Speed [rad/s]."""
    return shaft_speed


PLANT = Plant(
    inputs=(
        Wire("goal", "rad", "goal position", scale=math.pi),
        Wire("enabled", "1", "torque enable", rest=1.0, flag=True),
        Wire("supply", "V", "supply", rest=7.4, scale=7.4),
        Wire("load_torque", "N.m", "load"),
    ),
    wires=(
        Wire("reading", "rad", "measured angle"),
        Wire("angle", "rad", "angle of the arm"),
        Wire("duty", "1", "duty cycle"),
        Wire("friction", "N.m", "dry friction"),
        Wire("load", "N.m", "load"),
    ),
    chain=(
        arm,
        free_shaft,
        encoder,
        place("encoder_quantum", quantisation, "reading"),
        position_loop,
        place("duty_limit", saturation, "duty"),
        place("firmware", sample_hold, "duty"),
        external_load,
        place("gravity", gravity_load, "load"),
        place("coulomb", coulomb_friction, "friction"),
        place("stribeck", stribeck_friction, "friction"),
        place("load_friction", load_friction, "friction"),
        arm_rate,
        dc_motor,
        shaft_acceleration,
    ),
    states=(
        State(Wire("shaft_angle", "rad", "angle"), "rate"),
        State(Wire("shaft_speed", "rad/s", "speed"), "acceleration"),
    ),
    projection=shaft_contact,
    outputs=("shaft_angle", "shaft_speed", "duty"),
    constants=step_constant(5e-4),
)

TYPICAL = {
    "encoder_quantum.step": COUNT,
    "duty_limit.limit": 1.0,
    "firmware.period": 1e-3,
    "gravity.torque": 0.48,
    "coulomb.level": 0.02,
    "stribeck.excess": 0.02,
    "stribeck.speed": 0.02,
    "load_friction.coefficient": 0.15,
}
