"""Dead zone or threshold of a signal."""

from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Param, effect


@effect(
    "signal",
    source="SG90 paper sec. 4.3 (insensitivity zone); valve paper sec. 1 (threshold)",
    hints=Hints(
        says="the {wire} does nothing within {half_width} of zero",
        family="dead zone",
        jump="kept",
        ambiguity=Ambiguity(
            "steps in many sizes from the least that moves it, then a slow triangle of twice"
            " that size at two supplies or loads; log drive or current: not 0 while it sticks means"
            " friction",
            ("dead_zone", "dead_band", "coulomb_friction", "load_friction", "gain_error"),
        ),
    ),
)
def dead_zone(
    signal: float,
    half_width: Annotated[
        float, Param("signal", "half width", high=0.2, switch=True, typical=0.03)
    ],
    kept: Annotated[
        float, Param("1", "part of the half width regained outside: 0 dead zone, 1 threshold")
    ],
) -> float:
    """A signal inside +/- half_width does nothing; beyond, the excess counts."""
    lost = (1.0 - kept) * half_width
    if signal > half_width:
        return signal - lost
    if signal < -half_width:
        return signal + lost
    return 0.0
