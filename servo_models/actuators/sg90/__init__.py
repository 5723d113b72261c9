"""Tower Pro SG90 servo (Kochuk, Nikitin, Hrinchenko, Bahaiev)."""

from __future__ import annotations

from servo_models.actuators.sg90.plant import PLANT
from servo_models.actuators.sg90.variants import VARIANTS
from servo_models.actuators.torque_causal import torque_causal
from servo_models.core.plant import Actuator

ACTUATOR = Actuator(
    name="sg90",
    title="Tower Pro SG90 hobby servo",
    about=(
        "Element by element: command decoder, comparator, amplifier, DC motor, gearbox 24,"
        " potentiometer."
    ),
    source="Kochuk, Nikitin, Hrinchenko, Bahaiev, Methodology of synthesis nonlinear"
    " mathematical model of a servo",
    plant=PLANT,
    variants=VARIANTS,
    stop_time=20.0,
    step_size=0.02,
    step=("pulse_width", 2.0e-3),
)
TORQUE = torque_causal(ACTUATOR)
