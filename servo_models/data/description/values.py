"""Quantities of a description: numbers in SI or texts with a unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from servo_models.core.bounds import is_outside, outside
from servo_models.core.plant import Parameter, Wire, unknown
from servo_models.data.toml_file import Section
from servo_models.errors import UserError
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
    """Return the value [SI] of a parameter or an input; true or false for one that is a flag.

    Raises:
        UserError: see ``quantity``; or a value out of bounds.
    """
    if isinstance(what, Wire) and what.flag and isinstance(section.content[name], bool):
        return float(section.content[name])
    kind, bounds = ("parameter", what.param) if isinstance(what, Parameter) else ("input", what)
    value = quantity(section, name, bounds.unit)
    if is_outside(np.array(value), bounds):
        section.fail(name, outside(kind, name, value, bounds))
    return value


def named(section: Section, kind: str, known: Mapping[str, object]) -> Section:
    """Return a table with what TOML makes of dotted keys under their dotted names.

    Raises:
        UserError: a name that is not ``known``, or one given twice, quoted and nested.
    """
    content: dict[str, Any] = {}
    for name, value in _leaves("", section.content):
        if name not in known:
            section.fail(name, unknown(kind, name, known))
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
