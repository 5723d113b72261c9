"""Saturation of a signal."""

from typing import Annotated

from servo_models.core.block import Param, effect


@effect("signal", source="Gelb, Vander Velde, Multiple-Input Describing Functions, 1968")
def saturation(
    signal: float,
    limit: Annotated[
        float, Param("signal", "largest magnitude, 0 for none", high=2.0, switch=True, typical=0.7)
    ],
) -> float:
    """y = u, but never more than limit in magnitude."""
    if limit <= 0.0:
        return signal
    if signal > limit:
        return limit
    if signal < -limit:
        return -limit
    return signal
