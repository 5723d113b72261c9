"""Variants of the motors: sizes that are typical of a motor of some ten watts at 24 V.

They belong to no product.  Write down what your data sheet says: torque constant, resistance, rotor
inertia and gear ratio stand there; friction does not.
"""

from __future__ import annotations

import math

from servo_models.actuators.dc_motor.plant import (
    CURRENT_PLANT,
    SPEED_PLANT,
    VOLTAGE_PLANT,
    geared,
)
from servo_models.core.plant import Variant

RPM = 2.0 * math.pi / 60.0  # rad/s in a revolution per minute
COUNTS_PER_TURN = 8192.0
SIZE = "typical size of a 24 V motor of some ten watts; no product: give the data sheet's values"
RPM_RATED = 6000.0  # rated speed [rev/min]

ROTOR = {
    "rotor_inertia": 1e-5,
    "rated_speed": RPM_RATED * RPM,
    "torque_constant": 0.03,
    "viscous_coefficient": 2e-6,
}
WINDING = {"resistance": 2.0, "winding_lag.time_constant": 5e-4}
RATIO = 50.0  # turns of the motor in a turn of the output
GEARBOX = {"gear_ratio": RATIO}
LOOP = {"speed_gain": 0.02, "integral_time": 0.05, "current_limit": 5.0}

ROTOR_UNKNOWN = {"rotor_inertia": 0.3, "torque_constant": 0.2, "viscous_coefficient": 0.5}
WINDING_UNKNOWN = {"resistance": 0.2, "winding_lag.time_constant": 0.5}
LOOP_UNKNOWN = {"speed_gain": 0.1, "integral_time": 0.1, "current_limit": 0.1}

VOLTAGE_VARIANTS = (
    Variant(
        "direct",
        "without a gearbox: a first guess",
        {**ROTOR, **WINDING},
        SIZE,
        uncertainty={**ROTOR_UNKNOWN, **WINDING_UNKNOWN},
    ),
    Variant(
        "geared",
        "behind a gearbox of 50 to 1: a first guess",
        {**ROTOR, **WINDING, **GEARBOX},
        SIZE,
        plant=geared(VOLTAGE_PLANT, RATIO),
        uncertainty={**ROTOR_UNKNOWN, **WINDING_UNKNOWN},
    ),
)
CURRENT_VARIANTS = (
    Variant(
        "direct",
        "without a gearbox: a first guess",
        ROTOR,
        SIZE,
        uncertainty=ROTOR_UNKNOWN,
    ),
    Variant(
        "geared",
        "behind a gearbox of 50 to 1: a first guess",
        {**ROTOR, **GEARBOX},
        SIZE,
        plant=geared(CURRENT_PLANT, RATIO),
        uncertainty=ROTOR_UNKNOWN,
    ),
)

ODRIVE = {
    "rotor_inertia": 2.5e-4,
    "rated_speed": 2000.0 * RPM,
    "torque_constant": 0.03,
    "viscous_coefficient": 1e-4,
    "speed_gain": 5e-4 * COUNTS_PER_TURN / (2.0 * math.pi),
    "integral_time": 0.05,
    "current_limit": 10.0,
}
"""Defaults of its firmware: gain 5e-4 A/(count/s), position gain 20 /s.  A position loop on the
integral of the commanded speed is an integral part with T_i = 1 / 20 s."""

ODRIVE_TORQUE = ODRIVE["torque_constant"] * ODRIVE["current_limit"]  # N m
ODRIVE_PLANT = SPEED_PLANT.rated(
    scales={
        **dict.fromkeys(("load_torque", "motor_torque", "friction", "load"), ODRIVE_TORQUE),
        **dict.fromkeys(("current", "current_command", "integral"), ODRIVE["current_limit"]),
        "shaft_inertia": ODRIVE["rotor_inertia"],
    }
)

SPEED_VARIANTS = (
    Variant(
        "direct",
        "without a gearbox: a first guess",
        {**ROTOR, **LOOP},
        SIZE,
        uncertainty={**ROTOR_UNKNOWN, **LOOP_UNKNOWN},
    ),
    Variant(
        "geared",
        "behind a gearbox of 50 to 1: a first guess",
        {**ROTOR, **LOOP, **GEARBOX},
        SIZE,
        plant=geared(SPEED_PLANT, RATIO),
        uncertainty={**ROTOR_UNKNOWN, **LOOP_UNKNOWN},
    ),
    Variant(
        "odrive",
        "a brushless motor of some hundred watts under an ODrive, encoder of 8192 counts a turn",
        {**ODRIVE, "sensor_quantisation.step": 2.0 * math.pi / COUNTS_PER_TURN},
        "ODrive firmware 0.4, default gains; motor: typical size, no product",
        plant=ODRIVE_PLANT,
        uncertainty={
            **ROTOR_UNKNOWN,
            "speed_gain": 0.5,
            "integral_time": 0.5,
            "current_limit": 0.3,
        },
    ),
)
