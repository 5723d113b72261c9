"""What a reader of measured files gives: columns whose numbers are checked when asked for."""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Mask
from servo_models.data.readers.dates import DAY, EXAMPLE, is_time, seconds
from servo_models.errors import UserError, did_you_mean
from servo_models.files import check_size

if TYPE_CHECKING:
    import polars as pl

NUMBER = 8  # bytes of a number
LEAST_RUN = 8  # fewest rows of a run of its own; fewer are rows out of order
SHORTEST_STEP = 1e-18  # step [s] far below that of any clock or solver


@dataclass(frozen=True)
class Source:
    """A file to read, and what of it.

    Attributes:
        path, content: the file and its bytes.
        table: name of the one table wanted, None for all.
        header: whether the first row of a text file names the columns, None to find out.
    """

    path: Path
    content: bytes
    table: str | None = None
    header: bool | None = None

    @property
    def place(self) -> str:
        """File and table, for messages."""
        return _place(self.path, self.table or "")

    def wanted(self, tables: Iterable[str]) -> list[str]:
        """Return which of the file's tables to read."""
        names = list(tables)
        if self.table is None:
            return names
        if self.table not in names:
            cure = did_you_mean(self.table, names) if any(names) else "name none"
            raise UserError(f"'{self.path}' has no table '{self.table}'; {cure}")
        return [self.table]

    def damaged(self, kind: str, told: str = "damaged or no {} file: write it again") -> UserError:
        return UserError(f"'{self.path}' is {told.format(kind)}")

    @contextlib.contextmanager
    def read_by_library(self, *damaged: str) -> Iterator[None]:
        """Tell whatever a library raises, of many kinds, as ``damaged``; it prints nothing."""
        try:
            with (
                contextlib.redirect_stdout(io.StringIO()) as sink,
                contextlib.redirect_stderr(sink),
            ):
                yield
        except UserError:
            raise
        except Exception as error:
            raise self.damaged(*damaged) from error


