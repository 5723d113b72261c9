"""Smart servos with a position loop in their firmware: Dynamixel XL330, Feetech STS3215."""

from __future__ import annotations

from servo_models.actuators.smart_servo.plant import PLANT
from servo_models.actuators.smart_servo.variants import VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
    name="smart_servo",
    title="Smart servo with a position loop in firmware (XL330, STS3215)",
    about="Goal in, angle out: P gain on encoder counts, duty, DC motor behind gears.",
    source="Data sheets of ROBOTIS and Feetech; Duclusaud et al., Extended friction models, 2025",
    plant=PLANT,
    variants=VARIANTS,
    stop_time=1.0,
    step_size=5e-3,
    step=("goal", 0.5),
)
TORQUE = torque_causal(ACTUATOR)
