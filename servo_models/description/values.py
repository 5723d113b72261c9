"""Quantities of a description: numbers in SI or texts with a unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from servo_models.actuator import Parameter, Wire, outside
from servo_models.errors import UserError
from servo_models.toml_file import Section
from servo_models.units import parse


def quantity(section: Section, key: str, unit: str) -> float:
    """Return a number in ``unit``, or a text such as ``"3 deg"``, in ``unit``.

    Raises:
        UserError: no number, or a unit that does not convert.
    """
    found = section.content[key]
    if isinstance(found, bool) or not isinstance(found, (int, float, str)):
        section.fail(key, f'no number; give one in {unit}, or a text such as "1 {unit}"')
    try:
        return parse(found, unit)
    except UserError as error:
        section.fail(key, error)


def setting(section: Section, name: str, what: Parameter | Wire) -> float:
    """Return the value [SI] of a parameter or an input.

    Raises:
        UserError: see ``quantity``; or a value out of bounds.
    """
    kind, bounds = ("parameter", what.param) if isinstance(what, Parameter) else ("input", what)
    value = quantity(section, name, bounds.unit)
    if is_outside(value, bounds.low, bounds.high):
        section.fail(name, outside(kind, name, value, bounds))
    return value


def is_outside(value: float, low: float | None, high: float | None) -> bool:
    return (low is not None and value < low) or (high is not None and value > high)


def flattened(section: Section) -> Section:
    """Return a table with what TOML makes of dotted keys under their dotted names.

    Raises:
        UserError: a name given twice, quoted and nested.
    """
    content: dict[str, Any] = {}
    for name, value in _leaves("", section.content):
        if name in content:
            section.fail(name, "given twice, quoted and nested; keep one")
        content[name] = value
    return Section(section.file, section.name, content)


def _leaves(prefix: str, table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(f"{prefix}{key}.", value)
        else:
            yield f"{prefix}{key}", value
