"""The page: a verdict and sections in order, filled into the template."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from servo_models.report import style
from servo_models.report.parts import MARKS, Count, Section


@dataclass(frozen=True)
class Page:
    """A report.

    Attributes:
        title: of the window.
        kind: what it reports, above the verdict.
        sentence: the verdict.
        passed: the judgement; None where nothing is judged.
        sections: None for one that is left out.
        remarks: paragraphs below the verdict.
        counts: cards below them.
        date: shown beside the kind, "" for none.
    """

    title: str
    kind: str
    sentence: str
    passed: bool | None
    sections: Sequence[Section | None]
    remarks: Sequence[str] = ()
    counts: Sequence[Count] = ()
    date: str = ""


def render(page: Page) -> str:
    """Return a report as HTML; every text is escaped, only our own figures are markup."""
    folder = files("servo_models.report")
    template = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(folder.joinpath("page.html").read_text("utf-8"))
    return template.render(
        style=Markup(style.variables() + "\n" + folder.joinpath("page.css").read_text("utf-8")),
        page=page,
        mark=MARKS[page.passed],
        sections=[section for section in page.sections if section],
    )
