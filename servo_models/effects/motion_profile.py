"""Motion profile: the goal moves on a velocity trapezoid."""

import math
from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Memory, Param, effect

TRIALS_OVER_TYPICAL = tuple(0.03 * 1.35**k for k in range(20))
"""Trial values over the typical one: so close that the fit with a part of one value is no better
than the fit with the next."""
SHORTEST_S = 1e-6  # acceleration time below which the speed jumps


@effect(
    "signal",
    source="ROBOTIS e-manual, X series, What is the Profile (velocity-based)",
    hints=Hints(
        says="the goal moves at {velocity} at most",
        family="limit",
        trial_values=TRIALS_OVER_TYPICAL,
        inverse=True,
        ambiguity=Ambiguity(
            "steps of several sizes at two supplies and two loads: a profile lasts as long at all"
            " supplies and loads, and each of its parts grows with the size in its own way",
            ("motion_profile",),
            ("rate_limit", "saturation", "supply_limit", "supply_sag", "viscous_friction", "lag"),
        ),
    ),
)
def motion_profile(
    signal: float,
    elapsed: float,
    velocity: Annotated[
        float,
        Param("signal/{time}", "largest velocity, 0 for none", high=1e4, switch=True, typical=3.0),
    ],
    acceleration_time: Annotated[
        float,
        Param("{time}", "time up to the largest velocity, and back to 0", high=10.0, display="ms"),
    ],
    position: Annotated[float, Memory("rest")],
    speed: Annotated[float, Memory()],
) -> tuple[float, float, float]:
    """y goes to u at no more than ``velocity``, at an acceleration of velocity / acceleration_time.

    It is the fastest way that ends at rest, from the velocity that y has when u changes, and exact
    for a signal held between commits.  Without an acceleration time it is a rate limit; a way too
    short for the velocity is a triangle.
    """
    if velocity <= 0.0:
        return signal, position, speed
    if acceleration_time < SHORTEST_S:
        reach = velocity * elapsed
        if signal > position + reach:
            return position + reach, position + reach, velocity
        if signal < position - reach:
            return position - reach, position - reach, -velocity
        return signal, signal, 0.0
    acceleration = velocity / acceleration_time
    begun = speed
    if begun > velocity:
        begun = velocity
    elif begun < -velocity:
        begun = -velocity
    side = 1.0  # from here on the way goes forward
    if signal - position < 0.5 * begun * abs(begun) / acceleration:
        side = -1.0
    distance, begun = side * (signal - position), side * begun
    top = math.sqrt(abs(acceleration * distance + 0.5 * begun * begun))
    if top > velocity:
        top = velocity
    rising, falling, cruise = abs(top - begun) / acceleration, top / acceleration, 0.0
    left = distance - 0.5 * (2.0 * top * top - begun * begun) / acceleration
    if left > 0.0 and top > 0.0:
        cruise = left / top
    left = rising + cruise + falling - elapsed
    if left <= 0.0:
        return signal, signal, 0.0
    if elapsed < rising:
        moved = (begun + 0.5 * acceleration * elapsed) * elapsed
        reached = begun + acceleration * elapsed
    elif left > falling:
        moved = 0.5 * (begun + top) * rising + top * (elapsed - rising)
        reached = top
    else:
        moved = distance - 0.5 * acceleration * left * left
        reached = acceleration * left
    return position + side * moved, position + side * moved, side * reached
