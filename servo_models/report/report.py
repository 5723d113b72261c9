"""A report: a page of sections that is printed, and shown in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from servo_models.report.html import notebook
from servo_models.report.sections import Page, Section, Table
from servo_models.report.terminal import group, text

if TYPE_CHECKING:
    from rich.console import Group


class Report(Page):
    """A result as people read it.

    ``str(report)`` is plain text, rich prints it for a terminal, and a notebook shows it.
    """

    def __repr__(self) -> str:
        return f"<Report of {': '.join(filter(None, (self.title, self.sentence)))}>"

    def _repr_html_(self) -> str:
        return notebook(self)

    def __rich__(self) -> Group:
        return group(self)

    def __str__(self) -> str:
        return text(self)


def data_sheet(title: str, texts: Sequence[str], tables: Sequence[Table]) -> Report:
    """Return a report without a verdict: paragraphs, then tables that name themselves."""
    return Report(title, "", remarks=tuple(texts), sections=(Section("", tables=tuple(tables)),))
