"""Log descriptions: which actuator, what is known of it, and what the columns of its logs are.

A description is a TOML file beside the logs; ``docs/description.md`` shows every key.
"""

from __future__ import annotations

import functools
import os.path
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from servo_models.catalogue import actuator as find_actuator
from servo_models.catalogue import model
from servo_models.core.own_actuator import check_trust, is_file, simulation
from servo_models.core.plant import Actuator, unknown
from servo_models.core.simulate import Model, of_named
from servo_models.data.log import Log
from servo_models.data.parameters import ParameterFile, ParameterSet, read_parameters
from servo_models.data.readers import Columns, is_bag, read_columns, suffixes
from servo_models.data.readers.lerobot import is_data_set
from servo_models.data.runs import check_apart, runs
from servo_models.data.schema import (
    Quantity,
    Section,
    Table,
    named,
    quantity,
    read_toml,
    setting,
)
from servo_models.data.signals import read_clock, read_log
from servo_models.errors import UserError

SIMULATION = "simulation"  # identification by simulating the logs
TRANSFER_FUNCTION = "transfer_function"  # identification from frequency responses
ELEMENTS = "elements"  # identification element by element


class DescriptionTable(Table):
    """A description; who uses ``sweeps`` and ``elements`` reads them from its document.

    Written as::

        actuator = "torque_motor"
        variant = "measured"
        params = "identified.toml"
        free = ["torque_constant", "inductance"]
        method = "simulation"
        parameters = { resistance = "3650 Ohm" }
        uncertainty = { torque_constant = "25 %" }
        bounds = { inductance = ["25 H", "40 H"] }
        [[logs]]
        [[sweeps]]
        [elements]
    """

    actuator: str | None = None
    variant: str | None = None
    params: str | None = None
    free: list[str] = []
    method: Literal["simulation", "transfer_function", "elements"] | None = None
    parameters: dict[str, Any] = {}
    uncertainty: dict[str, Any] = {}
    bounds: dict[str, Any] = {}
    logs: list[dict[str, Any]] = []
    sweeps: list[dict[str, Any]] = []
    elements: dict[str, Any] = {}


@dataclass(frozen=True, eq=False, repr=False)
class Description:
    """What a description says.

    Attributes:
        path: the file, and ``document`` what stands in it.
        model: the actuator with its nominal values.
        parameters: overrides of the variant's values [SI] by name.
        uncertainty: standard deviation [SI] of nominal values, by name; of the variant
            where the description is silent.
        bounds: least and largest value [SI] of a fit, by name.
        logs: at least one, unless there are other records.
        free: parameters or effects to be estimated.
        method: method of identification, None if not told.
    """

    path: Path
    document: Section
    model: Model
    parameters: Mapping[str, float]
    uncertainty: Mapping[str, float]
    logs: tuple[Log, ...]
    free: tuple[str, ...] = ()
    method: str | None = None
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __repr__(self) -> str:
        names = ", ".join(f"'{log.name}'" for log in self.logs)
        return f"<Description of {self.actuator.name}, variant {self.variant}: logs {names}>"

    @property
    def actuator(self) -> Actuator:
        return self.model.actuator

    @property
    def variant(self) -> str:
        return self.model.variant


def read_description(path: str | Path, trust: bool = False, planned: bool = False) -> Description:
    """Read a description and its logs.

    Where its actuator is a Python file, that is run: ``trust`` allows this wherever it lies.
    ``planned`` logs may lack columns of outputs, which are NaN then: a command is yet to be played.

    Raises:
        UserError: a log, a folder or no TOML; an unknown key, actuator, variant, parameter or
            signal; a unit that does not convert; a value out of bounds; a log that cannot be read
            or used, see ``signals.read_log``.  It names the file, and the key or row and column.

    Example:
        >>> import servo_models as sm
        >>> description = sm.read_description("gimbal.toml")
        >>> description.logs[0].outputs["reading"].shape  # rad
        (400,)
    """
    check_is_description(Path(path))
    document = read_toml(Path(path))
    table = document.read(DescriptionTable)
    chosen, parameters = _model(document, table, trust)
    return described(document, chosen, parameters, planned=planned)


