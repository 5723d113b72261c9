"""Constant load torque."""

from typing import Annotated

from servo_models.core.block import UNLOADED, Hints, Param, effect


@effect(
    "load",
    source="definition",
    hints=Hints(says="a constant load of {torque}", family="load", bench=(UNLOADED,)),
)
def constant_load(
    load: float,
    torque: Annotated[
        float, Param("signal", "load torque", low=-1.0, high=1.0, switch=True, typical=0.1)
    ],
) -> float:
    """Adds a constant to the load torque."""
    return load + torque
