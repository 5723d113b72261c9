"""A servo without any dynamics: the angle that the pulse asks for, at once."""

from __future__ import annotations

import math
from typing import Annotated

from servo_models import Actuator, Param, Plant, Variant, Wire, block

CENTRE = 1.5e-3


@block("angle")
def horn(
    pulse_width: float,
    pulse_per_angle: Annotated[
        float, Param("s/rad", "of the command", 1856e-6 / math.pi, low=1e-4, high=1e-3)
    ],
) -> float:
    """Angle [rad] that a pulse [s] asks for."""
    return (pulse_width - CENTRE) / pulse_per_angle


ACTUATOR = Actuator(
    name="ideal_servo",
    title="Ideal servo",
    about="A servo that stands where its pulse asks for, at once.",
    source="definition",
    plant=Plant(
        inputs=(Wire("pulse_width", "s", "command pulse", 1e-3, CENTRE, 0.0, 5e-3, display="us"),),
        wires=(Wire("angle", "rad", "angle of the horn", 1.5, display="deg"),),
        constants={"internal_step": Param("s", "integration", default=1e-2, low=1e-5, high=1e-2)},
        chain=(horn,),
        states=(),
        outputs=("angle",),
    ),
    variants=(Variant("ideal", "scaled as an SG90", {}, "definition"),),
    stop_time=1.0,
    step_size=0.001,
    step=("pulse_width", 1.9e-3),
)
