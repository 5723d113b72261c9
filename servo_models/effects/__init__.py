"""Effects: one file, one unmodelled effect.  With its switches at 0 it is the identity.

They are found by looking into this folder: adding one is adding one here.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from typing import Any

from servo_models.core.block import Block
from servo_models.core.plant import Placement, place


@functools.cache
def effects() -> dict[str, tuple[Block, ...]]:
    """Every effect by its file's name; an effect may have several functions."""
    names = sorted(it.name for it in pkgutil.iter_modules(__path__))
    modules = {name: importlib.import_module(f"{__name__}.{name}") for name in names}
    return {
        name: tuple(it for it in vars(module).values() if isinstance(it, Block) and it.acts_on)
        for name, module in modules.items()
    }


def effects_on(
    wire: str | tuple[str, ...], *names: str, **changes: Mapping[str, Any]
) -> tuple[Placement, ...]:
    """Place effects of the catalogue on a wire, in this order.

    Each name is that of an effect, or ends with it where an actuator has several of that kind:
    ``drive_dead_zone`` is a ``dead_zone``.  An effect of several functions, or of another name, is
    placed by ``plant.place``.

    Args:
        wire: wire that the effects rewrite, or the wires where they rewrite several at once.
        names: names of the effects at this place; their parameters are ``name.key``.
        changes: fields of a parameter in place of the effect's own, by its
            key; a unit ``"signal"`` makes them fractions of the wire's full scale.

    Raises:
        ValueError: a name that ends with no effect, or a change of what none has.

    Example:
        >>> import servo_models as sm
        >>> placed = sm.effects_on("drive", "hysteresis", "drive_saturation")
        >>> [effect.name for effect in placed]
        ['hysteresis', 'drive_saturation']
    """
    chosen = {name: _effect_of(name) for name in names}
    for key in changes:
        if not any(key in effect.params for effect in chosen.values()):
            raise ValueError(f"no effect among {', '.join(names)} has a parameter '{key}'")
    return tuple(
        place(
            name,
            effect,
            *((wire,) if isinstance(wire, str) else wire),
            params={key: change for key, change in changes.items() if key in effect.params},
        )
        for name, effect in chosen.items()
    )


def _effect_of(name: str) -> Block:
    """The effect whose name a placement's name is or ends with."""
    fitting = [one for one in effects() if f"_{name}".endswith(f"_{one}")]
    if not fitting:
        raise ValueError(
            f"'{name}' ends with the name of no effect: place it by servo_models.place"
        )
    functions = effects()[max(fitting, key=len)]
    if len(functions) > 1:
        raise ValueError(f"'{name}' has several functions: place each of them by plant.place")
    return functions[0]
