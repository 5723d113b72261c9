"""Limited-angle torque motor of a pneumatic servo valve (Toorani, Farahmandzad, Aghamirsalim)."""

from __future__ import annotations

from servo_models.actuators.torque_causal import torque_causal
from servo_models.actuators.torque_motor.plant import PLANT
from servo_models.actuators.torque_motor.variants import GREY_BOX, VARIANTS
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
    name="torque_motor",
    title="Limited-angle torque motor of a pneumatic servo valve",
    about=(
        "A Laws relay with magnetic spring: coil current, rotor angle and speed, +/- 3 deg stops."
    ),
    source="Toorani, Farahmandzad, Aghamirsalim, Gray-Box Modeling of a Pneumatic Servo-Valve",
    plant=PLANT,
    variants=VARIANTS,
    stop_time=0.2,
    step_size=1e-3,
    step=("voltage", 30.0),
    grey_box=GREY_BOX,
)
TORQUE = torque_causal(ACTUATOR)