def code_of(path: Path) -> str | None:
    """Return the file that a description or its parameters have run; None if it cannot be read."""
    try:
        table = read_toml(path).read(DescriptionTable)
        known = table.params and read_toml(path.parent / table.params).read(ParameterFile).actuator
    except UserError:
        return None
    return next((name for name in (table.actuator, known) if name and is_file(name)), None)


def check_is_description(path: Path) -> None:
    """Refuse a log, or a folder, in place of a description.

    Raises:
        UserError: it is one; the message names the description there, or how to begin one.
    """
    is_folder = os.path.isdir(path)  # False for a name that is too long
    if not is_folder and path.suffix.lower() == ".toml":
        return
    what = "a folder, no description" if is_folder else "no description"
    files = sorted(path.iterdir()) if is_folder else [path.with_suffix(".toml"), path]
    if told := next(filter(tells_of_logs, files), None):
        raise UserError(f"'{path}' is {what}; there is one: '{told}'")
    logs = (file for file in files if file.suffix.lower() in suffixes() and file.is_file())
    is_log = not is_folder or is_bag(path) or is_data_set(path)
    log = path if is_log else next(logs, None)
    if not log:
        raise UserError(f"'{path}' is a folder without a log: name a description or a log")
    raise UserError(f"'{path}' is {what}; begin one with 'servo-models check {log} --init'")


def tells_of_logs(path: Path, damaged: bool = False) -> bool:
    """Return whether a file is TOML with ``[[logs]]``; ``damaged`` for one that cannot be read."""
    try:
        if path.suffix.lower() != ".toml" or not path.is_file():
            return False
        return isinstance(read_toml(path).content.get("logs"), list)
    except (UserError, OSError):
        return damaged


def described(
    document: Section,
    chosen: Model,
    parameters: Mapping[str, float],
    tables: Mapping[str, Columns] | None = None,
    planned: bool = False,
) -> Description:
    """Return what a document says beside its nominal model, which has these overrides [SI].

    ``tables`` are in memory, by the name that stands as their file in the document; ``planned``
    is that of ``read_description``.

    Raises:
        UserError: see ``read_description``.
    """
    table = document.read(DescriptionTable)
    uncertainty = _uncertainty(document.section("uncertainty"), chosen)
    logs = _logs(document, chosen, tables or {}, planned)
    free = _free(document, table.free, chosen)
    bounds = _bounds(document.section("bounds"), chosen, uncertainty)
    named_in_logs = {name for log in logs for name in (*log.inputs, *log.outputs, *log.constants)}
    if logs and not table.sweeps:
        chosen = of_named(chosen, named_in_logs.union(uncertainty, free, bounds))
    return Description(
        path=document.file,
        document=document,
        model=chosen,
        parameters=parameters,
        uncertainty=uncertainty,
        logs=logs,
        free=free,
        method=table.method,
        bounds=bounds,
    )


def _model(
    document: Section, table: DescriptionTable, trust: bool
) -> tuple[Model, dict[str, float]]:
    """The nominal model, and the overrides that made it of its variant."""
    known = None if table.params is None else _known_before(document, table.params, trust)
    actuator = _actuator(document, table.actuator, known, trust)
    default = known.variant if known else actuator.default_variant
    given = default if table.variant is None else table.variant
    if known and (actuator.key, given) != (known.actuator, default):
        document.fail(
            "params",
            f"'{known.file}' is of actuator '{known.actuator}', variant '{default}', not of"
            f" '{actuator.key}', '{given}'; leave out actuator and variant here",
        )
    try:
        variant = actuator.variant(given).name
    except UserError as error:
        document.fail("variant", error)
    parameters = actuator.plant_of(variant).parameters
    section = named(document.section("parameters"), "parameter", parameters)
    overrides = {name: setting(section, name, parameters[name]) for name in section}
    if known:
        return known.model(overrides), {**known.settings(), **overrides}
    return model(actuator, variant, overrides), overrides


