"""Saturation of a signal."""

from typing import Annotated

from servo_models.core.block import LIMITS_OVER_TYPICAL, Ambiguity, Hints, Param, effect


@effect(
    "signal",
    source="Gelb, Vander Velde, Multiple-Input Describing Functions, 1968",
    hints=Hints(
        says="the {wire} stays within {limit}",
        family="limit",
        inverse=True,
        trial_values=LIMITS_OVER_TYPICAL,
        limited=("",),
        ambiguity=Ambiguity(
            "a ladder of steps up to the largest that the rig allows, back to back and spaced;"
            " log the supply voltage",
            ("saturation", "rate_limit", "supply_sag", "supply_limit", "torque_saturation"),
        ),
    ),
)
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
