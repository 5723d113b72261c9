"""Which rows of a file belong to a log, and when they were sampled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servo_models.core.simulate import LONGEST_RUN
from servo_models.core.types import Array, Mask
from servo_models.data.description.values import quantity
from servo_models.data.readers import Columns
from servo_models.data.toml_file import Section
from servo_models.errors import UserError
from servo_models.units import factor

KEYS = ("column", "unit", "table", "repeats")
MOST_EMPTY = 1000.0
"""Usual steps in a log for each of its rows: more is a clock that has jumped."""
MOST_PER_ROW = 3e3
"""Internal steps of the model between two rows: more is a wrong unit."""
SENSIBLE_PER_ROW = 300.0  # the same, of a unit that is offered instead
SHORTER = ("ms", "us", "ns")
SHORTEST = 1e-12
"""Usual step [s] below which no clock of a log has ticked."""


@dataclass(frozen=True, eq=False)
class Clock:
    """The rows kept of a table, with their times.

    Attributes:
        columns: the table; its column ``column`` holds the times in ``unit``.
        stamps: times of the rows kept as they stand in the file, shape (n,).
        rows: their places in the table, counted from 0, shape (n,).
        begin: time in the file's first row, in ``unit``.
    """

    columns: Columns
    column: str | int
    unit: str
    stamps: Array
    rows: NDArray[np.int64]
    begin: float

    @property
    def scale(self) -> float:
        return factor(self.unit, "s")

    @property
    def since(self) -> Array:
        """Times since the file's first row [s], shape (n,)."""
        return (self.stamps - self.begin) * self.scale

    def cut(self, first: int, last: int) -> Clock:
        """Keep rows ``first`` to ``last`` - 1 of the ones kept."""
        return replace(self, stamps=self.stamps[first:last], rows=self.rows[first:last])

    def numbers(self, column: str | int) -> Array:
        """Return a column of the table in the rows kept, shape (n,).

        Raises:
            UserError: see ``Columns.numbers``; or a column not as long as that of the times.
        """
        lengths = [len(self.columns.cells[self.columns.index(c)]) for c in (column, self.column)]
        if lengths[0] != lengths[1]:
            raise UserError(
                f"{self.columns.where(column)} has {lengths[0]} rows, the time {lengths[1]}: name"
                " columns that were sampled together, or the table of each"
            )
        first = int(self.rows[0])
        found = self.columns.numbers(column, slice(first, int(self.rows[-1]) + 1))
        return found[self.rows - first]


def time_table(entry: Section) -> str | None:
    """Return the name of the table that the log's times are in, None if there is but one."""
    given = entry.content.get("time")
    own = given.get("table") if isinstance(given, Mapping) else None
    name = own if isinstance(own, str) else entry.text("table")
    return name or None


def read_clock(entry: Section, columns: Columns, held: bool = False) -> Clock:
    """Read the times of a table as ``entry`` describes them.

    Args:
        entry: the description of the log.
        columns: the table.
        held: the values of the table are held, so that a time may repeat: the last row counts.

    Raises:
        UserError: no column for the time, a unit that is none of time, time that runs
            backward or repeats.
    """
    time = _section(entry)
    column, unit = column_key(time), time.text("unit", "s")
    try:
        scale = factor(unit, "s")
    except UserError as error:
        time.fail("unit", error)
    repeats = time.text("repeats")
    if repeats not in ("", "drop"):
        time.fail("repeats", f"'{repeats}' is unknown; write repeats = \"drop\" or leave it out")
    stamps = columns.numbers(column)
    if not len(stamps):
        raise UserError(f"{columns.where(column)} has no rows: name another column")
    columns.check_order(column, scale * stamps)
    again = np.diff(stamps, prepend=-np.inf) == 0.0
    if again.any() and not (held or repeats):
        row = int(np.argmax(again))
        raise UserError(
            f"{columns.where(column, row)}: time {scale * stamps[row]:.9g} s repeats; remove the"
            ' row or set time.repeats = "drop"'
        )
    rows = np.arange(len(stamps)) if held else np.flatnonzero(~again)
    return Clock(columns, column, unit, stamps[rows], rows, float(stamps[0]))


