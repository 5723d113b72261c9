"""Stribeck friction: larger near standstill."""

import math
from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Param, effect


@effect(
    "friction",
    source="Armstrong-Helouvry et al., Automatica 30 (1994) 1083, eq. 3",
    hints=Hints(
        says="{excess} more friction near standstill",
        family="friction",
        ambiguity=Ambiguity(
            "very slow ramps, as slow as it still moves, both ways, without and with a load",
            ("stribeck_friction",),
            ("coulomb_friction", "load_friction"),
        ),
    ),
)
def stribeck_friction(
    friction: float,
    shaft_speed: float,
    full_speed: float,
    excess: Annotated[
        float,
        Param("signal", "breakaway torque above sliding", high=0.5, switch=True, typical=0.05),
    ],
    speed: Annotated[
        float,
        Param(
            "1", "Stribeck speed, as a fraction of full speed", default=0.05, low=0.005, high=1.0
        ),
    ],
) -> float:
    """Adds excess exp(-(v / v_s)^2), so all of it at standstill."""
    ratio = shaft_speed / (speed * full_speed)
    if abs(ratio) > 7.0:  # the exponential is below rounding: spare it at speed
        return friction
    return friction + excess * math.exp(-ratio * ratio)
