"""TOML files that a person wrote, read by declared schemas: every fault with key and cure.

A table of a file is a class whose fields are its keys.  Its docstring shows each of them as it is
written, which is the cure for one that is missing or of another type, and for what is inside it::

    class SweepTable(Table):
        '''A sweep::

            file = "sweep.csv"
            gain = { column = "gain", unit = "dB" }
        '''

        file: str
        gain: Gain

    read_toml(path).read(SweepTable)
    # UserError: 'rig.toml', file: missing; write for example file = "sweep.csv"
"""

from __future__ import annotations

import datetime
import hashlib
import json
import math
import re
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NoReturn,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
import numpy as np

from servo_models.core.bounds import is_outside, outside
from servo_models.core.plant import Parameter, Wire, unknown
from servo_models.errors import UserError, did_you_mean
from servo_models.files import matching, read_regular
from servo_models.units import parse

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")

DEEPEST = 20  # depth of tables and lists inside each other, at most: dotted names have a few parts
LONGEST_PLACE = 100  # characters of a dotted name in a message, at most
LARGEST = 4 << 20  # bytes of a file that a person wrote, at most
DATES = (datetime.date, datetime.datetime, datetime.time)


# What a schema is made of


class Seconds(float):
    """A time: a number in s, or a text with a unit."""

    unit = "s"


class Share(float):
    """A share: a number, or a text such as ``"5 %"``."""

    unit = "1"


