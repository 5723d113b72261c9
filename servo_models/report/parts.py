"""What a section is made of; the page's template knows these parts and no others."""

from __future__ import annotations

from dataclasses import dataclass

from servo_models.report.numbers import MINUS, NONE, TIMES, number, printed
from servo_models.report.style import Picture

__all__ = ["MINUS", "NONE", "TIMES", "number", "printed"]

MARKS = {True: "✓", False: "✗", None: "○"}
"""A sign beside each verdict, so that it does not hang on colour."""


@dataclass(frozen=True)
class Line:
    """A line of a table.

    Attributes:
        cells: one text per column after the verdict.
        verdict: the judgement in words, "" in a table without verdicts.
        passed: the judgement; None where nothing is judged.
    """

    cells: tuple[str, ...]
    verdict: str = ""
    passed: bool | None = None

    @property
    def mark(self) -> str:
        """The sign of the verdict."""
        return MARKS[self.passed]


@dataclass(frozen=True)
class Table:
    """A table; its first column is the verdict, if its lines have one.

    Attributes:
        caption: what it lists.
        columns: headings after the verdict.
        lines: its lines.
        numbers: headings of the columns that hold numbers.
        folded: shown only when the reader opens it, below the section's pictures.
    """

    caption: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]
    numbers: tuple[str, ...] = ()
    folded: bool = False

    @property
    def judged(self) -> bool:
        """Whether the lines have a verdict."""
        return any(line.verdict for line in self.lines)


@dataclass(frozen=True)
class Count:
    """A card below the verdict: one claim in one line.

    Attributes:
        anchor: of the section that tells more, "" if there is none.
        title, text: in words.
        passed: the judgement; None where nothing is judged.
    """

    anchor: str
    title: str
    text: str
    passed: bool | None

    @property
    def mark(self) -> str:
        """The sign of the judgement."""
        return MARKS[self.passed]


@dataclass(frozen=True)
class Section:
    """A section of the report; a section without content is left out by returning None.

    Attributes:
        anchor: its id on the page.
        title: heading.
        lead: paragraph below it.
        tables, pictures: below it, in this order.
        facts: pairs of a name and what is to be said about it.
        items: sentences, as a list.
    """

    anchor: str
    title: str
    lead: str = ""
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    items: tuple[str, ...] = ()


def quantity(value: float | None, unit: str) -> str:
    """Return a number with its unit."""
    return number(value) + (f" {unit}" if unit != "1" and value is not None else "")
