"""What every result offers: it is printed, shown in a notebook, saved and drawn.

A result is data.  The ``sections.py`` in its folder says how it is reported and documented: it
registers a function for its class with ``report_of`` and ``document_of``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import singledispatch
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.report.html import notebook, page
from servo_models.report.interchange import finite_json, plain
from servo_models.report.sections import Page, Section, Table
from servo_models.report.style import figure
from servo_models.report.terminal import group, text

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes
    from rich.console import Group

    from servo_models.report.document import Document


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


@singledispatch
def report_of(result: Any, date: str = "") -> Report:
    """Return a result as people read it; ``date`` stands on its page."""
    made: Report = registered(report_of.dispatch, result)(result, date)
    return made


@singledispatch
def document_of(result: Any) -> Document | dict[str, Any]:
    """Return a result as what JSON is made of, figures in SI."""
    made: Document | dict[str, Any] = registered(document_of.dispatch, result)(result)
    return made


@singledispatch
def page_of(result: Any, date: str = "") -> Report:
    """Return a result as its page shows it, with the parts that take a while to compute."""
    registered(report_of.dispatch, result)
    made = page_of.dispatch(type(result))
    return report_of(result, date) if made is page_of.dispatch(object) else made(result, date)


def registered(
    dispatch: Callable[[type], Callable[..., Any]], result: object
) -> Callable[..., Any]:
    """Return what the ``sections`` beside a result's module register; they are imported when a
    result is first asked for it."""
    default = dispatch(object)
    if dispatch(type(result)) is default:
        import_module(f"{type(result).__module__.rpartition('.')[0]}.sections")
    if dispatch(type(result)) is default:
        raise TypeError(f"nobody says how a {type(result).__name__} is reported")
    return dispatch(type(result))


class Result:
    """A result that is printed, shown in a notebook, saved and drawn."""

    def report(self, date: str = "") -> Report:
        """Return the result as people read it; ``date`` stands on its page."""
        return report_of(self, date)

    def document(self) -> dict[str, Any]:
        """Return the result as what JSON is made of, figures in SI."""
        made: dict[str, Any] = plain(document_of(self))
        return made

    def __str__(self) -> str:
        return str(self.report())

    def __repr__(self) -> str:
        report = self.report()
        told = ": ".join(filter(None, (report.title, report.sentence)))
        return f"<{type(self).__name__} of {told}>"

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()

    def to_json(self) -> str:
        """Return the document as JSON; a figure that is not finite becomes null."""
        return finite_json(self.document())

    def write_report(self, path: str | Path, date: str = "") -> None:
        """Write the result as one HTML file that needs nothing else, whole or not at all.

        Args:
            path: of the file.
            date: shown beside the title; the same result and date give the same bytes.

        Raises:
            UserError: the folder cannot be made or written.
        """
        write_whole(Path(path), page(page_of(self, date)).encode())

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
        pictures = self.report().pictures
        if not pictures:
            raise UserError(f"{type(self).__name__} has no picture")
        if ax is None:
            ax = figure(pictures[0]).axes[0]
        else:
            pictures[0].draw([ax])
        return ax
