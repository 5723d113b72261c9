"""Reports as Markdown, for the summary of a job of a CI service."""

from __future__ import annotations

import re
from collections.abc import Iterator

from servo_models.report.result import Report
from servo_models.report.sections import Table

SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~])")


def markdown(report: Report) -> str:
    """Return a report in Markdown; pictures and details behind a click are left out."""
    return "\n".join(_lines(report)) + "\n"


def _lines(report: Report) -> Iterator[str]:
    yield f"## {_escaped(report.title)}"
    for paragraph in (report.sentence, *report.remarks):
        if paragraph:
            yield from ("", _escaped(paragraph))
    for section in report.filled:
        if section.title:
            yield from ("", f"### {_escaped(section.title)}", "")
        for item in section.items:
            yield f"- {_escaped(item)}"
        for table in section.tables:
            if table.rows and not table.folded:
                yield from table_lines(table)


def table_lines(table: Table) -> Iterator[str]:
    """Yield a table in Markdown, line by line."""
    yield ""
    if table.title:
        yield from (f"**{_escaped(table.title)}**", "")
    yield _row(table.headings)
    yield _row("---:" if table.numeric(k) else "---" for k in range(len(table.columns)))
    for texts in table.texts:
        yield _row(map(_escaped, texts))


def _row(cells: Iterator[str] | map[str] | tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"


def _escaped(text: str) -> str:
    """A text, perhaps from a foreign file, escaped so that Markdown shows it as it is."""
    return SPECIAL.sub(r"\\\1", " ".join(text.split()))
