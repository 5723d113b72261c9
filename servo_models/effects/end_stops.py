"""Inelastic end stops."""

from typing import Annotated

from servo_models.core.block import LIMITS_OVER_TYPICAL, Hints, Param, effect


@effect(
    "travel",
    source="SG90 paper sec. 4.4; valve paper sec. 2",
    hints=Hints(
        says="the shaft stops at {half_range} to either side",
        trial_values=LIMITS_OVER_TYPICAL,
        limited=("angle", "position"),
    ),
)
def end_stops(
    travel: float,
    half_range: Annotated[
        float,
        Param(
            "signal",
            "the shaft stops at +/- this angle, 0 for none",
            high=4.0,
            switch=True,
            typical=0.5,
            fixed=True,
        ),
    ],
) -> float:
    """Limits the travel of the shaft on both sides."""
    if half_range <= 0.0:
        return travel
    if travel <= 0.0 or half_range < travel:
        return half_range
    return travel
