"""Thermal drift: the gain falls as the winding warms up."""

from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Memory, Param, effect


@effect(
    "signal",
    source="first-order thermal model, heating with the square of the drive",
    hints=Hints(
        says="the gain falls by {loss} when warm",
        counted_in=("full_scale",),
        ambiguity=Ambiguity(
            "ten minutes of the same step", ("thermal_drift",), ("supply_sag", "gain_error")
        ),
    ),
)
def thermal_drift(
    signal: float,
    elapsed: float,
    loss: Annotated[
        float,
        Param(
            "1",
            "relative gain lost when warm at full drive",
            low=-0.5,
            high=0.5,
            switch=True,
            typical=0.1,
        ),
    ],
    time_constant: Annotated[
        float, Param("s", "thermal time constant", default=60.0, low=1.0, high=3600.0)
    ],
    full_scale: Annotated[float, Param("signal", "full drive", default=1.0, low=0.1, high=10.0)],
    warmth: Annotated[float, Memory()],
) -> tuple[float, float]:
    """y = (1 - loss w) u;  time_constant w' = (u / full_scale)^2 - w, trapezoidal."""
    drive = signal / full_scale
    gained = elapsed / (time_constant + 0.5 * elapsed)
    warmth = warmth + gained * (drive * drive - warmth)
    return signal - loss * warmth * signal, warmth
