"""Parameter files: values of an actuator with unit, uncertainty and where they come from.

A file is TOML.  Names of parameters may be written quoted or as nested tables, which is
what TOML makes of ``[parameters.transport_delay.time]``; every number stands beside its
unit::

    actuator = "torque_motor"               # or "mine.py", seen from this file
    variant = "measured"                    # values of all that is not listed
    method = "simulation error, least squares"
    date = 2026-01-31
    servo_models = "0.1.0"
    warnings = ["back_emf_constant: the logs do not determine it"]

    [logs]
    "step.csv" = "sha256:..."

    [parameters.torque_constant]
    value = 5.2277
    unit = "N.m/A"
    standard_error = 0.012
    origin = "estimated"

    [figures.held_out_rms]                  # what the fit reached
    value = 0.011
    unit = "deg"
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from servo_models.core.catalogue import actuator as find_actuator
from servo_models.core.own_actuator import key_from
from servo_models.core.plant import Actuator, Parameter, check_bounds, unknown
from servo_models.core.simulate import Model, model
from servo_models.data.toml_file import Section, nested, read_toml
from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.units import factor

HEAD = ("actuator", "variant", "method", "date", "servo_models", "warnings")
KEYS = (*HEAD, "logs", "parameters", "figures")


@dataclass(frozen=True)
class Estimate:
    """A parameter's value.

    Attributes:
        name: of the parameter, dotted for that of an effect.
        value: SI.
        standard_error: SI; infinite where the data say nothing, None where nobody asked.
        origin: ``"estimated"``, ``"given"``, or in a few words where it is from.
    """

    name: str
    value: float
    standard_error: float | None = None
    origin: str = "given"


class Figure(NamedTuple):
    """A figure that a fit reached, in ``unit``."""

    value: float
    unit: str = "1"


def installed_version() -> str:
    return metadata.version("servo-models")


@dataclass(frozen=True)
class ParameterSet:
    """Parameters of an actuator, as identified or given.

    Attributes:
        actuator: name, or path of the file of one of your own, see ``catalogue.actuator``.
        variant: it has the values of all that is not listed.
        estimates: one for each parameter listed.
        method: how the values were found, in words.
        logs: names of the files they were found from, with the hash of their bytes,
            ``"sha256:..."``.
        date: of the identification, None if not told.
        version: of servo-models that found them.
        figures: what the fit reached, by name.
        warnings: sentences that whoever uses the values should know.
        file: name of the file it was read from, "" if none.
    """

    actuator: str
    variant: str
    estimates: tuple[Estimate, ...]
    method: str = ""
    logs: Mapping[str, str] = field(default_factory=dict)
    date: datetime.date | None = None
    version: str = field(default_factory=installed_version)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    file: str = field(default="", compare=False)

    def settings(self) -> dict[str, float]:
        """Return the values [SI] by name of the parameter."""
        return {estimate.name: estimate.value for estimate in self.estimates}

    def model(self, overrides: Mapping[str, float | str] | None = None) -> Model:
        """Return the model with these values, and with ``overrides`` as in ``simulate.model``.

        Raises:
            UserError: see ``simulate.model``.
        """
        changes = dict(overrides or {})
        chosen = model(self.actuator, self.variant, {**self.settings(), **changes})
        return replace(chosen, provenance=self.provenance(changes))

    def document(self) -> dict[str, Any]:
        """Return it as what JSON is made of, figures in SI."""
        known = find_actuator(self.actuator).plant_of(self.variant).parameters
        return {
            "actuator": self.actuator,
            "variant": self.variant,
            "method": self.method,
            "date": self.date and self.date.isoformat(),
            "servo_models": self.version,
            "logs": dict(self.logs),
            "parameters": {
                e.name: {
                    "value": e.value,
                    "unit": known[e.name].param.unit,
                    "standard_error": e.standard_error,
                    "origin": e.origin,
                }
                for e in self.estimates
            },
            "figures": {name: figure._asdict() for name, figure in self.figures.items()},
        }

    def provenance(self, overrides: Mapping[str, object]) -> str:
        """Return in words where the values come from."""
        parts = [self.file, self.method, self.date.isoformat() if self.date else ""]
        parts += [f"then set: {', '.join(sorted(overrides))}"] if overrides else []
        return "; ".join(part for part in parts if part)


def with_given(
    nominal: Mapping[str, float], values: Mapping[str, float], estimated: Mapping[str, Estimate]
) -> tuple[Estimate, ...]:
    """Return estimates in the order of ``values``, with what was given unlike the variant.

    ``nominal`` are the variant's values [SI] by name, ``values`` those of the fitted model.
    """
    return tuple(
        estimated.get(name, Estimate(name, value))
        for name, value in values.items()
        if name in estimated or value != nominal[name]
    )


def known_error(error: float) -> float | None:
    """Return a standard error that a file can hold: on a bound, NaN, there is none."""
    return None if math.isnan(error) else error


def write_parameters(chosen: ParameterSet, path: Path) -> None:
    """Write a parameter file; ``read_parameters`` gives the same values, to the last bit.

    A number stands in the unit that a person reads the parameter in, or in SI where the
    conversion would round it.

    Raises:
        UserError: a file not named ``.toml``, a folder that cannot be written, or values
            that the actuator does not take; see ``simulate.model``.
    """
    import tomli_w

    if path.suffix.lower() != ".toml":
        raise UserError(f"'{path}' is no name for a parameter file: let it end in .toml")
    told = chosen.model()
    known = told.plant.parameters
    document = {
        "actuator": key_from(told.actuator, path.parent),
        "variant": chosen.variant,
        "method": chosen.method,
        "date": chosen.date,
        "servo_models": chosen.version,
        "warnings": list(chosen.warnings),
        "logs": dict(chosen.logs),
        "parameters": nested({e.name: _entry(e, known[e.name]) for e in chosen.estimates}),
        "figures": {name: figure._asdict() for name, figure in chosen.figures.items()},
    }
    said = {key: value for key, value in document.items() if value not in (None, "", [], {})}
    write_whole(path, tomli_w.dumps(said).encode())


def _entry(estimate: Estimate, parameter: Parameter) -> dict[str, object]:
    """What stands in the file for an estimate."""
    unit = parameter.param.unit
    numbers = {"value": estimate.value}
    if estimate.standard_error is not None:
        numbers["standard_error"] = estimate.standard_error
    display = parameter.param.display
    if display:
        shown = {key: _in(display, number, unit) for key, number in numbers.items()}
        if all(shown[key] * factor(display, unit) == numbers[key] for key in numbers):
            numbers, unit = shown, display
    return {"value": numbers.pop("value"), "unit": unit, **numbers, "origin": estimate.origin}


def _in(display: str, number: float, unit: str) -> float:
    """``number`` [unit] in the unit ``display``: of the numbers that mean it, the shortest."""
    exact = number * factor(unit, display)
    for digits in (15, 16):
        short = float(f"{exact:.{digits}g}")
        if short * factor(display, unit) == number:
            return short
    return exact


def read_parameters(path: str | Path, trust: bool = False) -> ParameterSet:
    """Read a parameter file, whoever wrote it; only ``actuator`` has to be there.

    Where that is a Python file, it is run: ``trust`` allows this wherever it lies.

    Raises:
        UserError: no such file, no TOML, an unknown key, actuator, variant or parameter, a
            unit that does not convert, a value that is no number or out of its bounds.  It
            names the file and the key.
    """
    document = read_toml(Path(path))
    document.check_keys(KEYS)
    actuator, variant = _whose(document, trust)
    logs, figures = document.section("logs"), document.section("figures")
    return ParameterSet(
        actuator=actuator.key,
        variant=variant,
        estimates=tuple(_estimates(document.section("parameters"), actuator, variant)),
        method=document.text("method"),
        logs={name: logs.text(name) for name in logs},
        date=_date(document),
        version=document.text("servo_models"),
        figures={name: _figure(figures.section(name)) for name in figures},
        warnings=document.texts("warnings"),
        file=document.file.name,
    )


def _whose(document: Section, trust: bool) -> tuple[Actuator, str]:
    """Actuator and variant that a file is for."""
    key = "actuator"
    if key not in document:
        document.fail(key, "missing; name the actuator that the values are for")
    try:
        found = find_actuator(document.text(key), document.file, trust)
        key = "variant"
        return found, found.variant(document.text(key, found.default_variant)).name
    except UserError as error:
        document.fail(key, error)


def _estimates(parameters: Section, actuator: Actuator, variant: str) -> Iterator[Estimate]:
    known = actuator.plant_of(variant).parameters
    met: set[str] = set()
    for name, entry in _entries(parameters, ""):
        if name not in known:
            parameters.fail(name, unknown("parameter", name, known, f"actuator '{actuator.name}'"))
        if name in met:
            parameters.fail(name, "given twice, quoted and nested; keep one")
        met.add(name)
        yield _estimate(entry, known[name])


def _entries(section: Section, prefix: str) -> Iterator[tuple[str, Section]]:
    """Dotted name and table of every parameter; tables of nothing but tables lead to it."""
    for key in section:
        inner, name = section.section(key), f"{prefix}{key}"
        if inner.content and all(isinstance(value, Mapping) for value in inner.content.values()):
            yield from _entries(inner, f"{name}.")
        else:
            yield name, inner


def _estimate(entry: Section, parameter: Parameter) -> Estimate:
    entry.check_keys(("value", "unit", "standard_error", "origin"))
    own = parameter.param.unit
    if "unit" not in entry:
        entry.fail("unit", f'missing; add unit = "{own}", or the one you mean')
    try:
        scale = factor(entry.text("unit"), own)
    except UserError as error:
        entry.fail("unit", error)
    value = scale * entry.number("value")
    try:
        check_bounds(parameter, value)
    except UserError as error:
        entry.fail("value", error)
    spread = None
    if "standard_error" in entry:
        spread = scale * entry.number("standard_error", infinite=True)
        if spread < 0.0:
            entry.fail("standard_error", "below 0; give its size")
    return Estimate(parameter.name, value, spread, entry.text("origin", "given"))


def _figure(entry: Section) -> Figure:
    entry.check_keys(Figure._fields)
    return Figure(entry.number("value"), entry.text("unit", "1"))


def _date(document: Section) -> datetime.date | None:
    found = document.content.get("date")
    if found is not None and type(found) is not datetime.date:
        document.fail("date", "no day; write it without quotes, such as 2026-01-31")
    return found
