"""Data sheets: titled texts and tables, for a terminal or as plain text."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Group

WIDE = 160
"""Columns of a sheet as plain text."""


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

        parts: list[Text | RichTable] = [Text(self.title, style="bold")]
        parts += [Text(f"\n{text}") for text in self.texts]
        for table in self.tables:
            parts.append(Text(f"\n{table.heading}", style="bold"))
            grid = RichTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
            for i, column in enumerate(table.columns):
                grid.add_column(Text(column), style="cyan" if i == 0 else "", overflow="fold")
            for row in table.rows:
                grid.add_row(*map(Text, row))
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
