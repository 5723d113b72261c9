"""Asymmetry: one direction is stronger than the other."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "signal",
    source="SG90 paper sec. 4.3 (+670 / -544 rad/s)",
    hints=Hints(says="the positive direction differs by {ratio}"),
)
def direction_asymmetry(
    signal: float,
    ratio: Annotated[
        float,
        Param(
            "1",
            "relative surplus of the positive side",
            low=-0.5,
            high=0.5,
            switch=True,
            typical=0.1,
        ),
    ],
) -> float:
    """y = (1 + ratio) u for u > 0 and (1 - ratio) u for u < 0."""
    return signal + ratio * abs(signal)
