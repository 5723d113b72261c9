"""A page an effect and an actuator, and the living diagnosis of the front page.

No fact about them stands here: equations, parameters and sources are those of their files, rivals
those that effects declare, and the simulators say what they hold.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import generated
from sphinx.application import Sphinx

from servo_models.analysis import pictures
from servo_models.analysis.demonstration import Demonstration, demonstrate
from servo_models.analysis.explain import explain, shown_value
from servo_models.analysis.isolability import catalogue_ambiguities
from servo_models.analysis.live import demonstrated, explained
from servo_models.catalogue import actuators
from servo_models.core.block import FirstOrderLag, Hints
from servo_models.effects import effects
from servo_models.identification.readings import words
from servo_models.report import live, style
from servo_models.report.live import Live
from servo_models.report.markdown import table_lines
from servo_models.report.numbers import listed
from servo_models.report.result import Report
from servo_models.report.sections import Table
from servo_models.simulators import simulators

HEADINGS = (
    "What it is",
    "The textbook picture",
    "A live panel",
    "How it shows in a log",
    "What it is confused with",
    "Which simulator has it",
    "Source",
)
OF_EFFECTS = (
    "What a simulation usually lacks. Each is a parameter that at 0 is exactly not there, and a"
    " cause that a diagnosis may name."
)
OF_ACTUATORS = "Each page has the equations, values and sources, and a panel in which it runs."
SIGNATURES = {
    "codes": "Readings bunch at codes that are one step apart: a diagnosis looks for that apart"
    " from any error.",
    "clock": "Changes of the command are answered on the ticks of a clock: a diagnosis looks for"
    " that apart from any error.",
}
LIVE = re.compile(r'<script type="text/plain" id="live-data">.*</script>', re.DOTALL)


def page(name: str) -> str:
    """The page of an effect, in Markdown."""
    shown, blocks, hints = demonstrate(name), effects()[name], _hints(name)
    sheet = demonstrated(name, shown)
    told = (
        _what(sheet),
        _textbook(sheet),
        _raw(panel(sheet.panels)),
        _in_a_log(shown, hints),
        _rivals(name, hints),
        _simulators(name),
        "\n".join(f"- {source}" for source in dict.fromkeys(block.source for block in blocks)),
    )
    sections = (f"## {heading}\n\n{text}" for heading, text in zip(HEADINGS, told))
    return "\n\n".join([f"# {name}", _palette(), *sections]) + "\n"


def actuator_page(name: str) -> str:
    """The page of an actuator: its data sheet, with a panel and its block diagram."""
    sheet = explained(name)
    (diagram,) = sheet.pictures
    parts = [
        f"# {name}",
        _palette(),
        *sheet.remarks,
        f"## {sheet.panels[0].title}",
        _raw(panel(sheet.panels)),
        f"## {diagram.title}",
        _picture(style.svg(style.figure(diagram), "diagram", diagram.title)),
        diagram.text,
    ]
    for table in sheet.tables:
        parts += [f"## {table.title}", "\n".join(table_lines(replace(table, title="")))]
    return "\n\n".join(parts) + "\n"


def _what(sheet: Report) -> str:
    about, *equations = sheet.remarks
    parts = [f"**{about}**"]
    for text in equations:
        *told, _ = text.split("\n\nSource: ")
        about_block, _, code = told[0].rpartition("\n\n    ")
        head, _, body = code.partition("\n")
        lines = "\n".join(line.removeprefix(" " * 8) for line in body.splitlines())
        parts += [about_block, f"`{head}`", f"```python\n{lines}\n```"]
    tables = ("\n".join(table_lines(table)) for table in sheet.tables)
    summary = "<details><summary>Where it is, its parameters and their bounds</summary>"
    parts += [_raw(summary), *tables, _raw("</details>")]
    return "\n\n".join(parts)


def _textbook(sheet: Report) -> str:
    if not sheet.pictures:
        return (
            "It counts time, or changes a constant of the run, so it has no characteristic: the"
            " curves below are its picture."
        )
    drawn = sheet.pictures[0]
    figure = style.svg(style.figure(drawn), "textbook", drawn.title)
    return f"{_picture(figure)}\n\n{drawn.title}: {drawn.text}"


def _in_a_log(shown: Demonstration, hints: Hints) -> str:
    place, (driven, seen) = shown.place, shown.signals
    runs = shown.without, shown.changed
    values = place.actuator.values(None, {**shown.neutral, **shown.active})
    drawn = pictures.comparison(*runs, place.actuator.plant, shown.signals, "", shown.values)
    parts = [
        f"`{driven}` and `{seen}` of `{place.actuator.name}`, without the effect and with"
        f" {shown.values}:",
        _picture(style.svg(drawn, "log", f"{seen} without and with {place.name}")),
    ]
    if hints.says:
        shown_values = {it.key: str(shown_value(it, values[it.name])) for it in place.parameters}
        wire = words(place.actuator.plant.main_wire(place.name))
        parts.append(f'A diagnosis says: "{hints.says.format(wire=wire, **shown_values)}".')
    if hints.signature:
        parts.append(SIGNATURES[hints.signature])
    if hints.small_signal:
        lag = isinstance(hints.small_signal, FirstOrderLag)
        parts.append(f"For small signals it is a {'first-order lag' if lag else 'dead time'}.")
    if hints.of_changes:
        parts.append("It shows only where an input changes.")
    if hints.learnt:
        parts.append("It has whatever form the log shows, and is never named as a cause.")
    return "\n\n".join(parts)


def _rivals(name: str, hints: Hints) -> str:
    rows: list[tuple[str, str]] = []
    for ambiguity in catalogue_ambiguities():
        others = [it for it in sorted(effects()) if ambiguity.separates(name, it)]
        if others:
            links = ", ".join(f"[{it}]({it}.md)" for it in others)
            rows.append((links, ambiguity.experiment))
    parts = ["\n".join(_links_table(("it looks like", "what tells them apart"), rows))] * bool(rows)
    family = [it for it in effects() if _hints(it).family == hints.family]
    if hints.family and len(family) > 1:
        parts.append(
            f'Where a log cannot tell {listed(family)} apart, a diagnosis says "a {hints.family}".'
        )
    return "\n\n".join(parts) or "Nothing on record in the catalogue."


def _hints(name: str) -> Hints:
    """Of an effect of several functions, those of the one that has its name."""
    return next(block.hints for block in effects()[name] if block.name == name)


def _links_table(headings: tuple[str, ...], rows: list[tuple[str, str]]) -> Iterator[str]:
    for cells in (headings, ("---",) * len(headings), *rows):
        yield f"| {' | '.join(cells)} |"


def _simulators(name: str) -> str:
    rows = [
        (simulator.title, place, *simulator.held(place, name))
        for simulator in simulators().values()
        for place in (name, *(it for it in simulator.holds if it.endswith(f"_{name}")))
        if place == name or place not in effects()
    ]
    headings = ("simulator", "effect", "held", "by")
    table = "\n".join(table_lines(Table("", headings, tuple(rows))))
    return f"{table}\n\nAn FMU holds it exactly. See [from and to simulators](../simulators.md)."


def panel(panels: tuple[Live, ...]) -> str:
    """A panel as an element of a page."""
    scripts = "\n".join(f"<script>{text}</script>" for text in live.scripts(panels))
    return (
        f"<style>{live.styles(panels)}</style>\n<p>{panels[0].text}</p>\n"
        f'<div class="live" data-live="0" role="group" aria-label="{panels[0].title}"></div>\n'
        f'<script type="text/plain" id="live-data">{live.data(panels)}</script>\n{scripts}'
    )


def _palette() -> str:
    """The colours of the panel, by the reader's choice of the theme."""
    light, dark = (
        " ".join(f"--{name}: {pair[k]};" for name, pair in style.PALETTE.items()) for k in (0, 1)
    )
    return _raw(
        f"<style>:root {{ {light} }}\n"
        "@media (prefers-color-scheme: dark) {"
        f" :root:not(:has([data-theme=light])) {{ {dark} }} }}\n"
        f":root:has([data-theme=dark]) {{ {dark} }}</style>"
    )


