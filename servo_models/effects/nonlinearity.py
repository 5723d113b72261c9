"""Nonlinearity of a sensor."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "signal",
    source="Fraden, Handbook of Modern Sensors, 2016, ch. 3",
    hints=Hints(counted_in=("full_scale",)),
)
def nonlinearity(
    signal: float,
    bow: Annotated[
        float,
        Param(
            "1",
            "relative gain change at full scale, opposite on both sides",
            low=-0.4,
            high=0.4,
            switch=True,
            typical=0.03,
        ),
    ],
    cubic: Annotated[
        float,
        Param(
            "1",
            "relative gain change at full scale, equal on both sides",
            low=-0.4,
            high=0.4,
            switch=True,
            typical=0.03,
        ),
    ],
    full_scale: Annotated[float, Param("signal", "full scale", default=1.0, low=0.1, high=10.0)],
) -> float:
    """y = u (1 + bow r + cubic r^2) with r = u / full_scale."""
    ratio = signal / full_scale
    return signal + signal * ratio * (bow + cubic * ratio)
