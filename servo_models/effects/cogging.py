"""Cogging: torque ripple that depends on position."""

import math
from typing import Annotated

from servo_models.core.block import Harmonic, Hints, Param, effect

SHARE = Param("1", "amplitude of a further sine over the first", high=10.0)
COUNT = Param("1", "periods per turn of a further sine", default=24.0, low=1.0, high=720.0)
PHASE = Param("rad", "phase of a further sine", low=-3.15, high=3.15, display="deg")


@effect(
    "load",
    source="Hanselman, Brushless Permanent Magnet Motor Design, 2006, ch. 7",
    hints=Hints(
        says="the torque ripples by {torque}, {count} times a turn",
        phase="phase",
        count="count",
        angle="shaft_angle",
        harmonics=tuple(Harmonic(f"share_{k}", f"count_{k}", f"phase_{k}") for k in (2, 3, 4)),
    ),
)
def cogging(
    load: float,
    shaft_angle: float,
    torque: Annotated[float, Param("signal", "amplitude", high=0.5, switch=True, typical=0.02)],
    count: Annotated[float, Param("1", "periods per turn", default=12.0, low=1.0, high=720.0)],
    phase: Annotated[float, Param("rad", "phase", low=-3.15, high=3.15, display="deg")],
    share_2: Annotated[float, SHARE],
    count_2: Annotated[float, COUNT],
    phase_2: Annotated[float, PHASE],
    share_3: Annotated[float, SHARE],
    count_3: Annotated[float, COUNT],
    phase_3: Annotated[float, PHASE],
    share_4: Annotated[float, SHARE],
    count_4: Annotated[float, COUNT],
    phase_4: Annotated[float, PHASE],
) -> float:
    """Adds torque (sin(count angle + phase) + share_2 sin(count_2 angle + phase_2) + ...).

    Magnets and slots give several sines, of counts that their numbers have as multiples.
    """
    ripple = 0.0
    if torque != 0.0:  # sines take time
        ripple = math.sin(count * shaft_angle + phase)
        if share_2 != 0.0:
            ripple = ripple + share_2 * math.sin(count_2 * shaft_angle + phase_2)
        if share_3 != 0.0:
            ripple = ripple + share_3 * math.sin(count_3 * shaft_angle + phase_3)
        if share_4 != 0.0:
            ripple = ripple + share_4 * math.sin(count_4 * shaft_angle + phase_4)
    return load + torque * ripple