Number = Annotated[float, msgspec.Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
"""A finite number without quotes."""
Quantity = float | str  # a number in SI or a text with a unit, for ``quantity``
Column = str | int  # the name of a column, or its number from 1
FAULTS: dict[Any, str] = {
    str: "no text",
    Literal: "no text",
    bool: "neither true nor false",
    int: "no whole number",
    float: "no number",
    datetime.date: "no day",
    list: "no list",
    tuple: "no pair",
    dict: "no table",
}


class Table(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A table of a file; a subclass has a field for each of its keys."""


@dataclass(frozen=True)
class Section:
    """What stands at a place of a TOML file, most often a table.

    Attributes:
        file: the file, for messages.
        name: dotted name of the place, "" for the whole file.
        content: what stands there.
        sha256: hash of the bytes of a whole file.
    """

    file: Path
    name: str
    content: Any
    sha256: str = ""

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def __iter__(self) -> Iterator[str]:
        return iter(self.content)

    def fail(self, key: str, complaint: object) -> NoReturn:
        """Raise UserError: ``complaint`` about ``key``, which may be dotted."""
        raise UserError(f"'{self.file}', {_dotted(self.name, key)}: {complaint}")

    def check_keys(self, known: Collection[str]) -> None:
        """Raise UserError if there is a key that nobody reads."""
        for key in self.content:
            if key not in known:
                self.fail(key, f"unknown key '{key}'; {did_you_mean(key, known)}")

    def at(self, key: str) -> Section:
        """Return what stands at a key."""
        return Section(self.file, _dotted(self.name, key), self.content[key])

    def section(self, key: str) -> Section:
        """Return an inner table, empty where the key is not there."""
        if key not in self:
            return Section(self.file, _dotted(self.name, key), {})
        self.at(key).read(dict[str, Any], f"{key} = {{ ... }}")
        return self.at(key)

    def sections(self, key: str) -> list[Section]:
        """Return a list of inner tables, empty where the key is not there.

        Raises:
            UserError: it is there and empty, or no list of tables.
        """
        if key not in self:
            return []
        tables = self.at(key).read(list[dict[str, Any]], f"[[{key}]]")
        if not tables:
            self.fail(key, f"has no table; add [[{key}]], or remove the key")
        name = _dotted(self.name, key)
        return [Section(self.file, f"{name}[{k}]", table) for k, table in enumerate(tables, 1)]

    def read(self, kind: type[T], example: str = "") -> T:
        """Return what stands here as ``kind``, a ``Table`` or another type of a schema.

        Args:
            kind: the type.
            example: how a person writes what is no ``Table``.

        Raises:
            UserError: it does not fit.  It names the file, the key and the cure.
        """
        try:
            return msgspec.convert(self.content, kind, builtin_types=DATES, dec_hook=_in_unit)
        except (msgspec.ValidationError, UserError) as error:
            _explain(self, kind, example, error)


def _dotted(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key


# What does not fit a schema: msgspec finds that out, but names neither every key nor a cure


def _explain(whole: Section, kind: Any, example: str, error: Exception) -> NoReturn:
    """Refuse the first key of a table that does not fit, or the whole."""
    kinds = _kinds(kind)
    for option in kinds if isinstance(whole.content, Mapping) else ():
        if isinstance(option, type) and issubclass(option, Table):
            for part, inner, written in _fields(whole, option, example):
                part.read(inner, written)
    complaint = error if isinstance(error, UserError) else _fault(whole.content, kinds, example)
    raise UserError(f"'{whole.file}', {whole.name}: {complaint}") from error


def _in_unit(kind: type[Seconds | Share], value: Any) -> Seconds | Share:
    return kind(_in(value, kind.unit))


def _kinds(kind: Any) -> list[Any]:
    """The types that a type is one of."""
    if get_origin(kind) is Annotated:
        return _kinds(get_args(kind)[0])
    if get_origin(kind) in (Union, UnionType):
        return [one for part in get_args(kind) for one in _kinds(part)]
    return [kind]


def _fault(value: Any, kinds: Sequence[Any], example: str) -> str:
    """What is wrong with a value that is of none of these types, and the cure."""
    first = get_origin(kinds[0]) or kinds[0]
    if first is Literal and isinstance(value, str):
        return f"'{value}' is unknown; {did_you_mean(value, get_args(kinds[0]))}"
    if first in (float, int) and type(value) in (float, int):
        fault = f"{value} is {'out of range' if math.isfinite(value) else 'not finite'}"
    else:
        fault = FAULTS.get(first, FAULTS[dict])
    return f"{fault}; write for example {example}"


def _fields(table: Section, kind: type[Table], example: str) -> Iterator[tuple[Section, Any, str]]:
    """What stands at each key of a table, its type and how it is written."""
    known = {field.encode_name: field for field in msgspec.structs.fields(kind)}
    hints = get_type_hints(kind, include_extras=True)
    table.check_keys(known)
    for key, field in known.items():
        line = re.search(rf"^ +(\[*{key}[.\w]*(?: =|\]).*?)(?:  +#.*)?$", kind.__doc__ or "", re.M)
        written = line[1] if line else example
        if key in table:
            yield table.at(key), hints[field.name], written
        elif field.required:
            table.fail(key, f"missing; write for example {written}")


# Files


def read_toml(path: Path) -> Section:
    """Read a TOML file.

    Raises:
        UserError: the file cannot be read, is no text, or is no TOML, with the line; an integer
            beyond 64 bits or too many tables inside each other, with the key.
    """
    try:
        raw = read_regular(path, LARGEST)
        content = tomllib.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise UserError(f"'{path}' is no text in UTF-8: save it as such") from error
    except (ValueError, RecursionError) as error:  # also of an integer of thousands of digits
        raise UserError(f"'{path}' is no TOML: {error}; correct it there") from error
    document = Section(path, "", content, hashlib.sha256(raw).hexdigest())
    _check_values(document, content)
    return document


def _check_values(document: Section, content: Any, names: tuple[str, ...] = ()) -> None:
    """Refuse integers that TOML does not hold, and tables deeper than anybody reads."""
    place = ".".join(names)[:LONGEST_PLACE]
    if len(names) > DEEPEST:
        document.fail(place, f"more than {DEEPEST} tables inside each other; leave tables out")
    if isinstance(content, int) and not -(2**63) <= content < 2**63:
        document.fail(place, "an integer beyond 64 bits; write it with a point, such as 1.0e30")
    if isinstance(content, Mapping | list):
        inner = content.items() if isinstance(content, Mapping) else enumerate(content, start=1)
        for key, value in inner:
            _check_values(document, value, (*names, str(key)))


def named_files(path: Path) -> list[Path]:
    """Return a TOML file and the files that any text in it names; none where it cannot be read.

    Names and patterns are relative to its folder.
    """
    texts = named_texts(path)
    files = [file for text in texts for file in matching(path.parent, text)]
    return [path, *files] if texts else []


def named_texts(path: Path) -> list[str]:
    """Return every text in a TOML file; none where it cannot be read."""
    try:
        return list(_texts(read_toml(path).content))
    except UserError:
        return []


def _texts(content: Any) -> Iterator[str]:
    """All texts of a table, at any depth."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping | list):
        for part in content.values() if isinstance(content, Mapping) else content:
            yield from _texts(part)


def quoted(value: str | int) -> str:
    """Return a text, or a number as it is, as TOML writes it."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


# Numbers with units, and tables by the names of parameters


def quantity(section: Section, key: str, unit: str) -> float:
    """Return a number in ``unit``, or a text such as ``"3 deg"``, in ``unit``.

    Raises:
        UserError: no number, or a unit that does not convert.
    """
    try:
        return _in(section.content[key], unit)
    except UserError as error:
        section.fail(key, error)


def _in(value: Any, unit: str) -> float:
    """A number or a text of a file in ``unit``."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise UserError(f'no number; give one in {unit}, or a text such as "1 {unit}"')
    return parse(value, unit)


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


def named(
    section: Section,
    kind: str,
    known: Mapping[str, object],
    opens: Callable[[Mapping[str, Any]], bool] = lambda table: True,
    place: str = "",
) -> Section:
    """Return a table with what TOML makes of dotted keys under their dotted names.

    Args:
        section: the table.
        kind: what the names are of, for messages; ``place`` what has them.
        known: the names that there are.
        opens: whether a table inside leads to further names, and is not a value itself.

    Raises:
        UserError: a name that is not ``known``, or one given twice, quoted and nested.
    """
    content: dict[str, Any] = {}
    for name, value in _leaves("", section.content, opens):
        if name not in known:
            section.fail(name, unknown(kind, name, known, place))
        if name in content:
            section.fail(name, "given twice, quoted and nested; keep one")
        content[name] = value
    return Section(section.file, section.name, content)


def _leaves(
    prefix: str, table: Mapping[str, Any], opens: Callable[[Mapping[str, Any]], bool]
) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping) and opens(value):
            yield from _leaves(f"{prefix}{key}.", value, opens)
        else:
            yield f"{prefix}{key}", value


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted name as the tables that TOML makes of such names."""
    tree: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, last = name.split(".")
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[last] = value
    return tree
