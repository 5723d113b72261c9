"""Reports as HTML: a page that needs nothing else, and what a notebook shows."""

from __future__ import annotations

import json
import re
import zlib
from dataclasses import replace
from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from jinja2.environment import TemplateModule
from markupsafe import Markup, escape

from servo_models.report import live, style
from servo_models.report.sections import Mark, Page, Picture, Section, Table

MARKS = {True: "✓", False: "✗", None: "○"}
"""Sign beside each verdict, so that colour is not needed to read it."""
JUDGEMENTS = {True: "pass", False: "fail", None: "open"}
OPTION = re.compile(r"(?<!\S)--[a-z][\w-]*")
"""Option of a command, as ``--out``: a browser would break a line after its hyphens."""


def page(report: Page) -> str:
    """Return a report as one HTML page; every text is escaped, only our own figures are markup."""
    sheet = files(__package__).joinpath("report.css").read_text("utf-8")
    panels = report.panels
    sheets = "\n".join([style.variables(), sheet, _labels(report), live.styles(panels)])
    scripts = live.scripts(panels)
    made: str = _template(report).page(  # type: ignore[attr-defined]
        Markup(sheets),
        live.policy(scripts, any(panel.served for panel in panels)),
        [Markup(text) for text in scripts],
        Markup(live.data(panels)),
    )
    return str(made)


def _labels(report: Page) -> str:
    """Headings for phones, where a row becomes a block: one CSS rule for a kind of table."""
    kinds = {_kind(table): table.headings for table in report.tables}
    texts = {
        f".{kind} td:nth-child({k})": json.dumps(heading, ensure_ascii=False).replace("<", r"\3c ")
        for kind, headings in kinds.items()
        for k, heading in enumerate(headings, 1)
    }
    return "\n".join(f"{cells} {{ --label: {text}; }}" for cells, text in texts.items())


def _kind(table: Table) -> str:
    """A class that tables with the same headings share."""
    return f"t{zlib.crc32(repr(table.headings).encode()):x}"


def notebook(report: Page) -> str:
    """Return the verdict, the panel or first figure and the first table as a notebook shows them.

    A report without a verdict is a data sheet: it is shown whole.
    """
    titled = [replace(table, title=title) for title, table in report.titled_tables.items()]
    tables = titled[:1] if report.sentence else titled
    lively = page(_with_panels(report)) if report.panels else ""
    made = _template(report).notebook(report.pictures[:1], tables, lively)  # type: ignore[attr-defined]
    return str(made)


def _with_panels(report: Page) -> Page:
    """A report with nothing but its panels, for a frame."""
    sections = (Section("", live=panel) for panel in report.panels)
    return replace(report, title="", sentence="", cards=(), remarks=(), sections=tuple(sections))


def _unbroken(text: str) -> Markup:
    """A text in which no line ends inside an option of a command."""
    return Markup(OPTION.sub(r'<span class="option">\g<0></span>', str(escape(text))))


def _template(report: Page) -> TemplateModule:
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["unbroken"] = _unbroken
    environment.tests["mark"] = lambda cell: isinstance(cell, Mark)
    text = files(__package__).joinpath("report.html").read_text("utf-8")
    drawn = {id(picture): k for k, picture in enumerate(report.pictures)}
    lively = {id(panel): k for k, panel in enumerate(report.panels)}

    def svg(picture: Picture, themed: bool = True) -> Markup:
        name = f"figure-{drawn[id(picture)]}"
        return style.svg(style.figure(picture), name, picture.title, themed)

    return environment.from_string(text).make_module(
        {
            **{"report": report, "marks": MARKS, "judgements": JUDGEMENTS, "svg": svg},
            "panel": lambda panel: lively[id(panel)],
            "kind": _kind,
        }
    )
