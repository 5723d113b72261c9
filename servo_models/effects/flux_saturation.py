"""Saturation of the flux linkage, and its bend."""

import math
from typing import Annotated

from servo_models.core.block import Param, effect


@effect("flux_slope", "flux_turning", source="valve paper eq. 1, general lambda(i, theta)")
def flux_saturation(
    flux_slope: float,
    flux_turning: float,
    current: float,
    shaft_angle: float,
    inverse_current: Annotated[
        float,
        Param(
            "1/{current}",
            "inverse of the current at which the inductance has halved",
            high=5.0,
            switch=True,
            typical=0.5,
        ),
    ],
    curvature: Annotated[
        float,
        Param(
            "1/{shaft_angle}2",
            "relative change of the inductance with the angle squared",
            low=-0.3,
            high=0.3,
            switch=True,
            typical=0.1,
        ),
    ],
) -> tuple[float, float]:
    """lambda = L I atan(i / I) (1 + curvature theta^2) + K_b theta, 1 / I = inverse_current.

    Both slopes are those of this one function; the torque has a bend of its own.
    """
    ratio = inverse_current * current
    flux_current = current
    if inverse_current > 0.0:
        flux_current = math.atan(ratio) / inverse_current
    turning = flux_turning + 2.0 * curvature * shaft_angle * flux_slope * flux_current
    bend = (1.0 + curvature * shaft_angle * shaft_angle) / (1.0 + ratio * ratio)
    return flux_slope * bend, turning
