"""Rate-independent hysteresis, magnetic or mechanical."""

import math
from typing import Annotated

from servo_models.core.block import Hints, Memory, Param, effect


@effect(
    "signal",
    source="Coleman, Hodgdon, Int. J. Eng. Sci. 24 (1986) 897, linear material functions",
    hints=Hints(says="the {wire} comes back {half_width} off to either side", family="friction"),
)
def hysteresis(
    signal: float,
    half_width: Annotated[
        float, Param("signal", "half width of the loop", high=0.3, switch=True, typical=0.03)
    ],
    turn: Annotated[
        float,
        Param(
            "signal", "travel in which a reversal is made good", default=0.1, low=0.005, high=1.0
        ),
    ],
    last: Annotated[float, Memory("rest")],
    branch: Annotated[float, Memory()],
) -> tuple[float, float, float]:
    """y = u - half_width z; z tends to the sign of the motion over the travel ``turn``.

    z is the exact solution of dz/du = (sign(du) - z) / turn between two commits.
    """
    if half_width <= 0.0:
        return signal, last, branch
    if signal > last:
        branch = 1.0 - (1.0 - branch) * math.exp((last - signal) / turn)
    elif signal < last:
        branch = -1.0 + (1.0 + branch) * math.exp((signal - last) / turn)
    return signal - half_width * branch, signal, branch
