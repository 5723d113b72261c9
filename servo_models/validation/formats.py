"""A validation for other programs: GitHub annotations and summaries, JUnit XML."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from xml.etree import ElementTree

from servo_models.files import read_regular, write_whole
from servo_models.report.interchange import command
from servo_models.report.markdown import markdown
from servo_models.validation.rows import REFERENCE, Row, Validation
from servo_models.validation.sections import in_words, sentence, summary


def github(validation: Validation) -> Iterator[str]:
    """Return workflow commands: an error for each failed row, and a notice with the verdict."""
    for row in validation.failures:
        if row.claim == REFERENCE and not row.note:
            continue  # another row of this output says what is wrong
        yield command("error", _title(row), in_words(row))
    for row in validation.rows:
        if row.passed is None and row.note:
            yield command("notice", _title(row), in_words(row))
    yield command("notice", "servo-models", sentence(validation))


def write_junit(validation: Validation, path: Path) -> None:
    """Write a validation as JUnit XML: one suite a claim, unjudged rows skipped, times [s].

    Raises:
        UserError: the folder cannot be written.
    """
    root = ElementTree.Element("testsuites", name="servo-models", time=_time(validation.rows))
    for claim in validation.claims:
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
                ElementTree.SubElement(case, "failure", message=in_words(row))
            elif row.passed is None:
                ElementTree.SubElement(case, "skipped", message=in_words(row))
    ElementTree.indent(root)
    write_whole(path, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def write_summary(validation: Validation, path: Path) -> None:
    """Append a validation in Markdown to a file, as to that of ``$GITHUB_STEP_SUMMARY``.

    Raises:
        UserError: the file cannot be written.
    """
    text = markdown(summary(validation))
    before = read_regular(path) if os.path.exists(path) else b""
    write_whole(path, before + text.encode())


def _time(rows: Iterable[Row]) -> str:
    return f"{sum(row.seconds for row in rows):.3f}"


def _title(row: Row) -> str:
    return f"{row.actuator} {row.variant}: {row.case}, {row.quantity}"
