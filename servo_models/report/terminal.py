"""Reports for a terminal, and as plain text, in ASCII except for names of users."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from servo_models.errors import printable
from servo_models.report.numbers import plain
from servo_models.report.sections import Mark, Page, Section, Table

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.table import Table as Grid
    from rich.text import Text


WIDE = 160  # columns of plain text
LONGEST_CELL = 400  # characters of a cell at most; it may be a name from a foreign file
LONGEST_TEXT = 4000  # characters of a paragraph at most
STYLES = {True: "green", False: "bold red", None: ""}


def group(report: Page) -> Group:
    """Return a report as rich prints it."""
    from rich.console import Group

    return Group(*_parts(report))


def text(report: Page, width: int = WIDE) -> str:
    """Return a report as plain text in lines of at most ``width`` characters."""
    from rich.console import Console

    console = Console(width=width, color_system=None, force_terminal=False)
    with console.capture() as capture:
        console.print(group(report))
    return "\n".join(line.rstrip() for line in capture.get().splitlines())


def _parts(report: Page) -> Iterator[RenderableType]:
    yield _paragraph(report.title, "bold")
    if report.sentence:
        yield _paragraph(f"\n{report.sentence}", STYLES[report.passed])
    if report.cards:
        yield _paragraph("")
        yield _pairs((card.title, card.text) for card in report.cards)
    for remark in report.remarks:
        yield _paragraph(f"\n{remark}")
    for section in report.filled:
        yield from _section(section)


def _section(section: Section) -> Iterator[RenderableType]:
    tables = [table for table in section.tables if table.rows and not table.folded]
    if section.title and (section.items or not all(table.title for table in tables)):
        yield _paragraph(f"\n{section.title}", "bold")
    for item in section.items:
        yield _paragraph(f"- {item}")
    for table in tables:
        if table.title:
            yield _paragraph(f"\n{table.title}", "bold")
        yield _grid(table)


def _grid(table: Table) -> Grid:
    grid = _new_grid(header=True)
    for k, heading in enumerate(table.headings):
        right = "right" if table.numeric(k) else "left"
        style = "cyan" if k == 0 else ""
        grid.add_column(_cell(heading), style=style, overflow="fold", justify=right)  # type: ignore[arg-type]
    for row, texts in zip(table.rows, table.texts):
        marks = (STYLES[cell.passed] if isinstance(cell, Mark) else "" for cell in row)
        grid.add_row(*(_cell(each, style) for each, style in zip(texts, marks)))
    return grid


def _pairs(pairs: Iterable[tuple[str, str]]) -> Grid:
    grid = _new_grid(header=False)
    grid.add_column(style="cyan", no_wrap=True)
    grid.add_column(overflow="fold")
    for name, said in pairs:
        grid.add_row(_cell(name), _paragraph(said))
    return grid


def _new_grid(header: bool) -> Grid:
    from rich.table import Table as Grid

    return Grid(
        box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim", show_header=header
    )


def _cell(said: str, style: str = "") -> Text:
    from rich.text import Text

    return Text(printable(plain(said), LONGEST_CELL), style=style)


def _paragraph(said: str, style: str = "") -> Text:
    """A text with its own line breaks."""
    from rich.text import Text

    lines = (printable(plain(line), LONGEST_TEXT) for line in said.split("\n"))
    return Text("\n".join(lines), style=style)
