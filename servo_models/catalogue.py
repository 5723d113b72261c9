"""Find actuators and effects by looking into their folders: adding one is adding a file."""

from __future__ import annotations

import functools
import importlib
import pkgutil
from pathlib import Path
from types import ModuleType

from servo_models.actuator import Actuator, unknown
from servo_models.block import Block
from servo_models.errors import UserError
from servo_models.own_actuator import load_actuator


def _modules(folder: str) -> dict[str, ModuleType]:
    package = importlib.import_module(f"servo_models.{folder}")
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__))
    return {name: importlib.import_module(f"{package.__name__}.{name}") for name in names}


@functools.cache
def actuators() -> dict[str, Actuator]:
    """Every actuator by name."""
    found = [module.ACTUATOR for module in _modules("actuators").values()]
    return {actuator.name: actuator for actuator in found}


@functools.cache
def effects() -> dict[str, tuple[Block, ...]]:
    """Every effect by its file's name; an effect may have several functions."""
    return {
        name: tuple(
            value for value in vars(module).values() if isinstance(value, Block) and value.acts_on
        )
        for name, module in _modules("effects").items()
    }


def actuator(name: str, folder: Path = Path()) -> Actuator:
    """Return an actuator by name, or the one that a Python file of your own defines.

    Args:
        name: of the actuator, or the path of a file that ends in ``.py``.
        folder: where such a path begins.

    Raises:
        UserError: nobody knows that name; see ``own_actuator.load_actuator``.
    """
    if name.endswith(".py"):
        return load_actuator(folder / name)
    if name not in actuators():
        raise UserError(unknown("actuator", name, actuators()))
    return actuators()[name]
