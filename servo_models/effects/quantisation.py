"""Quantisation: a converter with a finite step."""

import math
from typing import Annotated

from servo_models.core.block import Grid, Hints, Param, effect

FINEST = 4503599627370496.0  # codes, 2^52: every larger float is a whole number of codes


@effect(
    "signal",
    source="SG90 paper sec. 4.1 (1024 levels of 5 V)",
    hints=Hints(
        says="the {wire} has steps of {step}",
        family="quantisation",
        grid=Grid(low=0.2, high=150.0, least_spacing=0.0015),
        assumed=("rounding",),
        signature="codes",
    ),
)
def quantisation(
    signal: float,
    step: Annotated[
        float, Param("signal", "size of one code", high=0.2, switch=True, typical=0.005)
    ],
    rounding: Annotated[
        float, Param("1", "0.5 rounds to the nearest code, 0 truncates", default=0.5)
    ],
) -> float:
    """y = step floor(u / step + rounding)."""
    if not abs(signal) < FINEST * step:
        return signal
    return step * math.floor(signal / step + rounding)
