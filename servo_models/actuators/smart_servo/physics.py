"""A smart servo: P loop in firmware on the counts of an encoder, DC motor, gears, arm.

goal -> comparator -> duty -> bridge on the supply -> motor -> shaft -> encoder -> back.
The clock of the firmware is the effect sample_hold on the duty.
"""

from __future__ import annotations

from typing import Annotated

from servo_models.core.block import Param, block

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


@block("duty", source=BAM)
def position_loop(
    error: float,
    gain: Annotated[float, Param("1", "position gain, as in its register", high=1e4)],
    loop_factor: Annotated[
        float, Param("1/rad", "duty per unit of gain and radian", low=1e-5, high=10.0)
    ],
    duty_limit: Annotated[float, Param("1", "largest duty", default=1.0, low=0.01)],
) -> float:
    """Part of the supply [1] that the P loop asks for."""
    wanted = gain * loop_factor * error
    if wanted > duty_limit:
        return duty_limit
    if wanted < -duty_limit:
        return -duty_limit
    return wanted


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
