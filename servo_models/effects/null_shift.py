"""Null shift: the position of zero torque has moved."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "spring_angle",
    source="valve paper sec. 1 (null shift)",
    hints=Hints(says="zero torque is at {angle}", family="offset"),
)
def null_shift(
    spring_angle: float,
    angle: Annotated[
        float,
        Param(
            "signal", "angle of the magnetic null", low=-0.5, high=0.5, switch=True, typical=0.03
        ),
    ],
) -> float:
    """The restoring torque vanishes at ``angle`` instead of 0."""
    return spring_angle - angle
