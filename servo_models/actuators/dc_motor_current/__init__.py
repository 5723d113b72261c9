"""A DC or brushless motor on a current, with an encoder, with and without a gearbox."""

from __future__ import annotations

from servo_models.actuators.dc_motor.physics import MOTOR
from servo_models.actuators.dc_motor.plant import CURRENT_PLANT
from servo_models.actuators.dc_motor.variants import CURRENT_VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
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
TORQUE = torque_causal(ACTUATOR)
