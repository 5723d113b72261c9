"""Any servo of whose inside nothing is known: second order, with a delay and limits."""

from __future__ import annotations

from servo_models.actuators.second_order_servo.plant import PLANT
from servo_models.actuators.second_order_servo.variants import VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
    name="second_order_servo",
    title="Any PWM or bus servo: second order with limits",
    about="Pulse or goal in, angle out: gain, delay, natural frequency, damping, limits, inertia.",
    source="Franklin, Powell, Emami-Naeini, Feedback Control of Dynamic Systems, 2015, sec. 3.3",
    plant=PLANT,
    variants=VARIANTS,
    stop_time=1.0,
    step_size=5e-3,
    step=("pulse_width", 2e-3),
    general=True,
)
TORQUE = torque_causal(ACTUATOR)
