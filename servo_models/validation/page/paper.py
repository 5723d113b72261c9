"""Section: the figures that the papers print, and those that cannot be had."""

from __future__ import annotations

from servo_models.report.parts import Line, Section, Table, number
from servo_models.validation.rows import PAPER, Row, Validation

TITLE = "Figures of the papers"
DIGITS = 7
"""Enough for every coefficient that the papers print."""


def section(validation: Validation) -> Section | None:
    """Return the section, None if no printed figure was examined."""
    rows = validation.of(PAPER)
    if not rows:
        return None
    tables = tuple(
        _table([row for row in rows if row.actuator == actuator], actuator)
        for actuator in dict.fromkeys(row.actuator for row in rows)
    )
    return Section(
        "paper",
        TITLE,
        "Printed: the figure in the paper. Recomputed: the same from the paper's own numbers,"
        " without this model. Model: what the simulation gives. A figure that cannot be"
        " reproduced is named with its reason; it does not fail the validation.",
        tables,
    )


def _table(rows: list[Row], actuator: str) -> Table:
    return Table(
        f"Printed figures of {actuator}",
        ("quantity", "printed", "recomputed", "model", "within", "unit", "variant, case", "note"),
        tuple(
            Line(
                (
                    row.quantity,
                    number(row.printed, DIGITS),
                    number(row.recomputed, DIGITS),
                    number(row.value, DIGITS),
                    number(row.limit),
                    "" if row.unit == "1" else row.unit,
                    f"{row.variant}, {row.case}",
                    row.note,
                ),
                row.verdict,
                row.passed,
            )
            for row in rows
        ),
        numbers=("printed", "recomputed", "model", "within"),
    )
