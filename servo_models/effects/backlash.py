"""Backlash: play between shaft and output."""

from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Memory, Mode, Param, effect


@effect(
    "angle",
    "rate",
    source="Nordin, Gutman, Automatica 38 (2002) 1633 (friction-driven play)",
    hints=Hints(
        says="{half_width} of play to either side",
        ambiguity=Ambiguity(
            "log a motor-side signal or the current; a one-sided load removes backlash",
            ("backlash",),
            ("dead_zone", "dead_band", "coulomb_friction", "stribeck_friction", "hysteresis"),
        ),
    ),
)
def backlash(
    angle: float,
    rate: float,
    half_width: Annotated[
        float, Param("signal", "half of the play", high=0.2, switch=True, typical=0.01)
    ],
    engaged: Annotated[float, Memory()],
    contact: Annotated[float, Mode()],
) -> tuple[float, float, float, float]:
    """The output rests while the shaft crosses the play of +/- half_width.

    Written with the sums that were remembered, so that contact is still contact when the
    same point is looked at again.  Contact is a mode: it is lost at the shaft's reversal,
    and where that happens the output stays.
    """
    if half_width <= 0.0:
        return angle, rate, engaged, contact
    if angle - half_width >= engaged:
        if rate > 0.0:
            return angle - half_width, rate, angle - half_width, 1.0
        return angle - half_width, 0.0, angle - half_width, 0.0
    if angle + half_width <= engaged:
        if rate < 0.0:
            return angle + half_width, rate, angle + half_width, -1.0
        return angle + half_width, 0.0, angle + half_width, 0.0
    return engaged, 0.0, engaged, 0.0
