"""Isolability: causes that look alike in a log, and the experiment that separates two of them.

A cause is an effect, or a parameter of the plant, whose error looks like one: see ``cause``.  Each
effect's file says what it is confused with.
"""

from __future__ import annotations

from collections.abc import Iterator

from servo_models.core.block import OTHER_UNITS, Ambiguity, Block
from servo_models.core.plant import Plant
from servo_models.effects import effects


def cause(name: str, plant: Plant) -> str:
    """Return the effect that a name of the ``plant`` stands for, or that an error of a parameter
    looks like."""
    parameters = plant.parameters
    place = parameters[name].owner if name in parameters else name
    if place:
        return plant.main(place).effect.name
    like = {unit: it.name for it in _catalogue() for unit in it.hints.parameter_units}
    return like.get(parameters[name].param.unit, like[OTHER_UNITS])


def experiment(first: str, second: str, plant: Plant) -> str:
    """Return what separates two causes, "" where nothing is on record.

    Two places of one effect, and two gains, have nothing on record either.
    """
    return next((it.experiment for it in ambiguities(plant) if it.separates(first, second)), "")


def ambiguities(plant: Plant) -> Iterator[Ambiguity]:
    """Yield what effects declare: those of the catalogue, then those of a plant of one's own."""
    yield from catalogue_ambiguities()
    own = (plant.main(name).effect for name in plant.placements)
    yield from (it.hints.ambiguity for it in own if it.hints.ambiguity)


def catalogue_ambiguities() -> Iterator[Ambiguity]:
    """Yield what effects of the catalogue declare."""
    yield from (it.hints.ambiguity for it in _catalogue() if it.hints.ambiguity)


def _catalogue() -> Iterator[Block]:
    return (block for blocks in effects().values() for block in blocks)
