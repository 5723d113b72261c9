"""Dead band: small changes of the command do nothing."""

from typing import Annotated

from servo_models.core.block import Grid, Hints, Memory, Param, effect


@effect(
    "signal",
    source="servo amplifier data sheets (dead band width in us)",
    hints=Hints(
        says="changes of the {wire} below {half_width} do nothing",
        family="dead zone",
        grid=Grid(low=0.05, high=10.0, least_spacing=0.005),
    ),
)
def dead_band(
    signal: float,
    half_width: Annotated[
        float,
        Param("signal", "change that is ignored", high=0.1, switch=True, typical=0.01),
    ],
    held: Annotated[float, Memory("rest")],
) -> tuple[float, float]:
    """The last accepted command is kept until the new one differs by more than half_width."""
    if abs(signal - held) > half_width or half_width <= 0.0:
        return signal, signal
    return held, held
