"""Supply sag: the source has a resistance."""

from typing import Annotated

from servo_models.core.block import Bench, Hints, Param, effect


@effect(
    "signal",
    source="Ohm's law",
    hints=Hints(
        says="the supply has a resistance of {resistance}",
        bench=(Bench("feed it from a stiff supply by short, thick wires", 300.0),),
    ),
)
def supply_sag(
    signal: float,
    supply_current: float,
    supply_conductance: float,
    resistance: Annotated[
        float,
        Param("signal/{supply_current}", "source resistance", switch=True, typical=0.05),
    ],
) -> float:
    """y = u - resistance i, with i the current [A] that the load takes.

    ``supply_current`` is what a stiff source would deliver; where it reacts at once to
    the supply, ``supply_conductance`` [S] tells by how much, else it is 0.
    """
    return signal - resistance * supply_current / (1.0 + resistance * supply_conductance)
