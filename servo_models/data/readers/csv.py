"""CSV and its relatives: separated by commas, semicolons or tabs, decimals as the country has it.

Lines that start with ``#`` before the header are passed over.  Where columns are not
separated by commas, a number may have a decimal comma.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from servo_models.data.readers.columns import Source, Tables
from servo_models.errors import UserError

if TYPE_CHECKING:
    import polars as pl

SUFFIXES = (".csv", ".tsv", ".txt")
SEPARATORS = "\t;,"  # separators in the order of the search: a comma may be a decimal one
LOOKED_AT = 100  # rows in which a first number of each column is looked for
DECIMAL_COMMA = r"^(\s*[-+]?\d*),(\d*(?:[eE][-+]?\d+)?\s*)$"


def read(source: Source) -> Tables:
    """Read a text file; a file without a header has columns ``"1"``, ``"2"`` and so on."""
    source.wanted([""])
    lines = _lines(source)
    begins = (line.strip()[:1] for line in lines)  # neither blank nor a comment
    start = next((i for i, begin in enumerate(begins) if begin not in ("", "#")), len(lines))
    if start == len(lines):
        raise UserError(f"'{source.path}' is empty: it needs a header and rows of numbers")
    separator = _separator(lines[start : start + 2])
    names = _split(lines[start], separator)
    header = source.header
    if header is None:
        header = _is_header(names, _first_cells(lines[start + 1 : start + LOOKED_AT], separator))
    if header:
        start += 1
    else:
        names = _commented(lines[:start], separator, len(names))
    rows = [_plain(line, separator) for line in lines[start:]]
    for row, line in enumerate(rows, start=start + 1):
        if not line.strip():
            raise UserError(f"'{source.path}', row {row} is empty: remove it")
        if line.count(separator) != len(names) - 1:
            raise UserError(
                f"'{source.path}', row {row} has {line.count(separator) + 1} cells, the"
                f" {'header' if header else 'first row'} {len(names)}: give every row as many;"
                f" decimals take a point{'' if separator == ',' else ' or comma'}"
            )
    return Tables({"": _cells(rows, separator, names)}, start + 1)


def _lines(source: Source) -> list[str]:
    content = source.content
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise UserError(
            f"'{source.path}', row {row}: byte 0x{content[error.start]:02x} is not UTF-8;"
            " save the file as CSV UTF-8"
        ) from error
    return text.rstrip("\r\n ").replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _separator(lines: Sequence[str]) -> str:
    """The first separator that stands as often in the first row as in the second."""
    bare = [re.sub(r'"[^"]*"', "", line) for line in lines]
    for separator in SEPARATORS:
        counts = {line.count(separator) for line in bare}
        if len(counts) == 1 and counts != {0}:
            return separator
    return max(reversed(SEPARATORS), key=bare[0].count)


def _split(line: str, separator: str) -> list[str]:
    """The cells of a line without quotes and outer blanks, such as ``a[1,2]``."""
    if '"' in line:
        with suppress(csv.Error):  # a cell beyond the limit of the reader: its quote does not end
            (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
            return [cell.strip() for cell in cells]
    return [cell.strip() for cell in line.replace('"', "").split(separator)]


def _plain(line: str, separator: str) -> str:
    """The line without quotes; a separator inside quotes becomes a blank."""
    if '"' not in line:
        return line
    return separator.join(cell.replace(separator, " ") for cell in _split(line, separator))


def _is_header(first: Sequence[str], cells: Sequence[str]) -> bool:
    """Whether the first row names the columns: it has words where numbers follow."""
    numeric = [_is_number(cell) for cell in first]
    words = [bool(cell) and not number for cell, number in zip(first, numeric)]
    return not any(numeric) or any(word and _is_number(cell) for word, cell in zip(words, cells))


def _first_cells(lines: Sequence[str], separator: str) -> list[str]:
    """The first cell of each column that is not empty."""
    rows = [_split(line, separator) for line in lines]
    columns = itertools.zip_longest(*rows, fillvalue="")
    return [next(filter(None, column), "") for column in columns]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _commented(comments: Sequence[str], separator: str, count: int) -> list[str]:
    """Names of the columns of a file without header: in its last comment, or numbers."""
    last = comments[-1].lstrip("# ") if comments else ""
    names = _split(last, separator)
    return names if last and len(names) == count else [str(i + 1) for i in range(count)]


def _cells(rows: Sequence[str], separator: str, names: Sequence[str]) -> list[pl.Series]:
    """Cells as text, one column for each name."""
    import polars as pl

    if not rows:
        return [pl.Series(name, [], dtype=pl.String) for name in names]
    text = "\n".join(rows)
    frame = pl.read_csv(
        io.BytesIO(text.encode()),
        has_header=False,
        separator=separator,
        infer_schema=False,
        quote_char=None,
    )
    if separator != "," and "," in text:
        frame = frame.with_columns(pl.all().str.replace(DECIMAL_COMMA, "$1.$2"))
    return [column.alias(name) for column, name in zip(frame.get_columns(), names)]
