"""Supply limit: no amplifier gives more than its supply."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "signal",
    source="SG90 paper sec. 4.2 (the range printed there is the tested one)",
    hints=Hints(says="the drive has {share} of the supply at most", family="limit", inverse=True),
)
def supply_limit(
    signal: float,
    supply: float,
    share: Annotated[
        float,
        Param("1", "largest drive as a part of the supply, 0 for none", switch=True, typical=1.0),
    ],
) -> float:
    """y = u, but never more than share x supply in magnitude."""
    if share <= 0.0:
        return signal
    limit = share * abs(supply)
    if signal > limit:
        return limit
    if signal < -limit:
        return -limit
    return signal
