"""The page: its sections in order, filled into the template."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from servo_models.report import (
    accuracy,
    conditions,
    implementation,
    model,
    paper,
    sg90,
    style,
    torque_motor,
    verdict,
)
from servo_models.report.parts import judgement
from servo_models.validation.rows import Validation

SECTIONS = (verdict, implementation, model, sg90, torque_motor, accuracy, paper, conditions)


def page(validation: Validation, date: str) -> str:
    """Return the report as HTML; every text is escaped, only our own figures are markup."""
    folder = files("servo_models.report")
    template = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    ).from_string(folder.joinpath("page.html").read_text("utf-8"))
    sections = [module.section(validation) for module in SECTIONS]
    return template.render(
        style=Markup(style.variables() + "\n" + folder.joinpath("page.css").read_text("utf-8")),
        passed=judgement(validation.rows),
        sentence=verdict.sentence(validation),
        remarks=verdict.remarks(validation),
        counts=verdict.counts(validation),
        sections=[section for section in sections if section],
        date=date,
    )
