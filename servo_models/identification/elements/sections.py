"""Report of a servo identified element by element: K_f and its loop first, then the elements."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.explain import display_unit
from servo_models.identification.doubts import judged
from servo_models.identification.elements.estimate import Interval
from servo_models.identification.elements.identify import ElementsResult
from servo_models.identification.elements.loop import Choice, Synthesis
from servo_models.report.curves import DASHED
from servo_models.report.numbers import ERROR, Quantity, number
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Picture, Section, Table
from servo_models.report.style import SERIES, colour
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOOP = "Closed loop over K_f"
PARAMETERS = "Parameters"
IN_CARD = 6  # parameters that the answer names; all are in the table


@document_of.register(ElementsResult)
def _document(result: ElementsResult) -> dict[str, Any]:
    return {
        "figures": [asdict(figure) for figure in result.figures],
        "parameters": {name: asdict(estimate) for name, estimate in result.estimates.items()},
        "choices": [asdict(choice) for choice in result.synthesis.choices],
        "responses": [asdict(row) for row in result.synthesis.rows],
        "notes": list(result.notes),
        "warnings": list(result.warnings),
        "files": dict(result.files),
    }


@report_of.register(ElementsResult)
def _report(result: ElementsResult, date: str = "") -> Report:
    """Return figures of the elements, parameters of the actuator, and the loop with its K_f."""
    model, synthesis, known = result.model, result.synthesis, result.model.plant.parameters
    band, best = synthesis.choices[0].band, synthesis.choices[0].setting
    parameters = tuple(
        (name, _quantity(estimate, known[name].param.unit, display_unit(known[name])))
        for name, estimate in result.estimates.items()
    )
    lines = [f"{name} {value}" for name, value in parameters]
    more = [f"and {len(lines) - IN_CARD} more"] if len(lines) > IN_CARD else []
    figures = tuple(
        (f.element, f.name, _quantity(f.estimate, f.unit, f.display, True), f.file)
        for f in result.figures
    )
    loop = (
        f"{number(100.0 * best.overshoot, 3)} % overshoot, bandwidth {number(best.bandwidth)}"
        f" rad/s, phase margin {number(math.degrees(best.phase_margin), 3)} deg"
    )
    text = (
        "Vertical lines: K_f of the shortest settling into each band, with at most"
        f" {number(100.0 * synthesis.wish.overshoot)} % overshoot. Time constant: to 86.5 % of the"
        " step."
    )
    picture = Picture(LOOP, partial(_draw, synthesis), text, rows=2, height=5.0, shared=True)
    columns = ("element", "figure", f"value {ERROR} error (95 % interval)", "file")
    tables = {
        "Elements": Table("", columns, figures),
        PARAMETERS: Table("", ("parameter", "value"), parameters),
    }
    report = Report(
        title=f"{model.actuator.name}, variant {model.variant}: element by element",
        sentence=f"K_f = {best.k_f:g} settles within {_band(band)} in"
        f" {number(best.settling[band], 3)} s",
        cards=(
            Card("loop", loop, section=LOOP),
            Card("best K_f", "\n".join(map(_best, synthesis.choices)), section=LOOP),
            Card("elements", "\n".join([*lines[:IN_CARD], *more]), section=PARAMETERS),
        ),
        remarks=(
            *(f"{note}." for note in result.notes),
            *(f"Warning: {warning}." for warning in result.warnings),
        ),
        sections=(
            Section(LOOP, tables=(_responses(synthesis),), pictures=(picture,)),
            *(Section(title, tables=(table,), folded=True) for title, table in tables.items()),
        ),
        date=date,
    )
    return judged(report, result.warnings)


def _best(choice: Choice) -> str:
    best = choice.optimum.k_f
    known = Quantity(best, error=choice.relative_error * best)
    return f"{_band(choice.band)}: {known}, set to {choice.setting.k_f:g}"


def _quantity(estimate: Interval, unit: str, display: str, interval: bool = False) -> Quantity:
    shown = estimate.scaled(factor(unit, display or unit))
    known = interval and 0.0 < shown.standard_error < math.inf
    limits = (shown.low, shown.high) if known else None
    return Quantity(shown.value, display or unit, shown.standard_error, limits, digits=5)


def _responses(synthesis: Synthesis) -> Table:
    chosen = synthesis.choices[0].setting.k_f
    marks = {choice.optimum.k_f: f"best for {_band(choice.band)}" for choice in synthesis.choices}
    settling = [f"settling {_band(band)}" for band in synthesis.rows[0].settling]
    columns = ("K_f", "time constant", "overshoot", "bandwidth", "phase margin", *settling, "")
    rows: list[tuple[Cell, ...]] = [
        (
            Quantity(row.k_f, digits=5),
            Quantity(row.time_constant, "s"),
            Quantity(100.0 * row.overshoot, "%", digits=3),
            Quantity(row.bandwidth, "rad/s"),
            Quantity(math.degrees(row.phase_margin), "deg", digits=3),
            *(Quantity(time, "s", digits=3) for time in row.settling.values()),
            "chosen" if row.k_f == chosen else marks.get(row.k_f, ""),
        )
        for row in synthesis.rows
    ]
    return Table("", columns, tuple(rows))


def _band(share: float) -> str:
    return f"{ERROR}{100.0 * share:g} %"


def _draw(synthesis: Synthesis, axes: Sequence[Axes]) -> None:
    """Draw settling times, time constant and overshoot over K_f, and the best K_f of each band."""
    (time, swing), choices, rows = axes, synthesis.choices, synthesis.rows
    near = [choice.optimum.k_f * beside for choice in choices for beside in (1.0, 1.0 + 1e-6)]
    grid = np.unique([*np.linspace(rows[0].k_f, rows[-1].k_f, 400), *near])
    curve = [synthesis.loop.response(float(k_f), list(rows[0].settling)) for k_f in grid]
    for series, mark, choice in zip(SERIES[1:], "osD", choices):
        best, band, style = choice.optimum, choice.band, dict[str, Any](color=colour(series))
        label = f"settled within {_band(band)}, best at {best.k_f:.4g}"
        time.plot(grid, [response.settling[band] for response in curve], label=label, **style)
        for panel, height in ((time, best.settling[band]), (swing, 100.0 * best.overshoot)):
            panel.axvline(best.k_f, lw=0.8, ls=DASHED, **style)
            panel.plot(best.k_f, height, mark, mfc=colour("paper"), **style)
    tau = [response.time_constant for response in curve]
    time.plot(grid, tau, color=colour("blue"), ls="--", label="time constant (86.5 %)")
    swing.plot(grid, [100.0 * response.overshoot for response in curve], color=colour("blue"))
    swing.axhline(100.0 * synthesis.wish.overshoot, color=colour("muted"), lw=0.8, ls=DASHED)
    time.set(ylim=(0.0, 4.0 * choices[0].setting.settling[choices[0].band]), ylabel="time [s]")
    swing.set(xlim=(grid[0], grid[-1]), xlabel="feedback coefficient K_f", ylabel="overshoot [%]")
    time.legend(loc="upper right", fontsize=8.5)
