"""A DC or brushless motor in a speed loop, with an encoder, with and without a gearbox."""

from __future__ import annotations

from servo_models.actuators.dc_motor.physics import ANTI_WINDUP
from servo_models.actuators.dc_motor.plant import SPEED_PLANT
from servo_models.actuators.dc_motor.variants import SPEED_VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
    name="dc_motor_speed",
    title="DC motor with an encoder, in a speed loop",
    about="Speed in, encoder out: PI loop with anti-windup gives a current, as in an ODrive.",
    source=ANTI_WINDUP,
    plant=SPEED_PLANT,
    variants=SPEED_VARIANTS,
    stop_time=0.5,
    step_size=1e-3,
    step=("speed_command", 50.0),
    general=True,
)
TORQUE = torque_causal(ACTUATOR)
