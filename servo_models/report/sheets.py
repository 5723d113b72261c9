"""Data sheets of texts and tables: a report without a verdict, for domains without sections yet."""

from __future__ import annotations

from servo_models.report.numbers import with_error
from servo_models.report.sections import Report, Section, Table

__all__ = ["Sheet", "Table", "with_error"]


class Sheet(Report):
    """Titled texts and tables."""

    def __init__(self, title: str, texts: tuple[str, ...], tables: tuple[Table, ...]) -> None:
        super().__init__(title, "", remarks=texts, sections=(Section("", tables=tables),))

    @property
    def texts(self) -> tuple[str, ...]:
        return self.remarks
