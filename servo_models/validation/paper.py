"""The claim *paper*: what a figure of a paper is, and how it is judged.

A figure is judged against the printed one, or against the recomputed one where the paper
prints none.  What the paper's own numbers do not give is named, with the reason.
"""

from __future__ import annotations

from servo_models.validation.rows import PAPER, Row


def figure(
    where: tuple[str, str, str],
    quantity: str,
    got: float | None,
    within: float,
    unit: str = "1",
    *,
    printed: float | None = None,
    recomputed: float | None = None,
    note: str = "",
) -> Row:
    """Make a row that passes while ``got`` is within ``within`` of the printed figure.

    ``where`` is actuator, variant and case.
    """
    target = recomputed if printed is None else printed
    passed = got is not None and target is not None and bool(abs(got - target) <= within)
    return Row(PAPER, *where, quantity, got, within, unit, passed, note, printed, recomputed)


def not_reproducible(
    where: tuple[str, str, str],
    quantity: str,
    got: float | None,
    unit: str,
    *,
    printed: float,
    recomputed: float,
    note: str,
) -> Row:
    """Name a printed figure that its own paper contradicts, and why."""
    return Row(PAPER, *where, quantity, got, None, unit, None, note, printed, recomputed)
