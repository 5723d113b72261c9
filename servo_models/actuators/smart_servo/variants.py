"""Variants of the smart servo: motors and firmware from their data sheets."""

from __future__ import annotations

import math

from servo_models.actuators.smart_servo.plant import (
    COUNT,
    STS3215_PLANT,
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
RPM = 2.0 * math.pi / 60.0
UNCERTAIN = {
    "inertia": 0.3,
    "torque_constant": 0.3,
    "resistance": 0.4,
    "loop_factor": 0.2,
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
            **dc_motor(STS3215_VOLTS, 19.5 * 0.0980665, 52.0 * RPM),
            "inertia": 0.028,
            "gain": 16.0,
            "loop_factor": 0.166,
        },
        "data sheet at 7.4 V: 19.5 kg cm, 52 rev/min; loop and geared rotor (0.022 to"
        " 0.028 kg m2) after Duclusaud et al.",
        plant=STS3215_PLANT,
        uncertainty=UNCERTAIN,
    ),
)
