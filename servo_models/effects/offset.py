"""Constant offset of a signal."""

from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Param, effect


@effect(
    "signal",
    source="definition",
    hints=Hints(
        says="the {wire} is off by {value}",
        family="offset",
        ambiguity=Ambiguity(
            "the same moves with the pose turned upside down",
            ("offset", "null_shift"),
            ("constant_load", "gravity_load", "direction_asymmetry"),
        ),
    ),
)
def offset(
    signal: float,
    value: Annotated[
        float, Param("signal", "offset", low=-0.5, high=0.5, switch=True, typical=0.02)
    ],
) -> float:
    """y = u + value."""
    return signal + value
