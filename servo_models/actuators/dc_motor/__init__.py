"""A DC or brushless motor with an encoder: on a voltage, on a current, in loops."""

from __future__ import annotations

from servo_models.actuators.dc_motor.physics import ANTI_WINDUP, MOTOR
from servo_models.actuators.dc_motor.plant import CURRENT_PLANT, SPEED_PLANT, VOLTAGE_PLANT
from servo_models.actuators.dc_motor.variants import (
    CURRENT_VARIANTS,
    SPEED_VARIANTS,
    VOLTAGE_VARIANTS,
)
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ON_VOLTAGE = Actuator(
    name="dc_motor",
    title="DC motor with an encoder, on a voltage",
    about="Voltage in, encoder out: winding, rotor, with or without a gearbox.",
    source=MOTOR,
    plant=VOLTAGE_PLANT,
    variants=VOLTAGE_VARIANTS,
    stop_time=0.5,
    step_size=1e-3,
    step=("voltage", 12.0),
    general=True,
)
ON_VOLTAGE_TORQUE = torque_causal(ON_VOLTAGE)
ON_CURRENT = Actuator(
    name="dc_motor_current",
    title="DC motor with an encoder, on a current",
    about="Current in, encoder out: a drive with a current loop, with or without a gearbox.",
    source=MOTOR,
    plant=CURRENT_PLANT,
    variants=CURRENT_VARIANTS,
    stop_time=0.5,
    step_size=1e-3,
    step=("current_command", 0.5),
    general=True,
)
ON_CURRENT_TORQUE = torque_causal(ON_CURRENT)
IN_SPEED_LOOP = Actuator(
    name="dc_motor_speed",
    title="DC motor with an encoder, in a speed or position loop",
    about="Speed or position in, encoder out: P loop of position around a PI loop of speed with"
    " anti-windup, which gives a current, as in an ODrive.",
    source=ANTI_WINDUP,
    plant=SPEED_PLANT,
    variants=SPEED_VARIANTS,
    stop_time=0.5,
    step_size=1e-3,
    step=("speed_command", 50.0),
    general=True,
)
IN_SPEED_LOOP_TORQUE = torque_causal(IN_SPEED_LOOP)
ACTUATORS = ON_VOLTAGE, ON_CURRENT, IN_SPEED_LOOP
