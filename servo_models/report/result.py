"""What every result of the package offers beside its figures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servo_models.errors import UserError

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

    from servo_models.report.sections import Report


class Result(ABC):
    """A result that is printed, shown in a notebook, saved and drawn.

    A domain gives ``report`` and ``document``; the rest is here.
    """

    @abstractmethod
    def report(self, date: str = "") -> Report:
        """Return the result as people read it; ``date`` stands on its page."""

    @abstractmethod
    def document(self) -> dict[str, Any]:
        """Return the result as what JSON is made of, figures in SI."""

    def __str__(self) -> str:
        return str(self.report())

    def __repr__(self) -> str:
        report = self.report()
        return f"<{type(self).__name__} of {report.title}: {report.sentence}>"

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()

    def to_json(self) -> str:
        """Return the document as JSON; a figure that is not finite becomes null."""
        from servo_models.report.interchange import finite_json

        return finite_json(self.document())

    def write_report(self, path: str | Path, date: str = "") -> None:
        """Write the result as one HTML file that needs nothing else, whole or not at all.

        Args:
            path: of the file.
            date: shown beside the title; the same result and date give the same bytes.

        Raises:
            UserError: the folder cannot be made or written.
        """
        write_page(self.report(date), path)

    def tables(self) -> dict[str, pl.DataFrame]:
        """Return every table of the report by its title, as polars DataFrames.

        Call ``.to_pandas()`` on one for pandas, where that is installed.
        """
        return {title: table.frame() for title, table in self.report().titled_tables.items()}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the first picture of the report and return its axes.

        Args:
            ax: axes to draw on; default: axes of a new figure.

        Raises:
            UserError: the result has no picture.
        """
        from servo_models.report.style import figure

        pictures = self.report().pictures
        if not pictures:
            raise UserError(f"{type(self).__name__} has no picture")
        if ax is None:
            ax = figure(pictures[0]).axes[0]
        else:
            pictures[0].draw([ax])
        return ax


def write_page(report: Report, path: str | Path) -> None:
    """Write a report as one HTML file, whole or not at all.

    Raises:
        UserError: the folder cannot be made or written.
    """
    from servo_models.files import write_whole
    from servo_models.report.html import page

    write_whole(Path(path), page(report).encode())