@dataclass(frozen=True)
class Tables:
    """Columns by table, ``""`` for the only one of a file that knows no tables.

    Attributes:
        cells: the columns of each table, named, as they stand in the file.
        first_row: number by which the author calls the first row of cells.
        aliases: names of columns by what they are called as well.
    """

    cells: Mapping[str, Sequence[pl.Series]]
    first_row: int = 1
    aliases: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, parts: Mapping[str, tuple[Sequence[pl.Series], Mapping[str, str]]]) -> Tables:
        """Return tables from their columns and aliases, which an only one has."""
        cells = {name: columns for name, (columns, _) in parts.items()}
        only = [aliases for _, aliases in parts.values()] if len(parts) == 1 else [{}]
        return cls(cells, aliases=only[0])


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of one table; a column that nobody asks for may hold anything.

    One that is asked for and is not there, or is there twice, is a UserError.

    Attributes:
        path: the file, and ``sha256`` of its bytes.
        cells: the columns, named, as they stand in the file.
        first_row: number by which the author calls the first row of cells.
        table: name of the table, where the file has several.
        aliases: names of columns by what they are called as well.
    """

    path: Path
    cells: tuple[pl.Series, ...]
    first_row: int = 1
    table: str = ""
    sha256: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns; their numbers where the file names none."""
        return tuple(column.name for column in self.cells)

    def index(self, column: str | int) -> int:
        """Return the place of a column, counted from 0, by its name or its number from 1.

        Raises:
            UserError: no such column, or two of that name.
        """
        place = _place(self.path, self.table)
        if isinstance(column, int):
            if not 1 <= column <= len(self.cells):
                raise UserError(
                    f"{place} has no column {column}: give a number from 1 to {len(self.cells)}"
                )
            return column - 1
        places = [i for i, name in enumerate(self.names) if name == column]
        if not places:  # items of lists are written with brackets or dots
            also = [
                name for alias, name in self.aliases.items() if _dotted(alias) == _dotted(column)
            ]
            meant = {_dotted(column), *also}
            places = [i for i, name in enumerate(self.names) if {_dotted(name), name} & meant]
        if not places:
            raise UserError(f"{place} has no column '{column}'; {did_you_mean(column, self.names)}")
        if len(places) > 1:
            raise UserError(f"{place} has two columns '{column}': give the number of one")
        return places[0]

    def has(self, column: str | int) -> bool:
        """Whether there is such a column."""
        try:
            return self.index(column) >= 0
        except UserError:
            return False

    def where(self, column: str | int, row: int | None = None) -> str:
        """File, table, row (counted from 0 here) and column in words."""
        row_ = "" if row is None else f", row {row + self.first_row}"
        name = self.names[self.index(column)]
        return f"{_place(self.path, self.table)}{row_}, column '{name}'"

    def numbers(self, column: str | int, keep: slice = slice(None), times: bool = False) -> Array:
        """Return a column by name or number as finite floats, of the rows ``keep``, shape (n,).

        A cell that is none gets the advice for a column of ``times`` or of another quantity.

        Raises:
            UserError: no such column; a cell that is empty, no number or not finite.
        """
        import polars as pl

        index = self.index(column)
        first = keep.indices(len(self.cells[index]))[0]
        cells = self.cells[index][keep]
        if not (cells.dtype.is_numeric() or cells.dtype in (pl.String, pl.Boolean)):
            raise UserError(f"{self.where(column)} holds {cells.dtype}: give numbers")
        if cells.dtype == pl.String:
            cells = cells.str.strip_chars(' \t"')
            cells = cells.set(cells == "", None)
        values = cells.cast(pl.Float64, strict=False)
        bad = ~values.is_finite().fill_null(value=False)
        if bad.any():
            row = int(bad.arg_max() or 0)
            place = self.where(column, row + first)
            if cells[row] is None:
                raise UserError(f"{place} is empty: fill the gap or remove the row")
            if values[row] is None:
                cure = self._cure(str(cells[row]), row + first, numbers=row, times=times)
                raise UserError(f"{place}: '{cells[row]}' is not a number; {cure}")
            raise UserError(
                f"{place}: '{cells[row]}' is not finite: give a number or remove the row"
            )
        return values.to_numpy().astype(np.float64)

    def _cure(self, cell: str, row: int, numbers: int, times: bool) -> str:
        """What to do about a cell that is no number, after so many ``numbers``."""
        if row == 0 and self._begins_with_words():
            return "the row looks like units: remove it, and give 'unit' in the description"
        if times and is_time(cell):
            mixed = "the rows before are numbers: write all as dates or all as numbers"
            return mixed if numbers else f"write dates as {EXAMPLE}"
        return "correct it or remove the row"

    def _begins_with_words(self) -> bool:
        """Whether the first row has no number, and the second one has."""
        import polars as pl

        texts = [cells.head(2) for cells in self.cells if cells.dtype == pl.String]
        numbers = [text.str.strip_chars().cast(pl.Float64, strict=False) for text in texts]
        words = all(number.head(1).is_null().all() for number in numbers)
        return words and len(texts) == len(self.cells) and any(map(pl.Series.count, numbers))

    def dates(self, column: str | int, keep: slice = slice(None)) -> Array | None:
        """Return dates and times of a column in the rows ``keep`` as seconds, shape (n,).

        None for a column that holds none; see ``dates.seconds``.
        """
        cells = self.cells[self.index(column)]
        first = keep.indices(len(cells))[0]
        return seconds(cells[keep], lambda row: self.where(column, first + row))

    def time_text(self, column: str | int, row: int, time: float) -> str:
        """Return a time [s] of a row for people: as it stands there if it is no number."""
        if self.dates(column, slice(row, row + 1)) is None:
            return f"{time:.9g} s"
        return f"'{self.cells[self.index(column)][row]}'"

    def begin(self, column: str | int, first: int = 0) -> int:
        """Return the row, from ``first`` on, in which a column has its first value.

        It is ``first`` for a column that never has a value.
        """
        has_value = ~self.empty(column)[first:]
        return first + int(np.argmax(has_value)) if has_value.size else first

    def empty(self, column: str | int) -> Mask:
        """Mark the rows in which a column has no value, or NaN, shape (n,)."""
        import polars as pl

        cells = self.cells[self.index(column)]
        if cells.dtype == pl.String:
            has_value = ~cells.str.strip_chars(' \t"').str.to_lowercase().is_in(["", "nan"])
        elif cells.dtype.is_float():
            has_value = cells.is_not_nan()
        else:
            has_value = cells.is_not_null()
        return np.asarray(~has_value.fill_null(value=False).to_numpy())

    def held(self, column: str | int) -> Columns:
        """Return the same with the value of the row before in every empty cell of a column."""
        import polars as pl

        place = self.index(column)
        cells = self.cells[place].set(pl.Series(self.empty(column)), None).forward_fill()
        return replace(self, cells=(*self.cells[:place], cells, *self.cells[place + 1 :]))

    def check_order(self, column: str | int, times: Array, first: int = 0) -> None:
        """Raise UserError where ``times`` [s], the ones of that column from row ``first`` on, run
        backward: a row out of order, a clock that starts again, or midnight."""
        backward = np.flatnonzero(times[1:] < times[:-1]) + 1
        if not len(backward):
            return
        row = int(backward[0])
        before, after = (self.time_text(column, first + k, times[k]) for k in (row - 1, row))
        end = backward[1] if len(backward) > 1 else len(times)
        cure, undated = "sort the rows by time", before.startswith("'") and times[row - 1] < DAY
        if undated and times[row - 1] - times[row] > 0.5 * DAY:
            cure = f"past midnight a time needs its date, such as '{EXAMPLE[:11]}{after[1:]}"
        elif _are_two_runs(times[:row], times[row:end]):
            cure = (
                "the clock starts again, so from this row on it is another run: put it in a file of"
                " its own"
            )
        place = self.where(column, first + row)
        raise UserError(f"{place}: time runs backward from {before} to {after}; {cure}")

    def check_steps(self, column: str | int, times: Array, rows: NDArray[np.int64]) -> None:
        """Raise UserError where ``times`` [s], the ones of that column in these ``rows``, rise by
        so little, or by so much, that no rate or duration is a finite number."""
        with np.errstate(over="ignore"):
            steps = np.diff(times)
        odd = np.flatnonzero((steps > 0.0) & (steps < SHORTEST_STEP) | np.isinf(steps)) + 1
        if len(odd):
            row = int(odd[0])
            raise UserError(
                f"{self.where(column, int(rows[row]))}: time moves from {times[row - 1]!s} s to"
                f" {times[row]!s} s, as no clock does; correct one of the two rows or its unit"
            )


