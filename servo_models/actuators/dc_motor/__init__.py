"""A DC or brushless motor on a voltage, with an encoder, with and without a gearbox."""

from __future__ import annotations

from servo_models.actuators.dc_motor.physics import MOTOR
from servo_models.actuators.dc_motor.plant import VOLTAGE_PLANT
from servo_models.actuators.dc_motor.variants import VOLTAGE_VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
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
TORQUE = torque_causal(ACTUATOR)
