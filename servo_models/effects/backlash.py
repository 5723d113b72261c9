"""Backlash: play between shaft and output."""

from typing import Annotated

from servo_models.block import Memory, Param, effect


@effect("angle", "rate", source="Nordin, Gutman, Automatica 38 (2002) 1633 (friction-driven play)")
def backlash(
    angle: float,
    rate: float,
    half_width: Annotated[
        float, Param("signal", "half of the play", high=0.2, switch=True, typical=0.01)
    ],
    engaged: Annotated[float, Memory()],
) -> tuple[float, float, float]:
    """The output rests while the shaft crosses the play of +/- half_width.

    Written with the sums that were remembered, so that contact is still contact when the
    same point is looked at again.
    """
    if half_width <= 0.0:
        return angle, rate, engaged
    if angle - half_width >= engaged:
        return angle - half_width, rate if rate > 0.0 else 0.0, angle - half_width
    if angle + half_width <= engaged:
        return angle + half_width, rate if rate < 0.0 else 0.0, angle + half_width
    return engaged, 0.0, engaged
