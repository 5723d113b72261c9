"""Additional viscous friction."""

from typing import Annotated

from servo_models.core.block import Hints, Param, effect


@effect(
    "load",
    source="definition",
    hints=Hints(
        says="drag of {torque} at full speed",
        family="friction",
        parameter_units=("N.m.s/rad", "N.s/m"),
    ),
)
def viscous_friction(
    load: float,
    shaft_speed: float,
    full_speed: float,
    torque: Annotated[
        float, Param("signal", "drag torque at full speed", high=20.0, switch=True, typical=0.1)
    ],
) -> float:
    """Adds torque v / v_full to the load."""
    return load + torque * (shaft_speed / full_speed)
