"""Data sheets: titled texts and tables, for a terminal or as plain text."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from servo_models.errors import printable

if TYPE_CHECKING:
    from rich.console import Group

WIDE = 160
"""Columns of a sheet as plain text."""
LONGEST_CELL = 400
"""Characters of a cell, which may be a name out of anybody's file."""
LONGEST_TEXT = 4000  # the same of a paragraph
MOST = 10
"""Digits that a value is worth, however small its error."""


@dataclass(frozen=True)
class Table:
    """Rows under a heading; every row has a cell for every column."""

    heading: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Sheet:
    """A data sheet: ``str(sheet)`` is plain text, and rich prints it for a terminal.

    Attributes:
        title: first line.
        texts: paragraphs.
        tables: tables below them.
    """

    title: str
    texts: tuple[str, ...]
    tables: tuple[Table, ...]

    def __rich__(self) -> Group:
        from rich.console import Group
        from rich.table import Table as RichTable
        from rich.text import Text

        parts: list[Text | RichTable] = [Text(_paragraph(self.title), style="bold")]
        parts += [Text(f"\n{_paragraph(text)}") for text in self.texts]
        for table in self.tables:
            parts.append(Text(f"\n{_paragraph(table.heading)}", style="bold"))
            grid = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
            for i, column in enumerate(table.columns):
                grid.add_column(Text(column), style="cyan" if i == 0 else "", overflow="fold")
            for row in table.rows:
                grid.add_row(*(Text(printable(cell, LONGEST_CELL)) for cell in row))
            parts.append(grid)
        return Group(*parts)

    def __str__(self) -> str:
        return self.plain(WIDE)

    def plain(self, width: int) -> str:
        """Return plain text in lines of at most ``width`` characters."""
        from rich.console import Console

        console = Console(width=width, color_system=None, force_terminal=False)
        with console.capture() as capture:
            console.print(self)
        return "\n".join(line.rstrip() for line in capture.get().splitlines())


def _paragraph(text: str) -> str:
    """A text with its own line breaks."""
    return "\n".join(printable(line, LONGEST_TEXT) for line in text.split("\n"))


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """Return a value and its standard error as they are worth printing, in one unit.

    The error has two digits and the value goes to the same decimal place, with 2 to
    ``MOST`` digits.  Of an infinite error the text is empty, and the value has the two digits that
    say where it stands; without an error, None or NaN, it has six.
    Source: Review of Particle Physics, Introduction, sec. 5.3 (rounding), with two digits.
    """
    if error is None or math.isnan(error):
        return f"{value:.6g}", ""
    if math.isinf(error):
        if value == 0.0 or not 1e-5 <= abs(value) < 1e9:
            return f"{value:.2g}", ""
        return _fixed(value, _magnitude(value) - 1), ""
    if error == 0.0:
        return f"{value:.6g}", "0"
    place = _magnitude(error) - 1
    digits = min(max(_magnitude(value) - place + 1, 2), MOST) if value else 1
    if 1e-5 <= error < 1e6 and (1e-5 <= abs(value) < 1e9 or value == 0.0):
        last = _magnitude(value) + 1 - digits if value else place
        return _fixed(value, last), _fixed(error, place)
    return f"{value:.{digits - 1}e}", f"{error:.1e}"


def _magnitude(value: float) -> int:
    """Power of ten of the first digit, when rounded to two digits."""
    return int(f"{value:.1e}".partition("e")[2])


def _fixed(value: float, place: int) -> str:
    """A number without exponent, rounded to the power of ten ``place``."""
    return f"{round(value, -place) + 0.0:.{max(-place, 0)}f}"
