"""What a section is made of; the page's template knows these parts and no others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from servo_models.report.style import Picture
from servo_models.validation.rows import Row

MARKS = {True: "✓", False: "✗", None: "○"}
"""A sign beside each verdict, so that it does not hang on colour."""

NONE, MINUS, TIMES = "\N{EN DASH}", "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}"
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Line:
    """A line of a table.

    Attributes:
        cells: one text per column after the verdict.
        verdict: the judgement in words.
        passed: the judgement; None where nothing is judged.
    """

    cells: tuple[str, ...]
    verdict: str
    passed: bool | None

    @property
    def mark(self) -> str:
        """The sign of the verdict."""
        return MARKS[self.passed]


@dataclass(frozen=True)
class Table:
    """A table whose first column is the verdict.

    Attributes:
        caption: what it lists.
        columns: headings after the verdict.
        lines: its lines.
        numbers: headings of the columns that hold numbers.
        folded: shown only when the reader opens it.
    """

    caption: str
    columns: tuple[str, ...]
    lines: tuple[Line, ...]
    numbers: tuple[str, ...] = ()
    folded: bool = False


@dataclass(frozen=True)
class Section:
    """A section of the report; a section without content is left out by returning None."""

    anchor: str
    title: str
    lead: str = ""
    tables: tuple[Table, ...] = ()
    pictures: tuple[Picture, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()


def number(value: float | None, digits: int = 4) -> str:
    """Return a number as in print: a true minus sign, powers of ten, a dash for None."""
    if value is None:
        return NONE
    if value == 0.0 or not math.isfinite(value) or 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits}g}".replace("-", MINUS)
    mantissa, power = f"{value:.{digits - 2}e}".split("e")
    return f"{number(float(mantissa), digits)}{TIMES}10{str(int(power)).translate(_RAISED)}"


def quantity(value: float | None, unit: str) -> str:
    """Return a number with its unit."""
    return number(value) + (f" {unit}" if unit != "1" and value is not None else "")


def share(row: Row) -> str:
    """Return how much of its limit a row uses."""
    if row.value is None or not row.limit:
        return NONE
    used = row.value / row.limit
    if used >= 10.0:
        return f"{number(float(f'{used:.2g}'))} times"
    return "< 1 %" if 0.0 < used < 0.01 else f"{100.0 * used:.0f} %"


def by_run(rows: Sequence[Row]) -> tuple[list[Row], ...]:
    """Return rows grouped by actuator, variant and what was run, in their order."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.actuator, row.variant, row.subject), []).append(row)
    return tuple(groups.values())


def run_of(row: Row) -> str:
    """Return what was run: an FMU, or the simulation."""
    return row.subject or "simulation"


def judgement(rows: Iterable[Row]) -> bool | None:
    """Return False if any row failed, True if some were judged, else None."""
    verdicts = {row.passed for row in rows}
    if False in verdicts:
        return False
    return True if True in verdicts else None
