"""Variants of the smart servo: motors and firmware from their data sheets.

Limits and further gains are off: set those that yours has.  Registers of a Dynamixel X (ROBOTIS
e-manual, Protocol 2.0) in our units:

=========================  ====================================================================
duty_limit                 PWM Limit / 885
derivative_gain            Position D Gain / 16 counts a tick, so x COUNTS x tick / 885
integral_gain              Position I Gain / 65536 a count and tick, so x COUNTS / (tick x 885)
current_limit.limit        Current Limit, 1 mA in an XL330, in current-based position mode
motion_profile.velocity    Profile Velocity x 0.229 rev/min
acceleration_time          64 ms x Profile Velocity / Profile Acceleration, of 214.577 rev/min2
=========================  ====================================================================

COUNTS are 4096 / (2 pi) a radian.  The tick is not documented, and the P term is half of what the
e-manual has (Duclusaud et al.), so the gains are as uncertain as ``loop_factor``.  A Feetech STS
has a profile in counts a second and 100 counts/s2 and a torque limit in 0.1 % of the duty; the
units of its gains are not documented.  An X series smooths the corners of its profile by a jerk
that is not documented, hence the uncertainty of the acceleration time; that of a limit of the
current is the tolerance of its measurement, which no data sheet has.
"""

from __future__ import annotations

import math

from servo_models.actuators.smart_servo.plant import (
    COUNT,
    STS3215_12V_PLANT,
    STS3215_HIGH_TORQUE,
    STS3215_HIGH_VOLTS,
    STS3215_PLANT,
    STS3215_TORQUE,
    STS3215_VOLTS,
    XL330_VOLTS,
)
from servo_models.core.plant import Variant


def dc_motor(voltage: float, stall_torque: float, no_load_speed: float) -> dict[str, float]:
    """Motor constants from a data sheet's voltage [V], stall torque [N m], speed [rad/s]."""
    constant = voltage / no_load_speed
    return {
        "torque_constant": constant,
        "resistance": constant * voltage / stall_torque,
    }


FIRMWARE = {"sample_hold.period": 1e-3, "sensor_quantisation.step": COUNT}
RPM = 2.0 * math.pi / 60.0  # rad/s in a revolution per minute
UNCERTAIN = {
    "inertia": 0.3,
    "torque_constant": 0.3,
    "resistance": 0.4,
    "loop_factor": 0.2,
    "integral_gain": 0.2,
    "derivative_gain": 0.2,
    "current_limit.limit": 0.1,
    "motion_profile.acceleration_time": 0.1,
}

VARIANTS = (
    Variant(
        "xl330",
        "Dynamixel XL330-M288 at 5 V, bare and without friction: a first guess",
        {
            **FIRMWARE,
            **dc_motor(XL330_VOLTS, 0.52, 103.0 * RPM),
            "inertia": 2.6e-3,
            "gain": 400.0,
            "loop_factor": 4096.0 / (2.0 * math.pi) / (256.0 * 885.0),
        },
        "ROBOTIS e-manual XL330-M288 at 5 V: 0.52 N m, 103 rev/min; loop and geared rotor"
        " (0.0020 to 0.0026 kg m2) after Duclusaud et al.",
        uncertainty=UNCERTAIN,
    ),
    Variant(
        "sts3215",
        "Feetech STS3215 at 7.4 V, bare and without friction: a first guess",
        {
            **FIRMWARE,
            **dc_motor(STS3215_VOLTS, STS3215_TORQUE, 52.0 * RPM),
            "inertia": 0.028,
            "gain": 16.0,
            "loop_factor": 0.166,
        },
        "data sheet at 7.4 V: 19.5 kg cm, 52 rev/min; loop and geared rotor (0.022 to"
        " 0.028 kg m2) after Duclusaud et al.",
        plant=STS3215_PLANT,
        uncertainty=UNCERTAIN,
    ),
    Variant(
        "sts3215_12v",
        "Feetech STS3215 (C018) at 12 V, bare and without friction: a first guess",
        {
            **FIRMWARE,
            **dc_motor(STS3215_HIGH_VOLTS, STS3215_HIGH_TORQUE, 45.0 * RPM),
            "inertia": 0.028,
            "gain": 16.0,
            "loop_factor": 0.166,
        },
        "data sheet at 12 V: 30 kg cm, 45 rev/min (46 measured without load by Robonine); gears and"
        " loop as those of the version for 7.4 V",
        plant=STS3215_12V_PLANT,
        uncertainty=UNCERTAIN,
    ),
)
