"""Actuators by name or file, and models of them.

Those of the catalogue are found by looking into their folder: adding one is adding one there.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from collections.abc import Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from types import ModuleType

from servo_models import actuators as folder
from servo_models.core.bounds import on_bound
from servo_models.core.flatten import flatten
from servo_models.core.own_actuator import check_trust, is_file, load_actuator, simulation
from servo_models.core.plant import Actuator, check_bounds, check_known, check_units
from servo_models.core.simulate import Model, flat_of
from servo_models.errors import UserError
from servo_models.foreign import load
from servo_models.units import parse


def _folders() -> tuple[ModuleType, ...]:
    """The packages of actuators."""
    names = sorted(it.name for it in pkgutil.iter_modules(folder.__path__) if it.ispkg)
    return tuple(importlib.import_module(f"{folder.__name__}.{name}") for name in names)


@functools.cache
def actuators() -> dict[str, Actuator]:
    """Every actuator by name."""
    defined = [getattr(it, "ACTUATORS", None) or (it.ACTUATOR,) for it in _folders()]
    return {actuator.name: actuator for actuator in chain(*defined)}


@functools.cache
def all_actuators() -> dict[str, Actuator]:
    """Every actuator by name, and what else its folder defines: its torque-causal form."""
    defined = [value for module in _folders() for value in vars(module).values()]
    return {value.name: value for value in defined if isinstance(value, Actuator)}


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


find_actuator = actuator  # where an argument is called actuator


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
    """The plant around a simulation that is not ours."""
    if named_in:
        path = named_in.parent / path
        check_trust(path, named_in, trust)
    return load(path, part)


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


def model(
    actuator: str | Actuator,
    variant: str | None = None,
    parameters: Mapping[str, float | str] | None = None,
) -> Model:
    """Choose an actuator, a variant of it and overrides of single parameters.

    Args:
        actuator: name, path of a ``.py`` file of your own, or a declaration of your own.
        variant: name of a parameter set; None for the default one.
        parameters: overrides by name, numbers in SI or strings such as ``"3 deg"``.

    Raises:
        UserError: an unknown name, a wrong unit, a value outside its bounds.

    Example:
        >>> import servo_models as sm
        >>> servo = sm.model("sg90", "measured", {"backlash.half_width": "0.5 deg"})
        >>> round(servo.values["backlash.half_width"], 5)  # rad
        0.00873
    """
    declared = find_actuator(actuator) if isinstance(actuator, str) else actuator
    chosen = declared.variant(variant).name
    plant = declared.plant_of(chosen)
    overrides: dict[str, float] = {}
    for name, value in (parameters or {}).items():
        check_known("parameter", [name], plant.parameters, f"actuator '{declared.name}'")
        parameter = plant.parameters[name]
        try:
            given = parse(value, parameter.param.unit)
        except UserError as error:
            raise UserError(f"parameter '{name}': {error}") from error
        overrides[name] = on_bound(given, parameter.param)
        check_bounds(parameter, overrides[name])
    return Model(
        declared, chosen, declared.values(chosen, overrides), flat_of(plant, declared.name)
    )
