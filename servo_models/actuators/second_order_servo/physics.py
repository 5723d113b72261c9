"""A servo as it looks from outside: second order, with limits of speed and acceleration.

    y'' = limited(2 zeta omega (limited(omega / (2 zeta) (r - y)) - y'))

Within the limits that is y'' + 2 zeta omega y' + omega^2 y = omega^2 r.  The inner limit is the
largest speed, the outer one the largest acceleration: what a motor of limited voltage and limited
current does.  Load torque and load inertia act on the shaft, against ``inertia``.
"""

from __future__ import annotations

import math
from typing import Annotated

from servo_models.core.block import Param, block

SECOND_ORDER = "Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2015, sec. 3.3"
CASCADE = "Ellis, Control System Design Guide, 2012, ch. 17 (P position loop about a speed loop)"
REST_PULSE = 1.5e-3  # pulse in the middle of the range [s]


@block("shaft_inertia", "full_speed", "angle_unit")
def output_shaft(
    inertia: Annotated[
        float, Param("kg.m2", "inertia of the bare servo at its output", low=1e-6, high=1.0)
    ],
    speed_limit: Annotated[
        float,
        Param("rad/s", "largest speed of the output", low=0.01, high=1e4, display="deg/s"),
    ],
) -> tuple[float, float, float]:
    """Inertia [kg m^2]; speed [rad/s] that friction parameters call full; angle in radians."""
    return inertia, speed_limit, 1.0


@block("reference", source="definition")
def command_decoder(
    pulse_width: float,
    goal: float,
    pulse_gain: Annotated[
        float,
        Param(
            "rad/s",
            "angle per pulse width",
            default=math.radians(90.0) / 1e-3,
            low=-1e4,
            high=1e4,
            display="deg/ms",
        ),
    ],
    gain: Annotated[float, Param("1", "angle per goal", default=1.0, low=-10.0, high=10.0)],
) -> float:
    """Angle [rad] that is asked for; a servo has a pulse or a goal, and the other one rests."""
    return pulse_gain * (pulse_width - REST_PULSE) + gain * goal


@block("shaft_rate")
def shaft_motion(shaft_speed: float) -> float:
    """Rate of the shaft [rad/s]."""
    return shaft_speed


@block("feedback")
def position_sensor(angle: float) -> float:
    """Angle [rad] that the servo itself measures."""
    return angle


@block("error", source=SECOND_ORDER)
def comparator(reference: float, feedback: float) -> float:
    """Error [rad] of the angle as the servo sees it."""
    return reference - feedback


@block("drive", source=CASCADE)
def position_loop(
    error: float,
    natural_frequency: Annotated[
        float, Param("rad/s", "natural frequency, unloaded", low=0.1, high=1e4)
    ],
    damping_ratio: Annotated[float, Param("1", "damping ratio, unloaded", low=0.05, high=10.0)],
    speed_limit: float,
) -> float:
    """Speed [rad/s] that the error asks for, omega / (2 zeta) e, limited."""
    wanted = natural_frequency / (2.0 * damping_ratio) * error
    if wanted > speed_limit:
        return speed_limit
    if wanted < -speed_limit:
        return -speed_limit
    return wanted


@block("torque", source=CASCADE)
def net_torque(
    drive: float,
    shaft_speed: float,
    load: float,
    natural_frequency: float,
    damping_ratio: float,
    inertia: float,
    acceleration_limit: Annotated[
        float,
        Param("rad/s2", "largest acceleration of the bare servo", low=0.1, high=1e7),
    ],
) -> float:
    """Torque [N m] that accelerates the shaft: 2 zeta omega (drive - speed), limited, and load."""
    wanted = 2.0 * damping_ratio * natural_frequency * (drive - shaft_speed)
    if wanted > acceleration_limit:
        wanted = acceleration_limit
    elif wanted < -acceleration_limit:
        wanted = -acceleration_limit
    return inertia * wanted - load


@block("angle_reading", "rate_reading")
def readings(angle: float, rate: float) -> tuple[float, float]:
    """What an encoder or camera and a gyro outside of the servo read."""
    return angle, rate
