"""The page that comes with an FMU (FMI 2.0.4, section 2.3), from the actuator's declaration."""

from __future__ import annotations

from html import escape

from fmu_src.description import Form, described
from fmu_src.variables import start_of
from servo_models.analysis.explain import actuator_sheet
from servo_models.core.simulate import Model
from servo_models.report.sections import Table

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; }
div { overflow-x: auto; }
table { border-collapse: collapse; font-size: 14px; }
th, td { text-align: left; vertical-align: top; padding: .2em .8em .2em 0; }
tr { border-bottom: 1px solid #ddd; }
"""


def index_html(model: Model, form: Form) -> str:
    """Return the page: what the FMU is, how it is run, signals, equations and start values."""
    sheet = actuator_sheet(model.actuator, model.variant, model.values)
    main = model.plant.wire[model.actuator.step[0]]
    texts = (
        described(model),
        "An input that the host does not set keeps its start value. That is rest, but for"
        f" '{main.name}', which steps to {start_of(main, model):g} {main.unit}.",
        f"The default experiment lasts {model.stop_time:g} s, in steps of {model.step_size:g} s."
        " The model's own step is a parameter, internal_step.",
        form.needs,
        *sheet.remarks,
    )
    body = [f"<h1>{escape(sheet.title)}</h1>", *(f"<p>{escape(text)}</p>" for text in texts)]
    body += [_table(table) for table in sheet.tables if table.rows]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{escape(sheet.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(column)}</th>" for column in table.headings)
    rows = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in table.texts)
    lines = "\n".join(f"<tr>{row}</tr>" for row in rows)
    return f"<h2>{escape(table.title)}</h2>\n<div><table>\n<tr>{head}</tr>\n{lines}\n</table></div>"
