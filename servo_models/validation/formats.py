"""A validation as text, JSON, GitHub annotations and JUnit XML."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

from servo_models.files import write_whole
from servo_models.report.interchange import command, finite_json
from servo_models.report.sheets import Sheet, Table
from servo_models.validation.rows import (
    CLAIMS,
    IMPLEMENTATION,
    MODEL,
    PAPER,
    Row,
    Validation,
    tightest,
)

HEADINGS = {
    IMPLEMENTATION: "Implementation: the FMU equals the simulation",
    MODEL: "Model: the response equals an independent reference",
    PAPER: "Figures of the papers",
}
NEAREST = "; of each case the figure nearest to its limit"

BRIEF = ("FMU = simulation", "model = reference", "figures of its paper")
"""Headings of the claims in a summary, in their order."""
COLUMNS = ("verdict", "actuator", "variant", "case", "quantity", "value", "limit", "")


def text(validation: Validation, every: bool = False) -> Sheet:
    """Return the tables of a validation: one a claim, then what failed.

    A case of the first two claims is one line, its figure nearest to its limit, unless
    ``every`` figure is wanted; the figures of the papers are always told one by one.
    """
    tables: list[Table] = []
    for claim in CLAIMS:
        rows = validation.of(claim)
        brief = claim != PAPER and not every
        shown = [_case(group) for group in _cases(rows)] if brief else [_cells(r) for r in rows]
        heading = HEADINGS[claim] + (NEAREST if brief else "")
        tables += [Table(heading, COLUMNS, tuple(shown))] if shown else []
    failed = tuple(_cells(row) for row in validation.failures)
    tables += [Table("Outside their limits", COLUMNS, failed)] if failed else []
    return Sheet("Validation", (), tuple(tables))


def summary(validation: Validation) -> Sheet:
    """Return the verdict, how many figures of each actuator pass, and what failed."""
    names = dict.fromkeys(row.actuator for row in validation.rows)
    counts = tuple(
        (name, *(_count(validation.of(claim), name) for claim in CLAIMS)) for name in names
    )
    tables = [Table("Figures that pass", ("actuator", *BRIEF), counts)]
    failed = tuple(_cells(row)[1:] for row in validation.failures)
    tables += [Table("Outside their limits", COLUMNS[1:], failed)] if failed else []
    return Sheet(sentence(validation), (), tuple(tables))


def _count(rows: Sequence[Row], actuator: str) -> str:
    own = [row for row in rows if row.actuator == actuator]
    judged = [row for row in own if row.passed is not None]
    named = sum(row.passed is None and row.claim == PAPER for row in own)
    counts = [f"{sum(bool(row.passed) for row in judged)} of {len(judged)}"] if judged else []
    return ", ".join([*counts, *([f"{named} not reproducible"] if named else [])])


def _cases(rows: Sequence[Row]) -> Iterable[list[Row]]:
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.actuator, row.variant, row.case, row.subject), []).append(row)
    return groups.values()


def _case(rows: Sequence[Row]) -> tuple[str, ...]:
    passed, judged = sum(row.passed is True for row in rows), len(rows)
    count = f"{passed} of {judged} figures pass" if judged > 1 else ""
    return (*_cells(tightest(rows))[:-1], count)


def sentence(validation: Validation) -> str:
    """Return the verdict in one sentence."""
    judged = sum(row.passed is not None for row in validation.rows)
    failed = len(validation.failures)
    if failed:
        return f"FAILED: {failed} of {judged} figures are outside their limits."
    return f"PASSED: all {judged} figures are within their limits."


def as_json(validation: Validation) -> str:
    """Return everything as JSON; a figure that is not finite becomes null."""
    return finite_json(validation.as_dict())


def github(validation: Validation) -> Iterator[str]:
    """Return workflow commands: an error for each failed row, and a notice with the verdict."""
    for row in validation.failures:
        yield command("error", _title(row), _reason(row))
    for row in validation.rows:
        if row.passed is None and row.note:
            yield command("notice", _title(row), _reason(row))
    yield command("notice", "servo-models", sentence(validation))


def write_junit(validation: Validation, path: Path) -> None:
    """Write a validation as JUnit XML: one suite a claim, unjudged rows skipped, times [s].

    Raises:
        UserError: the folder cannot be written.
    """
    root = ElementTree.Element("testsuites", name="servo-models", time=_time(validation.rows))
    for claim in CLAIMS:
        rows = validation.of(claim)
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=claim,
            tests=str(len(rows)),
            failures=str(sum(row.passed is False for row in rows)),
            skipped=str(sum(row.passed is None for row in rows)),
            time=_time(rows),
        )
        for row in rows:
            case = ElementTree.SubElement(
                suite,
                "testcase",
                classname=f"{claim}.{row.actuator}.{row.variant}",
                name=f"{row.case}: {row.quantity}",
                time=_time([row]),
            )
            if row.passed is False:
                ElementTree.SubElement(case, "failure", message=_reason(row))
            elif row.passed is None:
                ElementTree.SubElement(case, "skipped", message=_reason(row))
    ElementTree.indent(root)
    write_whole(path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _time(rows: Iterable[Row]) -> str:
    return f"{sum(row.seconds for row in rows):.3f}"


def _cells(row: Row) -> tuple[str, ...]:
    verdict = {True: "pass", False: "FAIL", None: row.verdict}[row.passed]
    names = (row.actuator, row.variant, row.case, row.quantity)
    note = "" if row.passed and row.claim != PAPER else row.note
    return (verdict, *names, _figure(row.value, row.unit), _limit(row), note)


def _limit(row: Row) -> str:
    """What the value is held against; in a paper's figures the limit is a distance."""
    if row.claim != PAPER:
        return "" if row.limit is None else f"<= {_figure(row.limit, row.unit)}"
    targets = {"printed": row.printed, "recomputed": row.recomputed}
    given = [f"{name} {_figure(it, row.unit)}" for name, it in targets.items() if it is not None]
    if given and row.limit is not None:
        given[0] += f" +- {row.limit:.3g}"
    return ", ".join(given)


def _figure(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    return f"{value:.5g}" if unit == "1" else f"{value:.5g} {unit}"


def _title(row: Row) -> str:
    return f"{row.actuator} {row.variant}: {row.case}, {row.quantity}"


def _reason(row: Row) -> str:
    note = f"; {row.note}" if row.note else ""
    return f"{row.verdict}: {_figure(row.value, row.unit)} {_limit(row)}".rstrip() + note
