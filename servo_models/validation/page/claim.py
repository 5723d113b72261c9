"""A claim as tables: one line per variant and run, then everything that was measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from servo_models.report.parts import NONE, Line, Table, number, quantity
from servo_models.validation.rows import Row, tightest

WORDS = {True: "passed", False: "failed", None: "for information"}
FIGURE = ("variant", "run", "case", "quantity", "value", "limit", "used", "note")
"""Columns of one row of a validation."""
NUMBERS = ("checks passed", "value", "limit", "used")


def line(row: Row, *before: str) -> Line:
    """Return a row under ``FIGURE``, with further cells before it."""
    cells = (
        row.variant,
        run_of(row),
        row.case,
        row.quantity,
        quantity(row.value, row.unit),
        number(row.limit),
        share(row),
        row.note,
    )
    return Line((*before, *cells), row.verdict, row.passed)


def tables(rows: Sequence[Row], what: str) -> tuple[Table, ...]:
    """Return the overview of a claim's rows and, per actuator, all of them.

    Args:
        rows: of one claim.
        what: is compared, for the captions.
    """
    overview = Table(
        f"{what}, one line a variant and run",
        (
            "actuator",
            "variant",
            "run",
            "checks passed",
            "nearest to its limit",
            "value",
            "limit",
            "used",
        ),
        tuple(_summary(group) for group in by_run(rows)),
        NUMBERS,
    )
    actuators = dict.fromkeys(row.actuator for row in rows)
    return (overview, *(_everything([r for r in rows if r.actuator == a], a) for a in actuators))


def _summary(group: Sequence[Row]) -> Line:
    judged = [row for row in group if row.passed is not None]
    worst = tightest(judged or group)
    passed = sum(bool(row.passed) for row in judged)
    return Line(
        (
            worst.actuator,
            worst.variant,
            run_of(worst),
            f"{passed} of {len(judged)}",
            f"{worst.quantity}; {worst.case}",
            quantity(worst.value, worst.unit),
            number(worst.limit),
            share(worst),
        ),
        WORDS[judgement(group)],
        judgement(group),
    )


def _everything(rows: Sequence[Row], actuator: str) -> Table:
    lines = tuple(line(row) for row in rows)
    return Table(f"All {len(rows)} figures of {actuator}", FIGURE, lines, NUMBERS, folded=True)


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
