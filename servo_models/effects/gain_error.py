"""Gain error of a signal."""

from typing import Annotated

from servo_models.core.block import OTHER_UNITS, Ambiguity, Hints, Param, effect


@effect(
    "signal",
    source="definition",
    hints=Hints(
        says="the gain of the {wire} is off by {error}",
        family="gain error",
        parameter_units=(OTHER_UNITS,),
        of_changes=True,
        ambiguity=Ambiguity(
            "the same command three times: unloaded, with a known load, and with twice that load: a"
            " wrong scale of the load grows with it, all else stays",
            ("gain_error",),
            ("constant_load", "gravity_load"),
        ),
    ),
)
def gain_error(
    signal: float,
    error: Annotated[
        float, Param("1", "relative gain error", low=-0.9, high=2.0, switch=True, typical=0.1)
    ],
) -> float:
    """y = (1 + error) u."""
    return signal + error * signal
