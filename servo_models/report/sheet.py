"""A data sheet as a section, and as a page of its own with figures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from servo_models.report import sections
from servo_models.report.page import Page, render
from servo_models.report.parts import Line, Section, Table
from servo_models.report.style import picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NUMBER = re.compile(r"[-+\N{MINUS SIGN}]?[\d.]+(e[-+]?\d+)?( .{0,9})?")
"""What counts as a number in a cell; a unit may follow."""


def sheet_page(
    title: str, sheet: sections.Report, figures: Mapping[str, Figure], date: str = ""
) -> str:
    """Return a data sheet with figures as one HTML page that needs nothing else.

    Args:
        title: of the window, and above the sheet's own title.
        sheet: texts and tables.
        figures: by caption; drawn by ``style.drawing`` they follow the reader's colours.
        date: shown with the title; the same arguments give the same bytes.
    """
    pictures = tuple(
        picture(figure, f"figure-{i}", caption)
        for i, (caption, figure) in enumerate(figures.items())
    )
    tables = tuple(_table(table) for table in sheet.tables)
    shown = (
        Section("figures", "Figures", pictures=pictures) if pictures else None,
        Section("tables", "Tables", tables=tables) if tables else None,
    )
    return render(Page(title, title, sheet.title, None, shown, sheet.remarks, date=date))


def _table(table: sections.Table) -> Table:
    columns = zip(table.columns, zip(*table.texts))
    numbers = tuple(
        name for name, cells in columns if any(cells) and all(map(_is_number, filter(None, cells)))
    )
    return Table(table.title, table.columns, tuple(map(Line, table.texts)), numbers)


def _is_number(cell: str) -> bool:
    return NUMBER.fullmatch(cell) is not None