def check_duration(clock: Clock, internal_step: float) -> None:
    """Refuse times that no run of the actuator has, before anything is simulated.

    Args:
        clock: the rows of the log.
        internal_step: of the model [s].

    Raises:
        UserError: the steps of the times are shorter than those of any clock; one is longer than
            a thousand logs; or they hold so many internal ones that a simulation would hardly end.
            It names the row, or the unit that makes sense.
    """
    since = clock.since
    steps = np.diff(since)
    usual = float(np.median(steps)) if len(steps) else 0.0
    lasts = float(since[-1] - since[0]) if len(since) else 0.0
    if not usual:
        return
    where = clock.columns.where
    if usual < SHORTEST:
        raise UserError(
            f"{where(clock.column)} in {clock.unit}: rows are {usual:.3g} s apart, which no clock"
            " tells apart; correct the unit or the column"
        )
    if lasts > MOST_EMPTY * len(since) * usual:
        row = int(np.argmax(steps)) + 1
        raise UserError(
            f"{where(clock.column, int(clock.rows[row]))}: time jumps by {steps[row - 1]:.3g} s,"
            f" where rows are {usual:.3g} s apart; correct the row, remove it, or leave it out by a"
            " window"
        )
    if max(usual / MOST_PER_ROW, lasts / LONGEST_RUN) > internal_step:
        ratios = {unit: factor(unit, clock.unit) for unit in SHORTER}
        cures = [
            f'in {unit} it lasts {ratio * lasts:.3g} s: write unit = "{unit}"'
            for unit, ratio in ratios.items()
            if ratio * usual <= SENSIBLE_PER_ROW * internal_step
        ]
        cure = cures[0] if cures else "correct the unit, or set a longer internal_step"
        raise UserError(
            f"{where(clock.column)} in {clock.unit}: rows are {usual:.3g} s apart and the log lasts"
            f" {lasts:.3g} s, which is {lasts / internal_step:.2g} internal steps of the model, too"
            f" many to simulate; {cure}"
        )


def _section(entry: Section) -> Section:
    """The description of the time; a column in seconds may be given by its name alone."""
    given = entry.content.get("time")
    if isinstance(given, (str, int)) and not isinstance(given, bool):
        return Section(entry.file, f"{entry.name}.time", {"column": given})
    time = entry.section("time")
    if not time.content:
        entry.fail("time", 'missing; write time = { column = "...", unit = "s" }')
    time.check_keys(KEYS)
    return time


def column_key(section: Section) -> str | int:
    """Return the name or number of the column that a table of a description names."""
    found: Any = section.content.get("column")
    if isinstance(found, bool) or not isinstance(found, (str, int)):
        section.fail("column", "missing; give the column's name, or its number from 1")
    return found


def cut_window(entry: Section, clock: Clock) -> Clock:
    """Return the rows inside the log's window, ends included; all where it has none."""
    if "window" not in entry:
        return clock
    ends = entry.content["window"]
    if not (isinstance(ends, list) and len(ends) == 2):
        entry.fail("window", 'no pair of times; write window = ["8 s", "20 s"]')
    pair = Section(entry.file, f"{entry.name}.window", {"from": ends[0], "to": ends[1]})
    inside = span(pair, clock.since)
    if not inside.any():
        entry.fail("window", f"no row inside; the file lasts {clock.since[-1]:g} s")
    kept = np.flatnonzero(inside)
    return clock.cut(int(kept[0]), int(kept[-1]) + 1)


def span(section: Section, since: Array) -> Mask:
    """Mark times [s] between ``from`` and ``to``, ends included; either may be left out."""
    ends = [quantity(section, key, "s") if key in section else None for key in ("from", "to")]
    begin, end = -np.inf if ends[0] is None else ends[0], np.inf if ends[1] is None else ends[1]
    if begin >= end:
        section.fail("to", f"{end:g} s is not after {begin:g} s; correct one of the two")
    marked: Mask = (since >= begin) & (since <= end)
    return marked
