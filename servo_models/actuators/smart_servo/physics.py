"""A smart servo: PID loop in firmware on the counts of an encoder, DC motor, gears, arm.

goal -> comparator -> duty -> bridge on the supply -> motor -> shaft -> encoder -> back.
The clock of the firmware is the effect sample_hold on the duty.
"""

from __future__ import annotations

import math
from typing import Annotated

from servo_models.core.block import Clock, Memory, Param, block

BAM = "Duclusaud et al., Extended friction models, 2025"


@block("shaft_inertia", "full_speed", "angle_unit")
def arm(
    inertia: Annotated[
        float,
        Param("kg.m2", "inertia of the geared rotor and of what it carries", low=1e-5, high=1.0),
    ],
) -> tuple[float, float, float]:
    """Inertia [kg m^2]; speed [rad/s] that friction parameters call full; angle in radians."""
    return inertia, 10.0, 1.0


@block("shaft_rate")
def arm_motion(shaft_speed: float) -> float:
    """Rate of the shaft [rad/s]."""
    return shaft_speed


@block("angle_reading")
def encoder(angle: float) -> float:
    """Angle [rad] that the encoder reports."""
    return angle


@block("error")
def comparator(goal: float, angle_reading: float) -> float:
    """Error [rad] of the angle as the firmware sees it."""
    return goal - angle_reading


@block("duty", source=f"{BAM}; ROBOTIS e-manual, X series, Position PID Gain")
def position_loop(
    error: float,
    enabled: float,
    due: float,
    gain: Annotated[float, Param("1", "position gain, as in its register", high=1e4)],
    loop_factor: Annotated[
        float, Param("1/rad", "duty per unit of gain and radian", low=1e-5, high=10.0)
    ],
    integral_gain: Annotated[
        float, Param("1/(rad.s)", "duty per radian and second of error", high=1e4)
    ],
    derivative_gain: Annotated[float, Param("s/rad", "duty per rad/s of error", high=10.0)],
    loop_period: Annotated[
        float,
        Param("s", "from one sum of the I term to the next", 1e-3, 1e-4, 0.1, display="ms"),
    ],
    duty_limit: Annotated[float, Param("1", "largest duty", default=1.0, low=0.01)],
    integral: Annotated[float, Memory()],
    slope: Annotated[float, Memory()],
    last_error: Annotated[float, Memory()],
    next_tick: Annotated[float, Clock()],
) -> tuple[float, float, float, float, float]:
    """Part of the supply [1] that the PID loop asks for.

    The I term sums the error at each tick, the D term is its difference to the tick before; without
    these gains there is no tick.  The e-manual has an anti-windup gain and gives neither its value
    nor its place: here the sum takes the duty to its limit and waits there while the error drives
    it on (Astrom, Hagglund, Advanced PID Control, 2006, sec. 3.5, conditional integration).
    """
    wanted = gain * loop_factor * error
    if integral_gain > 0.0 or derivative_gain > 0.0:
        if due >= next_tick:
            next_tick = (math.floor(due / loop_period) + 1.0) * loop_period
            slope = (error - last_error) / loop_period
            last_error = error
            summed = integral + integral_gain * loop_period * error
            asked = wanted + summed + derivative_gain * slope
            if enabled < 0.5:
                integral = 0.0
            elif error > 0.0 and asked > duty_limit:
                room = summed + duty_limit - asked
                integral = room if room > integral else integral
            elif error < 0.0 and asked < -duty_limit:
                room = summed - duty_limit - asked
                integral = room if room < integral else integral
            else:
                integral = summed
        wanted = wanted + integral + derivative_gain * slope
    else:
        next_tick = math.inf
    if wanted > duty_limit:
        wanted = duty_limit
    elif wanted < -duty_limit:
        wanted = -duty_limit
    return wanted, integral, slope, last_error, next_tick


@block("bridge_supply", "supply_current", "supply_conductance", source="Ohm's law")
def supply_load(
    supply: float,
    duty: float,
    enabled: float,
    shaft_speed: float,
    torque_constant: Annotated[
        float, Param("N.m/A", "torque constant at the output", low=0.01, high=20.0)
    ],
    resistance: Annotated[float, Param("Ohm", "resistance of the motor", low=0.05, high=1e3)],
) -> tuple[float, float, float]:
    """Supply [V] of the bridge, current [A] it takes from a stiff one, slope of that [S]."""
    if enabled < 0.5:
        return supply, 0.0, 0.0
    current = duty * (duty * supply - torque_constant * shaft_speed) / resistance
    return supply, current, duty * duty / resistance


@block("motor_voltage")
def bridge(duty: float, bridge_supply: float) -> float:
    """Mean voltage [V] on the motor."""
    return duty * bridge_supply


@block("current", source="Ohm's law, inductance neglected")
def winding(
    motor_voltage: float,
    enabled: float,
    shaft_speed: float,
    torque_constant: float,
    resistance: float,
) -> float:
    """Current [A] of the motor; switched off, the winding is open."""
    if enabled < 0.5:
        return 0.0
    return (motor_voltage - torque_constant * shaft_speed) / resistance


@block("torque")
def net_torque(current: float, load: float, torque_constant: float) -> float:
    """Torque [N m] that accelerates the arm."""
    return torque_constant * current - load
