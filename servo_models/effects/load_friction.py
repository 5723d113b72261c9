"""Friction that grows with the load, as in loaded gears."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "friction",
    source="Duclusaud et al., Extended friction models, 2025",
    hints=Hints(says="friction of {coefficient} of the load", family="friction"),
)
def load_friction(
    friction: float,
    load: float,
    coefficient: Annotated[
        float, Param("1", "friction per load torque", high=0.8, switch=True, typical=0.2)
    ],
) -> float:
    """Adds coefficient |load torque| to the friction level; drag and cogging do not load."""
    return friction + coefficient * abs(load)
