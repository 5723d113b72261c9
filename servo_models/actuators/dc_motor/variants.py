"""Variants of the motors: sizes that are typical of a motor of some ten watts at 24 V.

They belong to no product.  Write down what your data sheet says: torque constant, resistance, rotor
inertia and gear ratio stand there; friction does not.

Gains of a position loop on a brushless motor, in our units, with k the torque constant:

==============  ===================================  ====================================
ours            ODrive                               moteus
==============  ===================================  ====================================
position_gain   pos_gain                             g, the larger root of kd g2 + ki = kp g
speed_gain      vel_gain / (2 pi k)                  kd / (2 pi k)
integral_time   vel_gain / vel_integrator_gain       g kd / ki
speed_limit     vel_limit x 2 pi
==============  ===================================  ====================================

Their gains are in N.m, turns and seconds; those of ODrive's firmware 0.4 in A and counts.  At the
limit of the current ours follows the limited current, while an ODrive lets its integral decay by
1 % a cycle; a moteus stops it at a limit of its own (ilimit, 0 by default: no integral).
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
GAINS_UNKNOWN = {**ROTOR_UNKNOWN, "speed_gain": 0.5, "integral_time": 0.5, "current_limit": 0.3}
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
"""Defaults of its firmware 0.4: gain 5e-4 A/(count/s), position gain 20 /s.  A position loop on the
integral of the commanded speed is an integral part with T_i = 1 / 20 s."""
ODRIVE_POSITION = {
    **ODRIVE,
    "position_gain": 20.0,  # pos_gain [1/s]
    "integral_time": 0.5,  # vel_gain / vel_integrator_gain, 5e-4 / 1e-3
    "speed_limit": 20_000.0 / COUNTS_PER_TURN * 2.0 * math.pi,  # vel_limit 20000 counts/s
}
MOTEUS = {
    **ODRIVE,
    "position_gain": 4.0 / 0.05,  # kp / kd, N.m/turn over N.m/(turn/s)
    "speed_gain": 0.05 / (2.0 * math.pi * ODRIVE["torque_constant"]),
    "integral_time": 0.0,  # ilimit is 0: no integral
}

ODRIVE_TORQUE = ODRIVE["torque_constant"] * ODRIVE["current_limit"]  # N m
ODRIVE_PLANT = SPEED_PLANT.rated(
    scales={
        **dict.fromkeys(("load_torque", "motor_torque", "friction", "load"), ODRIVE_TORQUE),
        **dict.fromkeys(("current", "current_command", "integral"), ODRIVE["current_limit"]),
        "shaft_inertia": ODRIVE["rotor_inertia"],
    }
)
POSITION_SPEED = 60.0  # full scale of speeds in a position loop [rad/s]
POSITION_PLANT = ODRIVE_PLANT.rated(
    scales=dict.fromkeys(
        ("speed_command", "speed_reference", "encoder_speed", "rate", "shaft_speed"),
        POSITION_SPEED,
    )
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
        uncertainty=GAINS_UNKNOWN,
    ),
    Variant(
        "odrive_position",
        "the same in its position loop",
        {**ODRIVE_POSITION, "sensor_quantisation.step": 2.0 * math.pi / COUNTS_PER_TURN},
        "ODrive firmware 0.4, default gains; motor: typical size, no product",
        plant=POSITION_PLANT,
        uncertainty={**GAINS_UNKNOWN, "position_gain": 0.5, "speed_limit": 0.3},
        command="position_command",
    ),
    Variant(
        "moteus",
        "the motor of odrive under a moteus in position mode",
        MOTEUS,
        "moteus firmware, default gains of pid_position; motor: typical size, no product",
        plant=POSITION_PLANT,
        uncertainty={name: share for name, share in GAINS_UNKNOWN.items() if MOTEUS[name] > 0.0}
        | {"position_gain": 0.5},
        command="position_command",
    ),
)
