"""The content of a report before it is rendered: one model for terminal and page.

A domain gives a ``Page``; ``terminal`` and ``html`` render it.  Texts are plain, without
markup; numbers are ``Quantity``, so that a table can be printed and computed with.

    Report(
        "Torque motor, variant default", "Backlash explains the gap", None,
        cards=(Card("left", "0.12 deg RMS"),),
        sections=(Section("Errors", tables=(Table("", ("output", "after"), rows),)),),
    )
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from servo_models.report.live import Live
from servo_models.report.numbers import Quantity, number

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Mark:
    """A cell that judges: words, and True for passed, False for failed, None for neither.

    On a page it is a ``link`` where that is given.
    """

    text: str
    passed: bool | None = None
    link: str = ""


Cell = str | int | float | None | Quantity | Mark
"""Text, a pure number, a number with unit and error, a judgement; None for nothing to say."""


@dataclass(frozen=True)
class Table:
    """Rows under headings; every row has a cell for every column.

    Attributes:
        title: what it lists, "" where the heading of the section says it.
        columns: headings.  A unit that all numbers of a column share joins its heading.
        rows: of cells.
        folded: a detail: on the page behind a click, not on a terminal.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    folded: bool = False

    def column(self, k: int) -> list[Cell]:
        """Return the cells of one column."""
        return [row[k] for row in self.rows]

    def numeric(self, k: int) -> bool:
        """Whether a column holds numbers alone."""
        cells = [cell for cell in self.column(k) if cell is not None and cell != ""]
        return bool(cells) and all(isinstance(cell, int | float | Quantity) for cell in cells)

    @property
    def headings(self) -> tuple[str, ...]:
        """Columns with the units that their cells share."""
        units = (self._shared_unit(k) for k in range(len(self.columns)))
        return tuple(
            f"{name} [{unit}]".lstrip() if unit else name for name, unit in zip(self.columns, units)
        )

    @property
    def texts(self) -> list[tuple[str, ...]]:
        """Every row as it is printed under ``headings``."""
        shared = [self._shared_unit(k) for k in range(len(self.columns))]
        return [
            tuple(_text(cell, bool(unit)) for cell, unit in zip(row, shared)) for row in self.rows
        ]

    def frame(self) -> pl.DataFrame:
        """Return the table as a polars DataFrame, numbers as floats.

        A column of quantities has its shared unit in its name, or else a column of units beside
        it; standard errors and limits of intervals are columns of their own.
        """
        import polars as pl

        data: dict[str, Sequence[object]] = {}
        for k, heading in enumerate(self.headings):
            name = heading or f"column {k + 1}"
            if not self.numeric(k):
                data[name] = [_text(cell, False) for cell in self.column(k)]
                continue
            cells = [
                cell if isinstance(cell, Quantity) else Quantity(_float(cell))
                for cell in self.column(k)
            ]
            data[name] = [cell.value for cell in cells]
            if any(cell.error is not None for cell in cells):
                data[f"{name} standard error"] = [cell.error for cell in cells]
            if any(cell.interval for cell in cells):
                limits = [cell.interval or (math.nan, math.nan) for cell in cells]
                data[f"{name} low"], data[f"{name} high"] = map(list, zip(*limits))
            if not self._shared_unit(k) and any(cell.unit != "1" for cell in cells):
                data[f"{name} unit"] = [cell.unit for cell in cells]
        return pl.DataFrame(data, strict=False)

    def _shared_unit(self, k: int) -> str:
        """The unit of all numbers of a column, "" for none or several."""
        if not self.numeric(k):
            return ""
        units = {
            cell.unit if isinstance(cell, Quantity) else "1"
            for cell in self.column(k)
            if cell is not None and cell != ""
        }
        return "" if len(units) > 1 or units <= {"1", ""} else units.pop()


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn when somebody looks at it.

    Attributes:
        title: what it shows.
        draw: draws on styled axes, one above the other.
        text: what a reader should see in it.
        rows: number of those axes.
        height, width: of the figure [inch]; 0 is the width of a column.
        shared: the axes have one abscissa.
    """

    title: str
    draw: Callable[[Sequence[Axes]], None]
    text: str = ""
    rows: int = 1
    height: float = 2.7
    width: float = 0.0
    shared: bool = False


@dataclass(frozen=True)
class Card:
    """A part of the answer: what a reader looks for first, in a line or a few.

    Attributes:
        title: two or three words.
        text: in words and figures; lines are kept.
        passed: the judgement; None where nothing is judged.
        section: title of the section that tells more, "" for none.
    """

    title: str
    text: str
    passed: bool | None = None
    section: str = ""

    @property
    def anchor(self) -> str:
        return anchor(self.section)


@dataclass(frozen=True)
class Section:
    """A part of a report; one without content is left out.

    Attributes:
        title: heading, and by ``anchor`` its place on the page.
        lead: how to read what follows, in a sentence or two.
        items: sentences, as a list.
        facts: pairs of a name and what is said about it, such as versions; no terminal has them.
        tables, pictures: in their order; no terminal has pictures.
        folded: on the page behind a click on its title.
        live: a panel that takes the place of the pictures on a screen; they are printed.
    """

    title: str
    lead: str = ""
    items: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    folded: bool = False
    live: Live | None = None

    @property
    def anchor(self) -> str:
        return anchor(self.title)

    @property
    def filled(self) -> bool:
        """Whether there is anything below the lead."""
        told = self.items or self.facts or self.pictures or self.live
        return bool(told or any(table.rows for table in self.tables))


@dataclass(frozen=True, repr=False)
class Page:
    """A result as people read it, the answer first, before anybody renders it.

    Attributes:
        title: what was examined.
        sentence: the verdict in one short line.
        passed: the judgement; None where nothing is judged.
        cards: the answer: causes, what was, what is left, what to do next.
        remarks: paragraphs that a reader should know before using the values.
        sections: what the answer rests on.
        date: "" for none; the same report gives the same bytes.
    """

    title: str
    sentence: str
    passed: bool | None = None
    cards: tuple[Card, ...] = ()
    remarks: tuple[str, ...] = ()
    sections: tuple[Section, ...] = ()
    date: str = ""

    @property
    def filled(self) -> tuple[Section, ...]:
        """Sections with something in them."""
        return tuple(section for section in self.sections if section.filled)

    @property
    def tables(self) -> tuple[Table, ...]:
        """Tables of all sections that have rows."""
        return tuple(t for section in self.sections for t in section.tables if t.rows)

    @property
    def titled_tables(self) -> dict[str, Table]:
        """The same by their titles, or those of their sections; both where a title repeats."""
        every = [
            (s.title, t.title or s.title, t) for s in self.sections for t in s.tables if t.rows
        ]
        often = Counter(title for _, title, _ in every)
        titled: dict[str, Table] = {}
        for section, title, table in every:
            key = title if often[title] == 1 else f"{section}: {title}"
            copies = sum(known == key or known.startswith(f"{key} (") for known in titled)
            titled[f"{key} ({copies + 1})" if copies else key] = table
        return titled

    @property
    def panels(self) -> tuple[Live, ...]:
        """Panels of all sections."""
        return tuple(section.live for section in self.sections if section.live)

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """Pictures of all sections."""
        return tuple(picture for section in self.sections for picture in section.pictures)


def anchor(title: str) -> str:
    """Return the id on the page of a section of this title."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def _text(cell: Cell, without_unit: bool) -> str:
    match cell:
        case None:
            return ""
        case str():
            return cell
        case Mark():
            return cell.text
        case Quantity():
            return cell.bare if without_unit else str(cell)
        case int():
            return str(cell)
    return number(cell)


def _float(cell: Cell) -> float:
    return float(cell) if isinstance(cell, int | float) else math.nan