def _known_before(document: Section, params: str, trust: bool) -> ParameterSet:
    path = document.file.parent / params
    try:
        actuator = read_toml(path).read(ParameterFile).actuator
        if is_file(actuator):
            code = simulation(actuator) or (actuator, "")
            check_trust(path.parent / code[0], document.file, trust)
        return read_parameters(path, trust)
    except UserError as error:
        document.fail("params", error)


def _actuator(
    document: Section, name: str | None, known: ParameterSet | None, trust: bool
) -> Actuator:
    if known and name is None:
        return find_actuator(known.actuator)
    if name is None:
        document.fail("actuator", "missing; name the actuator that made the logs")
    try:
        return find_actuator(name, document.file, trust)
    except UserError as error:
        document.fail("actuator", error)


def _uncertainty(given: Section, chosen: Model) -> dict[str, float]:
    """Standard deviations [SI] by name."""
    variant = chosen.actuator.variant(chosen.variant)
    relative = {
        name: share * abs(chosen.values[name]) for name, share in variant.uncertainty.items()
    }
    spread = {name: size for name, size in relative.items() if size > 0.0}
    known = chosen.plant.parameters
    section = named(given, "parameter", known)
    for name in section:
        text = section.content[name]
        if isinstance(text, str) and text.strip().endswith("%"):
            share = quantity(section, name, "1")
            spread[name] = share * abs(chosen.values[name])
            cure = "it is a share of the nominal value; give a size with a unit"
            if chosen.values[name]:
                cure = "give a share above 0"
        else:
            spread[name] = quantity(section, name, known[name].param.unit)
            cure = "give a size above 0"
        if not spread[name] > 0.0:
            section.fail(name, f"a standard deviation of {spread[name]:g}: {cure}")
    return spread


def _bounds(
    given: Section, chosen: Model, uncertain: Container[str]
) -> dict[str, tuple[float, float]]:
    """Least and largest value [SI] by name, each inside the bounds of the actuator.

    The nominal value lies between them, unless it is 0 and certain, so that an effect is off.
    """
    known = chosen.plant.parameters
    section, bounds = named(given, "parameter", known), {}
    for name in section:
        unit = known[name].param.unit
        example = f'{name} = ["1 {unit}", "2 {unit}"]'
        pair = section.at(name).read(tuple[Quantity, Quantity], example)
        ends = [Section(section.file, section.name, {name: end}) for end in pair]
        low, high = (setting(end, name, known[name]) for end in ends)
        if not low < high:
            section.fail(name, "leaves no room; give the lower one first")
        value = chosen.values[name]
        off = known[name].param.switch and not value and name not in uncertain
        if not (off or low <= value <= high):
            section.fail(
                name, f"the nominal value, {value:g} {unit}, lies outside these; give wider ones"
            )
        bounds[name] = (low, high)
    return bounds


def _free(document: Section, free: Sequence[str], chosen: Model) -> tuple[str, ...]:
    known = {**chosen.plant.parameters, **chosen.plant.placements}
    for name in free:
        if name not in known:
            document.fail("free", unknown("parameter or effect", name, known))
    return tuple(free)


def _logs(
    document: Section, chosen: Model, tables: Mapping[str, Columns], planned: bool
) -> tuple[Log, ...]:
    entries, sweeps = document.sections("logs"), document.sections("sweeps")
    if not entries and not sweeps and "elements" not in document:
        document.fail("logs", "missing; add [[logs]] with file, time and outputs")
    read, clocks = functools.cache(read_columns), functools.cache(read_clock)
    logs: list[Log] = []
    for section in entries:
        by_file: dict[Path, list[tuple[Section, Log]]] = {}
        for entry in runs(section, tables):
            log = read_log(entry, chosen, read, clocks, tables, planned)
            of_file = by_file.setdefault(log.path.resolve(), [])
            check_apart(entry, log, of_file)
            if log.name in (other.name for other in logs):
                entry.fail("name", f"a second log '{log.name}'; give each a name of its own")
            of_file.append((entry, log))
            logs.append(log)
    return tuple(logs)
