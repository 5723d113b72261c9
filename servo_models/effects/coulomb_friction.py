"""Coulomb friction, with exact standstill."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "friction",
    source="Armstrong-Helouvry et al., Automatica 30 (1994) 1083",
    hints=Hints(says="dry friction of {level}", family="friction"),
)
def coulomb_friction(
    friction: float,
    level: Annotated[
        float, Param("signal", "sliding friction torque", high=0.5, switch=True, typical=0.05)
    ],
) -> float:
    """A constant torque against the motion."""
    return friction + level
