"""Find actuators and effects by looking into their folders: adding one is adding one there."""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any

from servo_models.core.block import Block
from servo_models.core.flatten import flatten
from servo_models.core.own_actuator import check_trust, is_file, load_actuator, simulation
from servo_models.core.plant import Actuator, Placement, check_known, check_units, place
from servo_models.errors import UserError


def _modules(folder: str, packages: bool) -> dict[str, ModuleType]:
    """The modules of a folder of the package, or the packages in it."""
    package = importlib.import_module(f"servo_models.{folder}")
    every = pkgutil.iter_modules(package.__path__)
    names = sorted(module.name for module in every if module.ispkg is packages)
    return {name: importlib.import_module(f"{package.__name__}.{name}") for name in names}


@functools.cache
def actuators() -> dict[str, Actuator]:
    """Every actuator by name."""
    modules = _modules("actuators", packages=True).values()
    defined = [getattr(module, "ACTUATORS", None) or (module.ACTUATOR,) for module in modules]
    return {actuator.name: actuator for actuator in chain(*defined)}


@functools.cache
def all_actuators() -> dict[str, Actuator]:
    """Every actuator by name, and what else its folder defines: its torque-causal form."""
    modules = _modules("actuators", packages=True).values()
    defined = [value for module in modules for value in vars(module).values()]
    return {value.name: value for value in defined if isinstance(value, Actuator)}


@functools.cache
def effects() -> dict[str, tuple[Block, ...]]:
    """Every effect by its file's name; an effect may have several functions."""
    return {
        name: tuple(
            value for value in vars(module).values() if isinstance(value, Block) and value.acts_on
        )
        for name, module in _modules("effects", packages=False).items()
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


def actuator(name: str, named_in: Path | None = None, trust: bool = False) -> Actuator:
    """Return an actuator by name, or the one that a Python file of your own defines.

    Args:
        name: name of the actuator, or the path of a file that ends in ``.py``, which is run.
        named_in: file that names it, None for a person; a path begins in that file's folder.
        trust: run the Python file even if it does not lie beside ``named_in``.

    Raises:
        UserError: nobody knows that name; see ``own_actuator.load_actuator`` and ``check_trust``.

    Example:
        >>> import servo_models as sm
        >>> sm.actuator("sg90").default_variant
        'measured'
    """
    if box := simulation(name):
        return _foreign(*box, named_in, trust)
    if is_file(name):
        return _own(Path(name), named_in, trust)
    return of_catalogue(name)


def of_one_variant(name: str) -> Actuator:
    """Return an actuator, with that variant alone which a name of the catalogue has behind a colon.

    Example:
        >>> [variant.name for variant in of_one_variant("smart_servo:sts3215").variants]
        ['sts3215']
    """
    known, _, variant = name.partition(":")
    if not variant or known not in all_actuators():  # ``sim.py:simulate`` is a simulation
        return actuator(name)
    found = all_actuators()[known]
    return replace(found, variants=(found.variant(variant),))


def of_catalogue(name: str) -> Actuator:
    """Return an actuator by name; what stands in an FMU can name no other.

    Raises:
        UserError: nobody knows that name.
    """
    check_known("actuator", [name], all_actuators())
    return all_actuators()[name]


def _foreign(path: Path, part: str, named_in: Path | None, trust: bool) -> Actuator:
    """The plant around a simulation that is not ours; its libraries are loaded for it alone."""
    if named_in:
        path = named_in.parent / path
        check_trust(path, named_in, trust)
    loaded: Actuator = importlib.import_module("servo_models.foreign").load(path, part)
    return loaded


def _own(path: Path, named_in: Path | None, trust: bool) -> Actuator:
    """Load a person's own actuator and find out whether its declarations fit together."""
    if named_in:
        path = named_in.parent / path
        check_trust(path, named_in, trust)
    loaded = load_actuator(path)
    for variant in loaded.variants:
        plant = loaded.plant_of(variant.name)
        try:
            flatten(plant, loaded.name)
            check_units(plant)
            loaded.values(variant.name)
        except (ValueError, UserError) as error:
            raise UserError(f"'{path}': {error}") from error
    return loaded
