"""A linear drive in a discrete position loop (Electro-Mechanical Positioning System, EMPS).

motor and screw as one mass -> encoder -> controller with its own clock -> amplifier -> back.

    mass x'' + viscous_coefficient x' + friction sign(x') + force_offset = force_gain u

The blocks of the shaft carry it: angle reads as position [m], torque as force [N], inertia
as mass [kg].
"""

from __future__ import annotations

import math
from typing import Annotated

from servo_models.core.block import Clock, Memory, Param, block

EMPS = "Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019"
LATE = 1e-4
"""Fraction of the sample time by which a tick is late: time stamps of real logs are rounded, and
the command of a row must not miss the tick at which it was recorded."""


@block("shaft_inertia", "full_speed", "angle_unit", source=EMPS)
def carriage(
    mass: Annotated[float, Param("kg", "moved mass, motor included", low=0.1, high=1e4)],
) -> tuple[float, float, float]:
    """Moved mass; speed [m/s] that friction parameters call full; the output is in metres."""
    return mass, 0.1, 1.0


@block("shaft_rate", "position", "speed")
def carriage_motion(shaft_angle: float, shaft_speed: float) -> tuple[float, float, float]:
    """Position [m] and speed [m/s] of the carriage."""
    return shaft_speed, shaft_angle, shaft_speed


@block("reading")
def encoder(position: float) -> float:
    """Position [m] that the encoder reports."""
    return position


@block(
    "controller_voltage",
    source=f"{EMPS}; Franklin, Powell, Workman, Digital Control, 1998, sec. 8.2",
)
def position_controller(
    reading: float,
    reference: float,
    due: float,
    sample_time: Annotated[
        float,
        Param(
            "s",
            "sample time of the controller",
            default=1e-3,
            low=1e-4,
            high=0.1,
            display="ms",
            fixed=True,
        ),
    ],
    position_gain: Annotated[float, Param("1/s", "k_p", default=160.18, high=1e4)],
    speed_gain: Annotated[float, Param("V.s/m", "k_v", default=243.45, high=1e4)],
    drive_limit: Annotated[float, Param("V", "largest drive", default=10.0, low=0.1, high=1e3)],
    tick: Annotated[float, Clock()],
    last: Annotated[float, Memory()],
    last_but_one: Annotated[float, Memory()],
    held: Annotated[float, Memory()],
) -> tuple[float, float, float, float, float]:
    """u = k_v (k_p (reference - reading) - v), limited, held from tick to tick.

    v is the difference of two-sample means of the reading.
    """
    if due < tick:
        return held, tick, last, last_but_one, held
    speed = 0.5 * (reading - last_but_one) / sample_time
    wanted = speed_gain * (position_gain * (reference - reading) - speed)
    if wanted > drive_limit:
        wanted = drive_limit
    elif wanted < -drive_limit:
        wanted = -drive_limit
    tick = (math.floor(due / sample_time + LATE) + 1.0 + LATE) * sample_time
    return wanted, tick, reading, last, wanted


@block("drive", source=EMPS)
def amplifier(controller_voltage: float, disturbance: float) -> float:
    """Drive [V], disturbance included."""
    return controller_voltage + disturbance


@block("motor_voltage")
def terminals(drive: float) -> float:
    """What the motor gets of the drive [V], unless an effect says otherwise."""
    return drive


@block("load")
def external_force(load_force: float) -> float:
    """Force [N] against positive motion."""
    return load_force


@block("torque", source=EMPS)
def net_force(
    motor_voltage: float,
    load: float,
    shaft_speed: float,
    force_gain: Annotated[
        float, Param("N/V", "force per drive voltage g_tau", default=35.15, low=0.01, high=1e4)
    ],
    viscous_coefficient: Annotated[float, Param("N.s/m", "viscous friction F_v", high=1e4)],
    force_offset: Annotated[
        float, Param("N", "constant force against positive motion", low=-1e3, high=1e3)
    ],
) -> float:
    """Force [N] that accelerates the carriage, dry friction apart."""
    drag = viscous_coefficient * shaft_speed
    return force_gain * motor_voltage - drag - force_offset - load