def _are_two_runs(first: Array, second: Array) -> bool:
    """Whether sorting by time [s] would mix the rows, or put the second ones long before."""
    if min(len(first), len(second)) < LEAST_RUN:
        return False
    order = np.argsort(np.concatenate([first, second]), kind="stable")
    turns = np.count_nonzero(np.diff(order < len(first)))
    ahead = float(first[0] - second[-1])
    return bool(turns > LEAST_RUN or ahead > LEAST_RUN * np.median(np.diff(first)))


def column_of(name: str, values: Sequence[Any]) -> pl.Series:
    """Return Python values as a column: of floats if all are numbers or missing, else of text."""
    import polars as pl

    if all(value is None or isinstance(value, (int, float)) for value in values):
        floats = [None if value is None else float(value) for value in values]
        return pl.Series(unicode_of(name), floats, dtype=pl.Float64)
    texts = [None if value is None else unicode_of(str(value)) for value in values]
    return pl.Series(unicode_of(name), texts, dtype=pl.String)


def unicode_of(text: str) -> str:
    """Return the text with ``?`` for what JSON can spell and Unicode does not have: half a pair."""
    return text.encode("utf-8", "replace").decode("utf-8")


def columns_of(source: Source, records: Iterable[Any], name: str = "") -> list[pl.Series]:
    """Return the columns of a list of records, such as JSON objects; None is an empty one.

    Inner objects are named by dots and items of lists by their index from 0, ``pose.q[3]``, behind
    the ``name`` of all.

    Raises:
        UserError: records have so many names that a table of all of them would be too large.
    """
    rows = [{} if record is None else dict(_leaves(name, record)) for record in records]
    names = dict.fromkeys(name for row in rows for name in row)
    check_size(source.path, float(len(rows)) * len(names) * NUMBER)
    return [column_of(name, [row.get(name) for row in rows]) for name in names]


def _leaves(name: str, value: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _leaves(f"{name}.{key}" if name else str(key), inner)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _leaves(f"{name}[{i}]", inner)
    else:
        yield name, value


def _dotted(name: str) -> str:
    return re.sub(r"\[(\d+)\]", r".\1", name)


def array_column(name: str, values: NDArray[Any]) -> pl.Series:
    """Return an array of shape (n,) as a column, whatever the byte order of its file."""
    import polars as pl

    return pl.Series(name, np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("=")))


def _place(path: Path, table: str) -> str:
    return f"'{path}', table '{table}'" if table else f"'{path}'"


@contextlib.contextmanager
def no_stack() -> Iterator[None]:
    """Keep from standard error what polars prints there, past Python, before it raises."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    try:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 2)
        os.close(silent)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
