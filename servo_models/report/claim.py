"""A claim as tables: one line per variant, then everything that was measured."""

from __future__ import annotations

from collections.abc import Sequence

from servo_models.report.parts import (
    Line,
    Table,
    by_variant,
    judgement,
    number,
    quantity,
    share,
    tightest,
)
from servo_models.validation.rows import Row

WORDS = {True: "passed", False: "failed", None: "for information"}


def tables(rows: Sequence[Row], what: str) -> tuple[Table, ...]:
    """Return the overview of a claim's rows and, per actuator, all of them.

    Args:
        rows: of one claim.
        what: is compared, for the captions.
    """
    overview = Table(
        f"{what}, one line a variant",
        ("actuator", "variant", "checks passed", "nearest to its limit", "value", "limit", "used"),
        tuple(_summary(group) for group in by_variant(rows).values()),
        numbers=(2, 4, 5, 6),
    )
    actuators = dict.fromkeys(row.actuator for row in rows)
    return (overview, *(_everything([r for r in rows if r.actuator == a], a) for a in actuators))


def _summary(group: Sequence[Row]) -> Line:
    judged = [row for row in group if row.passed is not None]
    worst = tightest(judged or group)
    passed = sum(row.passed is True for row in judged)
    return Line(
        (
            worst.actuator,
            worst.variant,
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
    return Table(
        f"All {len(rows)} figures of {actuator}",
        ("variant", "case", "quantity", "value", "limit", "used", "note"),
        tuple(
            Line(
                (
                    row.variant,
                    row.case,
                    row.quantity,
                    quantity(row.value, row.unit),
                    number(row.limit),
                    share(row),
                    row.note,
                ),
                row.verdict,
                row.passed,
            )
            for row in rows
        ),
        numbers=(3, 4, 5),
        folded=True,
    )
