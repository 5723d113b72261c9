"""Magnetic saturation of the torque."""

import math
from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect("signal", source="valve paper eq. 2, general T_m(i, theta)", hints=Hints(family="limit"))
def torque_saturation(
    signal: float,
    inverse_torque: Annotated[
        float,
        Param(
            "1/signal",
            "inverse of the largest torque, 0 for none",
            high=5.0,
            switch=True,
            typical=0.5,
        ),
    ],
) -> float:
    """y = T / sqrt(1 + (T / T_max)^2), straight for small and bounded for large currents."""
    ratio = inverse_torque * signal
    return signal / math.sqrt(1.0 + ratio * ratio)
