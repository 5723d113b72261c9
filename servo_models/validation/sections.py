"""A validation as people read it: on a terminal, on a page, in a notebook."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

from servo_models.analysis.live import with_panel
from servo_models.report.document import Document, Figure, about, choice
from servo_models.report.interchange import finite
from servo_models.report.numbers import Quantity, number, percent, plural, with_unit
from servo_models.report.result import Report, document_of, page_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import SERIES, colour
from servo_models.validation.any_fmu.sections import curves, faults, notes
from servo_models.validation.cases import offered
from servo_models.validation.live import panel
from servo_models.validation.rows import (
    CLAIMS,
    FILES,
    IMPLEMENTATION,
    MODEL,
    OWN_CLAIMS,
    PAPER,
    REFERENCE,
    CostCurve,
    Row,
    Validation,
    tightest,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Words(NamedTuple):
    """A claim as a card, a column of counts, a heading, and what stands below that."""

    card: str
    counted: str
    heading: str
    lead: str


WORDS = {
    IMPLEMENTATION: Words(
        "FMU equals simulation",
        "FMU = simulation",
        "Implementation: the FMU equals the simulation",
        "The FMU and the simulation in this process get the same inputs on the same"
        " communication points. A value of 0 is equality to the last bit.",
    ),
    MODEL: Words(
        "Responses equal references",
        "model = reference",
        "Model: the response equals an independent reference",
        "The references are written from the published equations a second time, without"
        " the blocks of the model, and solved by other methods. Errors are shares of full scale,"
        ' the largest absolute reference value of each output. "Blocks as plain functions" is'
        " another kind: it calls the blocks of the model, without the text that is printed and"
        " compiled of them, at a tenth of the internal step; errors are shares of the range of"
        " each output, and the limit is 1e-4 and twice what the step changes in that"
        " integration.",
    ),
    PAPER: Words(
        "Figures of the papers",
        "figures of its paper",
        "Figures of the papers",
        "Printed: the figure in the paper. Recomputed: the same from the paper's own numbers,"
        " without this model. Model: what the simulation gives. A figure that cannot be"
        " reproduced is named with its reason; it does not fail the validation.",
    ),
    REFERENCE: Words(
        "Outputs equal the reference",
        "output = reference",
        "Reference: the outputs equal it",
        "Distance from the tube's middle: how far the output stays from what the reference takes"
        " within the time tolerance, and the reference from the output. The other figures say"
        " what a difference looks like. The last of each output is what changes when the same"
        " run has communication steps of half the size.",
    ),
    FILES: Words(
        "Files are as FMI has them",
        "files",
        "Files: as FMI has them",
        "Numbers of faults. Nothing was loaded or run: what the code does, whether it starts, and"
        " whether its outputs are right is not known.",
    ),
}
FAILED = "Outside their limits"
COUNTS = "Figures that pass"
PLACE = ("actuator", "variant", "case", "quantity")
FIGURE = ("", *PLACE, "run", "value", "limit", "used", "note")
PRINTED = ("", *PLACE, "printed", "recomputed", "model", "within", "note")
DIGITS = 7  # enough for every coefficient that the papers print
MARKERS = "os^D"


class RowDocument(Document, frozen=True):
    """A measured figure: ``limit`` is the largest value that passes or, for a paper, the largest
    distance from ``printed``.  ``passed`` is null where nothing is judged."""

    claim: Annotated[str, choice(*CLAIMS)]
    actuator: str
    variant: str
    case: str
    quantity: str
    value: Figure
    limit: Figure
    unit: Annotated[str, about("Of the figures; 1 for a pure number.")]
    passed: bool | None
    note: str
    printed: Figure
    recomputed: Annotated[Figure, about("From the paper's own numbers, without this model.")]
    subject: Annotated[str, about("FMU that was run, empty for the simulation.")]
    verdict: str


class ValidationDocument(Document, frozen=True):
    """Figures beside their limits, and what accuracy costs."""

    title: ClassVar[str] = "servo-models validate --format json"

    passed: bool
    conditions: dict[str, str]
    rows: list[RowDocument]
    cost: list[CostCurve]


@document_of.register(Validation)
def _document(validation: Validation) -> ValidationDocument:
    """Return what JSON is made of: the same figures, the same document.

    A figure of a row that is not finite is None; times of the rows are left out.
    """
    names = ("value", "limit", "printed", "recomputed")
    rows = [
        RowDocument.made_from(row, **{name: finite(getattr(row, name)) for name in names})
        for row in validation.rows
    ]
    return ValidationDocument.made_from(validation, rows=rows)


@report_of.register(Validation)
def report(validation: Validation, date: str = "", every: bool = False) -> Report:
    """Return all figures; unless ``every`` one is asked for, a terminal prints only the figure of
    each case nearest to its limit."""
    examined = dict.fromkeys(row.actuator for row in validation.rows)
    how = "by files alone" if validation.claims == (FILES,) else "against references"
    return Report(
        f"{', '.join(examined) or 'nothing'} {how}",
        sentence(validation),
        validation.passed if any(row.passed is not None for row in validation.rows) else None,
        cards=cards(validation),
        remarks=remarks(validation),
        sections=(
            faults(validation),
            curves(validation.compared),
            notes(validation),
            _failures(validation),
            _counts(validation),
            *(_claim(claim, validation.of(claim), every) for claim in validation.claims),
            *(
                section
                for folder, module in offered("pictures").items()
                if examined.keys() & {*getattr(module, "ACTUATORS", (folder,))}
                for section in module.SECTIONS
            ),
            _cost(validation.cost),
            Section("Conditions", facts=tuple(validation.conditions.items()), folded=True),
        ),
        date=date,
    )


@page_of.register(Validation)
def _page(validation: Validation, date: str = "") -> Report:
    """The report with a panel, whose references take some seconds."""
    told, live = report(validation, date), panel(validation)
    return with_panel(told, live) if live else told


def summary(validation: Validation) -> Report:
    """Return the verdict, how many figures of each actuator pass, and what failed."""
    parts = (faults, _counts, _failures, notes)
    return Report(sentence(validation), "", sections=tuple(part(validation) for part in parts))


def sentence(validation: Validation) -> str:
    """Return the verdict in one sentence."""
    judged = sum(row.passed is not None for row in validation.rows)
    if not judged:
        return "Nothing was judged."
    if failed := len(validation.failures):
        return f"FAILED: {failed} of {judged} figures are outside their limits."
    return f"PASSED: all {judged} figures are within their limits."


def remarks(validation: Validation) -> tuple[str, ...]:
    """Return what the verdict leaves open: figures without a match, claims not examined."""
    unmatched = sum(row.passed is None for row in validation.of(PAPER))
    figures = plural(unmatched, "printed figure")
    told = [f"{figures} cannot be reproduced; the reasons are given."] if unmatched else []
    missing = [it for it in validation.claims if validation.rows and not validation.of(it)]
    return (*told, *(f"Not examined: {WORDS[claim].card}." for claim in missing))


def cards(validation: Validation) -> tuple[Card, ...]:
    """Return how many figures of each claim pass."""
    made = []
    for claim in validation.claims:
        words, rows = WORDS[claim], validation.of(claim)
        text = f"{_passed(rows)} figures pass" if rows else "not examined"
        verdicts = {row.passed for row in rows}
        passed = False if False in verdicts else True if True in verdicts else None
        made.append(Card(words.card, text, passed, words.heading if rows else ""))
    return tuple(made)


def share(row: Row) -> str:
    """Return how much of its limit a row uses."""
    if row.value is None or not row.limit:
        return ""
    used = row.value / row.limit
    return f"{number(used, 2)} times" if used >= 10.0 else percent(used)


def figure(value: float | None, unit: str) -> Cell:
    """Return a measured figure as a cell."""
    return None if value is None else Quantity(value, unit)


def in_words(row: Row) -> str:
    """Return a figure and its limit or reference in one line of text."""
    if row.claim == PAPER:
        printed, recomputed = row.printed, row.recomputed
        given = {"printed": printed, "recomputed": recomputed, "within": row.limit}
        held = ", ".join(f"{name} {_plain(v, row)}" for name, v in given.items() if v is not None)
    else:
        held = "" if row.limit is None else f"<= {_plain(row.limit, row)}"
    note = f"; {row.note}" if row.note else ""
    return f"{row.verdict}: {_plain(row.value, row)} {held}".rstrip() + note


def _plain(value: float | None, row: Row) -> str:
    return "none" if value is None else with_unit(f"{value:.5g}", row.unit)


def _failures(validation: Validation) -> Section:
    rows = tuple(
        (
            row.actuator,
            row.variant,
            f"{row.case}, {row.subject}" if row.subject else row.case,
            row.quantity,
            figure(row.value, row.unit),
            figure(row.limit, row.unit),
            row.note,
        )
        for row in validation.failures
    )
    heads = (_what(validation), *PLACE[1:], "value", "limit", "note")
    return Section(FAILED, tables=(Table("", heads, rows),))


def _counts(validation: Validation) -> Section:
    names = dict.fromkeys(row.actuator for row in validation.rows)
    rows = tuple(
        (name, *(_count(validation.of(claim), name) for claim in validation.claims))
        for name in names
    )
    heads = (_what(validation), *(WORDS[claim].counted for claim in validation.claims))
    return Section(COUNTS, tables=(Table("", heads, rows),))


def _what(validation: Validation) -> str:
    """Heading of a column of names."""
    return "actuator" if OWN_CLAIMS[0] in validation.claims else "model"


def _count(rows: Sequence[Row], actuator: str) -> str:
    its = [row for row in rows if row.actuator == actuator]
    named = sum(row.passed is None and row.claim == PAPER for row in its)
    passed = _passed(its) if any(row.passed is not None for row in its) else ""
    return ", ".join(filter(None, [passed, f"{named} not reproducible" if named else ""]))


def _passed(rows: Iterable[Row]) -> str:
    judged = [row for row in rows if row.passed is not None]
    return f"{sum(bool(row.passed) for row in judged)} of {len(judged)}"


def _claim(claim: str, rows: Sequence[Row], every: bool) -> Section:
    *_, heading, lead = WORDS[claim]
    if claim == PAPER:
        table = Table("", PRINTED, tuple(map(_printed, rows)))
        return Section(heading, lead, tables=(table,), folded=True)
    cases: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        cases.setdefault((row.actuator, row.variant, row.case, row.subject), []).append(row)
    title = f"{heading}; of each case the figure nearest to its limit"
    nearest = Table(title, FIGURE, tuple(map(_nearest, cases.values())), folded=every)
    figures = tuple(map(_measured, rows))
    all_ = Table(f"{heading}; all {len(rows)} figures", FIGURE, figures, folded=not every)
    return Section(heading, lead, tables=(nearest, all_), folded=True)


def _nearest(rows: Sequence[Row]) -> tuple[Cell, ...]:
    """The figure of a case that is nearest to its limit, and how many of them pass."""
    note = f"{_passed(rows)} figures pass" if len(rows) > 1 else ""
    worst = tightest(rows)
    return (*_measured(worst)[:-1], note or (worst.note if worst.passed is False else ""))


def _measured(row: Row) -> tuple[Cell, ...]:
    """A row under ``FIGURE``."""
    return (
        *_place(row),
        row.subject or "simulation",
        figure(row.value, row.unit),
        figure(row.limit, row.unit),
        share(row),
        row.note,
    )


def _printed(row: Row) -> tuple[Cell, ...]:
    """A row under ``PRINTED``; it keeps the digits of its paper."""
    figures = (row.printed, row.recomputed, row.value, row.limit)
    cells = (None if v is None else Quantity(v, row.unit, digits=DIGITS) for v in figures)
    return (*_place(row), *cells, row.note)


def _place(row: Row) -> tuple[Cell, ...]:
    return Mark(row.verdict, row.passed), row.actuator, row.variant, row.case, row.quantity


def _cost(curves: Iterable[CostCurve]) -> Section:
    pictures = tuple(
        Picture(
            f"{curve.actuator}, {curve.variant}: {curve.case}",
            partial(_draw_cost, curve),
            f"Default internal step {number(1e6 * curve.default_step)} µs.",
            rows=2,
            height=4.2,
            shared=True,
        )
        for curve in curves
    )
    return Section(
        "Error against step size, and its cost",
        "Above: the largest error of each output as a share of its full scale. Below: seconds"
        " of computing per second simulated. Dashed: the default internal step.",
        pictures=pictures,
        folded=True,
    )


def _draw_cost(curve: CostCurve, panels: Sequence[Axes]) -> None:
    error, cost = panels
    steps = [point.internal_step * 1e6 for point in curve.points]
    for series, mark, output in zip(SERIES, MARKERS, curve.points[0].error):
        values = [point.error[output] for point in curve.points]
        error.loglog(steps, values, f"{mark}-", color=colour(series), ms=4.5, label=output)
    error.legend(loc="best", frameon=False)
    cost.loglog(steps, [p.seconds for p in curve.points], "o-", color=colour("ink"), ms=4.5)
    for axes in panels:
        axes.axvline(curve.default_step * 1e6, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
        low, high = (math.log10(end) for end in axes.dataLim.intervaly)
        # whole powers of ten around both ends, so that an axis has numbers on it
        axes.set_ylim(10.0 ** math.floor(low), 10.0 ** math.ceil(high))
        axes.minorticks_off()
    error.set_ylabel("error / full scale")
    cost.set(xlabel="internal step [µs]", ylabel="cost [s/s]")
    cost.set_xticks(steps, [f"{step:g}" for step in steps])
