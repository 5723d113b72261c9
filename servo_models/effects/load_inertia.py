"""Additional inertia on the shaft."""

from typing import Annotated

from servo_models.core.block import UNLOADED, Ambiguity, Hints, Param, effect


@effect(
    "shaft_inertia",
    source="definition",
    hints=Hints(
        says="{inertia} more inertia",
        ambiguity=Ambiguity(
            "add a known inertia, or switch the torque off and let it run out",
            ("load_inertia",),
            ("gain_error",),
        ),
        parameter_units=("kg", "kg.m2"),
        bench=(UNLOADED,),
    ),
)
def load_inertia(
    shaft_inertia: float,
    inertia: Annotated[
        float, Param("signal", "added inertia", high=20.0, switch=True, typical=0.3)
    ],
) -> float:
    """Adds to the inertia that the torque accelerates."""
    return shaft_inertia + inertia
