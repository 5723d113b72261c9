"""Gravity load: a mass on an arm."""

import math
from typing import Annotated

from servo_models.core.block import UNLOADED, UPRIGHT, Hints, Param, effect


@effect(
    "load",
    source="definition",
    hints=Hints(
        says="a weight pulls with {torque} at most",
        family="load",
        phase="phase",
        bench=(UNLOADED, UPRIGHT),
    ),
)
def gravity_load(
    load: float,
    angle: float,
    torque: Annotated[
        float, Param("signal", "mass x gravity x arm", low=-1.0, high=1.0, switch=True, typical=0.1)
    ],
    phase: Annotated[
        float,
        Param("rad", "angle from hanging at zero", low=-3.15, high=3.15, display="deg"),
    ],
) -> float:
    """Adds torque sin(angle + phase), at the output's angle where play is in the loop."""
    return load + torque * math.sin(angle + phase)
