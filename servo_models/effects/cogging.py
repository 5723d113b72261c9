"""Cogging: torque ripple that depends on position."""

import math
from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "load",
    source="Hanselman, Brushless Permanent Magnet Motor Design, 2006, ch. 7",
    hints=Hints(
        phase="phase",
        count="count",
    ),
)
def cogging(
    load: float,
    shaft_angle: float,
    torque: Annotated[float, Param("signal", "amplitude", high=0.5, switch=True, typical=0.02)],
    count: Annotated[float, Param("1", "periods per turn", default=12.0, low=1.0, high=720.0)],
    phase: Annotated[float, Param("rad", "phase", low=-3.15, high=3.15, display="deg")],
) -> float:
    """Adds torque sin(count angle + phase)."""
    return load + torque * math.sin(count * shaft_angle + phase)
