"""The verdict: the sentence at the top, a count for each claim, and what failed."""

from __future__ import annotations

from servo_models.report.parts import Count, Section, Table
from servo_models.validation.page import claim
from servo_models.validation.page.claim import judgement
from servo_models.validation.rows import IMPLEMENTATION, MODEL, PAPER, Validation

TITLES = {
    IMPLEMENTATION: "FMU equals simulation",
    MODEL: "Responses equal references",
    PAPER: "Figures of the papers",
}


def sentence(validation: Validation) -> str:
    """Return the verdict in one sentence."""
    judged = [row for row in validation.rows if row.passed is not None]
    if not judged:
        return "Nothing was judged."
    failed = len(validation.failures)
    if failed:
        return f"{failed} of {len(judged)} checks failed."
    return f"All {len(judged)} checks passed."


def remarks(validation: Validation) -> tuple[str, ...]:
    """Return what the verdict leaves open: figures without a match, claims not examined."""
    open_ = sum(row.passed is None for row in validation.of(PAPER))
    said = []
    if open_:
        figures = "figure" if open_ == 1 else "figures"
        said.append(f"{open_} printed {figures} cannot be reproduced; the reasons are given.")
    for name, title in TITLES.items():
        if not validation.of(name):
            said.append(f"Not examined: {title}.")
    return tuple(said)


def counts(validation: Validation) -> tuple[Count, ...]:
    """Return one count for each claim."""
    made = []
    for name, title in TITLES.items():
        rows = validation.of(name)
        judged = [row for row in rows if row.passed is not None]
        passed = sum(bool(row.passed) for row in judged)
        text = f"{passed} of {len(judged)} checks passed" if rows else "not examined"
        made.append(Count(name if rows else "", title, text, judgement(rows)))
    return tuple(made)


def section(validation: Validation) -> Section | None:
    """Return what failed, None if nothing did."""
    if not validation.failures:
        return None
    table = Table(
        "Every check that failed",
        ("claim", "actuator", *claim.FIGURE),
        tuple(claim.line(row, row.claim, row.actuator) for row in validation.failures),
        claim.NUMBERS,
    )
    return Section("failed", "What failed", tables=(table,))
