"""Columns of a measured file as a draft looks at them: words, unit, table, numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from servo_models.core.types import Array
from servo_models.data.readers import Columns, read_columns
from servo_models.errors import UserError
from servo_models.units import exponents

SUFFIXES = {
    "s": "s",
    "sec": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "rad": "rad",
    "mrad": "mrad",
    "deg": "deg",
    "rad_s": "rad/s",
    "radps": "rad/s",
    "deg_s": "deg/s",
    "dps": "deg/s",
    "rpm": "rpm",
    "m": "m",
    "mm": "mm",
    "um": "um",
    "m_s": "m/s",
    "mm_s": "mm/s",
    "v": "V",
    "mv": "mV",
    "volts": "V",
    "a": "A",
    "ma": "mA",
    "n": "N",
    "nm": "N.m",
    "mnm": "mN.m",
}
"""How authors write units behind an underscore, in lower case."""


@dataclass(frozen=True, eq=False)
class Column:
    """A column of numbers.

    Attributes:
        key: name, or number from 1 where the file names none.
        table: topic, None where the file has but one table.
        words: of its name, in lower case, without the unit.
        unit: as the name tells it, None where it does not.
        values: shape (n,).
    """

    key: str | int
    table: str | None
    words: tuple[str, ...]
    unit: str | None
    values: Array

    @cached_property
    def rising(self) -> bool:
        """Whether it never falls, and repeats at most now and then: as times do."""
        steps = np.diff(self.values)
        return bool(len(steps) and (steps >= 0.0).all() and np.mean(steps > 0.0) > 0.5)

    @property
    def moves(self) -> bool:
        return bool(np.ptp(self.values))


@dataclass(frozen=True)
class LeftOut:
    """A column that is not numbers throughout.

    Attributes:
        key, table: as of a ``Column``.
        why: file, row and cell in words, with the cure.
        damaged: most of its cells are numbers, so it was meant to be one of them.
    """

    key: str | int
    table: str | None
    why: str
    damaged: bool


def columns_of(path: Path) -> tuple[list[Column], list[LeftOut]]:
    """Return the columns of a file that are numbers throughout, and the others, table by table.

    Raises:
        UserError: see ``logs.read_columns``; or there is no column of numbers.
    """
    every = [
        _column(columns, place, table)
        for table, columns in _tables(path)
        for place in range(len(columns.names))
    ]
    found = [column for column in every if isinstance(column, Column)]
    left_out = [column for column in every if isinstance(column, LeftOut)]
    if not found:
        why = next((f": {column.why}" for column in left_out if column.damaged), "")
        raise UserError(
            f"'{path}' has no column of numbers throughout: repair one, then --init{why}"
        )
    return found, left_out


def _tables(path: Path) -> Iterator[tuple[str | None, Columns]]:
    """Tables of a file; where it has several, their columns are called ``table.column``."""
    every = read_columns(path)
    tables: dict[str, Columns] = {}
    for name in every.names:
        if any(name.startswith(f"{table}.") for table in tables):
            continue
        for dot in re.finditer(r"\.", name):
            try:
                tables[name[: dot.start()]] = read_columns(path, name[: dot.start()])
                break
            except UserError:
                continue
    if tables:
        yield from tables.items()
    else:
        yield None, every


def _column(columns: Columns, place: int, table: str | None) -> Column | LeftOut:
    name = columns.names[place]
    key = place + 1 if name.isdigit() or columns.names.count(name) > 1 else name
    try:
        values = columns.numbers(key)
    except UserError as error:
        return LeftOut(key, table, str(error), _is_mostly_numbers(columns, place))
    if not len(values):
        return LeftOut(key, table, f"{columns.where(key)} has no rows: record it again", False)
    words, unit = heading(name)
    own = () if isinstance(key, int) and name.isdigit() else words
    return Column(key, table, own, unit, values)


def _is_mostly_numbers(columns: Columns, place: int) -> bool:
    import polars as pl

    cells = columns.cells[place]
    if not (cells.dtype.is_numeric() or cells.dtype == pl.String):
        return False
    values = cells.cast(pl.Float64, strict=False)
    return 2 * int(values.is_finite().sum()) > len(values)


def heading(name: str) -> tuple[tuple[str, ...], str | None]:
    """Return the words of a column's name, in lower case, and its unit if it tells one.

    ``angle [deg]``, ``angle (deg)`` and ``angle_deg`` tell one, the index of ``angle[0]`` does not.
    """
    bracket = re.fullmatch(r"\s*(.*?)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*", name)
    if bracket:
        return _words(bracket[1]), _known(bracket[2])
    parts = re.split(r"[_\s]+", name.strip())
    for count in (2, 1):
        suffix = "_".join(parts[-count:]).lower()
        if len(parts) > count and suffix in SUFFIXES:
            return _words("_".join(parts[:-count])), SUFFIXES[suffix]
    return _words(name), None


def _known(unit: str) -> str | None:
    if not re.search("[^\\W\\d]|[%°]", unit):  # an index
        return None
    try:
        exponents(unit)
    except UserError:
        return None
    return unit


def _words(name: str) -> tuple[str, ...]:
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return tuple(word for word in re.split(r"[^A-Za-z]+", spaced.lower()) if word)
