"""Electro-Mechanical Positioning System: a linear drive in its discrete position loop."""

from __future__ import annotations

from servo_models.actuators.linear_drive.plant import PLANT
from servo_models.actuators.linear_drive.variants import VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
    name="linear_drive",
    title="Linear drive with a position controller (EMPS)",
    about="A motor and ball screw move a carriage; the controller runs on a clock of 1 kHz.",
    source="Janot, Gautier, Brunot, Data set and reference models of EMPS, 2019",
    plant=PLANT,
    variants=VARIANTS,
    stop_time=1.0,
    step_size=1e-3,
    step=("reference", 0.01),
)
TORQUE = torque_causal(ACTUATOR)