def _picture(figure: str) -> str:
    return _raw(f'<div class="picture">{figure}</div>')


def _raw(html: str) -> str:
    return f"`````{{raw}} html\n{html}\n`````"


def index(title: str, text: str, about: Mapping[str, str]) -> str:
    """A page that lists others of its folder by name."""
    rows = [(f"[{name}]({name}.md)", told) for name, told in about.items()]
    table = "\n".join(_links_table(("name", "what it is"), rows))
    names = "\n".join(about)
    return f"# {title}\n\n{text}\n\n{table}\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"


def diagnosis(page: str) -> str:
    """The panel of a page of a report, for the front page."""
    (found,) = LIVE.findall(page)
    styles = f"<style>{live.asset('uPlot.min.css')}\n{live.asset('panel.css')}</style>"
    return f'{styles}\n<div class="live" data-live="0"></div>\n{found}'


def pages(app: Sphinx) -> None:
    docs = Path(app.srcdir) / "docs"
    made = {f"{name}.md": page(name) for name in effects()}
    about = {name: explain(name).remarks[0] for name in effects()}
    made["index.md"] = index("Effects", OF_EFFECTS, about)
    generated.write(docs / "effects", made)
    made = {f"{name}.md": actuator_page(name) for name in actuators()}
    about = {name: f"{it.title}. {it.about}" for name, it in actuators().items()}
    made["index.md"] = index("Actuators", OF_ACTUATORS, about)
    generated.write(docs / "actuators", made)
    living = f"{_palette()}\n\n{_raw(diagnosis((docs / 'gap.html').read_text('utf-8')))}\n"
    generated.write(docs / "living", {"diagnosis.txt": living})


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
