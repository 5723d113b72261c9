"""A DC or brushless motor with an encoder, with and without a gearbox and a speed loop.

Three actuators stand on these blocks, since each has one main input: ``dc_motor`` on a voltage,
``dc_motor_current`` on a current, ``dc_motor_speed`` on a speed by a PI loop that gives a current,
and on a position by a P loop around that.
Everything is seen at the output: J = N^2 J_m, torque N k i, drag N^2 b; without a gearbox N = 1.
The encoder sits on the motor and sees no play or twist behind it; ``angle`` is behind both.
The inductance is a lag of the current, L / R: the effect ``winding_lag``.  Backlash, compliance and
friction of a gearbox are effects of the catalogue too.
"""

from __future__ import annotations

from typing import Annotated

from servo_models.core.block import Param, block

MOTOR = "Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2015, sec. 2.3"
CASCADE = "ODrive documentation, Control (position, velocity and current loops in a cascade)"
ANTI_WINDUP = "Astrom, Hagglund, Advanced PID Control, 2006, sec. 3.5 (automatic reset, tracking)"


@block("shaft_inertia", "full_speed", "angle_unit", source=MOTOR)
def rotor(
    rotor_inertia: Annotated[float, Param("kg.m2", "inertia of the rotor", low=1e-8, high=1.0)],
    rated_speed: Annotated[
        float, Param("rad/s", "rated speed of the motor", low=0.1, high=1e4, fixed=True)
    ],
    gear_ratio: Annotated[
        float, Param("1", "gear ratio, 1 for no gearbox", default=1.0, low=0.01, high=1e4)
    ],
) -> tuple[float, float, float]:
    """Inertia [kg m^2] at the output, speed [rad/s] that friction parameters call full; radians."""
    return gear_ratio * gear_ratio * rotor_inertia, rated_speed / gear_ratio, 1.0


@block("shaft_rate")
def shaft_motion(shaft_speed: float) -> float:
    """Rate of the shaft [rad/s]."""
    return shaft_speed


@block("encoder_angle", "encoder_speed")
def encoder(shaft_angle: float, shaft_speed: float, gear_ratio: float) -> tuple[float, float]:
    """Angle [rad] and speed [rad/s] of the motor."""
    return gear_ratio * shaft_angle, gear_ratio * shaft_speed


@block("motor_voltage")
def terminals(voltage: float) -> float:
    """What the motor gets of the voltage [V], unless an effect says otherwise."""
    return voltage


@block("current", source=f"{MOTOR}; inductance neglected")
def winding(
    motor_voltage: float,
    shaft_speed: float,
    gear_ratio: float,
    torque_constant: Annotated[
        float, Param("N.m/A", "torque constant of the motor", low=1e-4, high=100.0)
    ],
    resistance: Annotated[float, Param("Ohm", "resistance of the winding", low=1e-3, high=1e4)],
) -> float:
    """Current [A]: what the voltage leaves over the back EMF."""
    return (motor_voltage - torque_constant * gear_ratio * shaft_speed) / resistance


@block("current", source="a current loop far faster than the motor")
def current_loop(current_command: float) -> float:
    """Current [A] of the motor."""
    return current_command


@block("speed_reference", source=CASCADE)
def position_loop(
    speed_command: float,
    position_command: float,
    encoder_angle: float,
    position_gain: Annotated[
        float, Param("1/s", "gain of the position loop, 0 for none", high=1e4)
    ],
    speed_limit: Annotated[
        float, Param("rad/s", "largest speed that is asked for, 0 for no limit", high=1e5)
    ],
) -> float:
    """Speed [rad/s] that the speed loop is asked for: commanded, and by the error of position."""
    wanted = speed_command
    if position_gain > 0.0:
        wanted = wanted + position_gain * (position_command - encoder_angle)
    if speed_limit > 0.0 and wanted > speed_limit:
        wanted = speed_limit
    elif speed_limit > 0.0 and wanted < -speed_limit:
        wanted = -speed_limit
    return wanted


@block("current_command", "integral_rate", source=ANTI_WINDUP)
def speed_loop(
    speed_reference: float,
    encoder_speed: float,
    integral: float,
    speed_gain: Annotated[
        float, Param("A.s/rad", "gain of the speed loop K, at the motor", high=1e3)
    ],
    integral_time: Annotated[
        float, Param("s", "integral time T_i of the speed loop, 0 for no integral", high=1e3)
    ],
    current_limit: Annotated[float, Param("A", "largest current", low=1e-3, high=1e3)],
) -> tuple[float, float]:
    """i = limited(K e + I), I' = (i - I) / T_i, so that I' = K e / T_i within the limit."""
    wanted = speed_gain * (speed_reference - encoder_speed) + integral
    if wanted > current_limit:
        wanted = current_limit
    elif wanted < -current_limit:
        wanted = -current_limit
    if integral_time <= 0.0:
        return wanted, 0.0
    return wanted, (wanted - integral) / integral_time


@block("motor_torque", source=MOTOR)
def motor_torque(
    current: float,
    gear_ratio: float,
    torque_constant: Annotated[
        float, Param("N.m/A", "torque constant of the motor", low=1e-4, high=100.0)
    ],
) -> float:
    """Torque [N m] of the current, at the output."""
    return gear_ratio * torque_constant * current


@block("torque", source=MOTOR)
def net_torque(
    motor_torque: float,
    load: float,
    shaft_speed: float,
    gear_ratio: float,
    viscous_coefficient: Annotated[
        float, Param("N.m.s/rad", "viscous friction of the motor", high=10.0)
    ],
) -> float:
    """Torque [N m] that accelerates the shaft, dry friction apart."""
    drag = gear_ratio * gear_ratio * viscous_coefficient * shaft_speed
    return motor_torque - drag - load
