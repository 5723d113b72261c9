"""Sketch: a linear drive inside a discrete position loop (EMPS benchmark).

M x'' + F_v x' + F_c sign(x') + offset = g_tau u, with u from a controller at 1 kHz:
u = k_v (k_p (q_g - q_m) - v_f), one sample late, v_f the difference of two-sample means,
limited to +/- 10 V.  The shaft blocks carry it: angle reads as position [m], torque as
force [N], inertia as mass [kg].
"""

from __future__ import annotations

import math
from typing import Annotated

from plants.bench import step_constant
from servo_models.actuator import Plant, State, Wire, place
from servo_models.block import Clock, Memory, Param, block
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.quantisation import quantisation
from servo_models.plants.shaft import shaft_acceleration, shaft_contact
from servo_models.plants.shaft_defaults import free_shaft


@block("shaft_inertia", "angle_unit")
def carriage(
    mass: Annotated[float, Param("kg", "moved mass", default=95.1, high=1e3)],
) -> tuple[float, float]:
    """The mass of motor and carriage; the position moves by its speed."""
    return mass, 1.0


@block("reading")
def encoder(shaft_angle: float) -> float:
    """The measured position [m]."""
    return shaft_angle


@block("drive")
def position_controller(
    reading: float,
    reference: float,
    due: float,
    sample_time: Annotated[float, Param("s", "sample time", default=1e-3, high=1.0)],
    position_gain: Annotated[float, Param("1/s", "k_p", default=160.18, high=1e4)],
    speed_gain: Annotated[float, Param("V.s/m", "k_v", default=243.45, high=1e4)],
    limit: Annotated[float, Param("V", "largest drive", default=10.0, high=100.0)],
    tick: Annotated[float, Clock()],
    last: Annotated[float, Memory()],
    last_but_one: Annotated[float, Memory()],
    waiting: Annotated[float, Memory()],
    applied: Annotated[float, Memory()],
) -> tuple[float, float, float, float, float, float]:
    """What was computed at the tick before is applied at this one."""
    if due < tick:
        return applied, tick, last, last_but_one, waiting, applied
    speed = 0.5 * ((reading + last) - (last + last_but_one)) / sample_time
    wanted = speed_gain * (position_gain * (reference - reading) - speed)
    if wanted > limit:
        wanted = limit
    elif wanted < -limit:
        wanted = -limit
    tick = (math.floor(due / sample_time) + 1.0) * sample_time
    return waiting, tick, reading, last, wanted, waiting


@block("torque")
def net_force(
    drive: float,
    shaft_speed: float,
    force_gain: Annotated[float, Param("N/V", "g_tau", default=35.15, high=1e3)],
    viscous: Annotated[float, Param("N.s/m", "F_v", default=203.5, high=1e4)],
    offset: Annotated[float, Param("N", "offset", default=-3.16, low=-100.0, high=100.0)],
) -> float:
    """Force [N] that accelerates the carriage."""
    return force_gain * drive - viscous * shaft_speed - offset


@block("rate")
def carriage_rate(shaft_speed: float) -> float:
    """Speed [m/s]."""
    return shaft_speed


PLANT = Plant(
    inputs=(Wire("reference", "m", "reference position", scale=0.2),),
    wires=(
        Wire("reading", "m", "measured position", scale=0.2),
        Wire("drive", "V", "drive voltage", scale=10.0),
        Wire("friction", "N", "dry friction", scale=100.0),
    ),
    chain=(
        carriage,
        free_shaft,
        place("coulomb", coulomb_friction, "friction"),
        encoder,
        place("encoder_quantum", quantisation, "reading"),
        position_controller,
        carriage_rate,
        net_force,
        shaft_acceleration,
    ),
    states=(
        State(Wire("shaft_angle", "m", "position"), "rate"),
        State(Wire("shaft_speed", "m/s", "speed"), "acceleration"),
    ),
    projection=shaft_contact,
    outputs=("shaft_angle", "shaft_speed", "drive"),
    constants=step_constant(5e-4),
)
