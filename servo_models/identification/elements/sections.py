"""Report of a servo identified element by element: K_f and its loop first, then the elements."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.explain import display_unit
from servo_models.identification.doubts import judged
from servo_models.identification.elements.estimate import Estimate
from servo_models.identification.elements.identify import ElementFigure, ElementsResult
from servo_models.identification.elements.loop import Choice, Response, Synthesis
from servo_models.report.numbers import ERROR, Quantity, number
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Picture, Section, Table
from servo_models.report.style import SERIES, colour
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOOP = "Closed loop over K_f"
PARAMETERS = "Parameters"
MARKS = ("o", "s", "D")  # of the choices, in their order
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
    return judged(elements_report(result, date), result.warnings)


def elements_report(result: ElementsResult, date: str = "") -> Report:
    """Return figures of the elements, parameters of the actuator, and the loop with its K_f."""
    model, synthesis = result.model, result.synthesis
    best = synthesis.choices[0]
    settled = f"{number(best.setting.settling[best.band], 3)} s"
    overshoot = f"{number(100.0 * best.setting.overshoot, 3)} %"
    parameters = tuple(_parameters(result))
    return Report(
        title=f"{model.actuator.name}, variant {model.variant}: element by element",
        sentence=f"K_f = {best.setting.k_f:g} settles within {_band(best.band)} in {settled}",
        cards=(
            Card("loop", f"{overshoot} overshoot, {_measures(best.setting)}", section=LOOP),
            Card("best K_f", "\n".join(_chosen(c) for c in synthesis.choices), section=LOOP),
            Card("elements", _summary(parameters), section=PARAMETERS),
        ),
        remarks=(
            *(f"{note}." for note in result.notes),
            *(f"Warning: {warning}." for warning in result.warnings),
        ),
        sections=(
            Section(
                LOOP,
                "Vertical lines: the best K_f for each band. Time constant: to 86.5 % of the step;"
                " bandwidth: to -3 dB.",
                tables=(_choices(synthesis),),
                pictures=(
                    Picture(LOOP, partial(_draw, synthesis), rows=4, height=7.0, shared=True),
                ),
            ),
            Section("Loop for other K_f", tables=(_responses(synthesis),), folded=True),
            Section("Elements", tables=(_figures(result.figures),), folded=True),
            Section(
                PARAMETERS, tables=(Table("", ("parameter", "value"), parameters),), folded=True
            ),
        ),
        date=date,
    )


def _measures(response: Response) -> str:
    margin = number(math.degrees(response.phase_margin), 3)
    return f"bandwidth {number(response.bandwidth)} rad/s, phase margin {margin} deg"


def _chosen(choice: Choice) -> str:
    """The choice for a band in a line."""
    best = Quantity(choice.optimum.k_f, error=choice.relative_error * choice.optimum.k_f)
    return f"{_band(choice.band)}: {best}, set to {choice.setting.k_f:g}"


def _summary(parameters: Sequence[tuple[Cell, ...]]) -> str:
    lines = [f"{name} {value}" for name, value in parameters]
    more = [f"and {len(lines) - IN_CARD} more"] if len(lines) > IN_CARD else []
    return "\n".join([*lines[:IN_CARD], *more])


def _quantity(estimate: Estimate, unit: str, display: str, interval: bool = False) -> Quantity:
    shown = estimate.scaled(factor(unit, display))
    known = interval and 0.0 < shown.standard_error < math.inf
    limits = (shown.low, shown.high) if known else None
    return Quantity(shown.value, display, shown.standard_error, limits, digits=5)


def _figures(figures: Sequence[ElementFigure]) -> Table:
    rows = tuple(
        (f.element, f.name, _quantity(f.estimate, f.unit, f.display or f.unit, True), f.file)
        for f in figures
    )
    return Table("", ("element", "figure", f"value {ERROR} error (95 % interval)", "file"), rows)


def _parameters(result: ElementsResult) -> Iterator[tuple[Cell, ...]]:
    known = result.model.plant.parameters
    for name, estimate in result.estimates.items():
        unit = known[name].param.unit
        yield name, _quantity(estimate, unit, display_unit(known[name]) or unit)


def _choices(synthesis: Synthesis) -> Table:
    rows = tuple(
        (
            _band(choice.band),
            Quantity(choice.optimum.k_f, error=choice.relative_error * choice.optimum.k_f),
            Quantity(choice.optimum.settling[choice.band], "s", digits=3),
            f"{choice.setting.k_f:g}",
            Quantity(100.0 * choice.setting.overshoot, "%", digits=3),
            Quantity(choice.setting.settling[choice.band], "s", digits=3),
        )
        for choice in synthesis.choices
    )
    limit = number(100.0 * synthesis.wish.overshoot)
    columns = ("settled within", "best K_f", "settling", "set to", "overshoot", "settling then")
    return Table(f"K_f of the shortest settling with at most {limit} % overshoot", columns, rows)


def _responses(synthesis: Synthesis) -> Table:
    rows, chosen = synthesis.rows, synthesis.choices[0].setting.k_f
    bands = tuple(rows[0].settling)
    columns = (
        "K_f",
        "time constant",
        "overshoot",
        "bandwidth",
        "phase margin",
        *(f"settling {_band(band)}" for band in bands),
        "",
    )
    cells = tuple(
        (
            Quantity(row.k_f, digits=5),
            Quantity(row.time_constant, "s"),
            Quantity(100.0 * row.overshoot, "%", digits=3),
            Quantity(row.bandwidth, "rad/s"),
            Quantity(math.degrees(row.phase_margin), "deg", digits=3),
            *(Quantity(row.settling[band], "s", digits=3) for band in bands),
            "chosen" if row.k_f == chosen else "",
        )
        for row in rows
    )
    return Table("", columns, cells)


def _band(share: float) -> str:
    return f"{ERROR}{100.0 * share:g} %"


def _draw(synthesis: Synthesis, axes: Sequence[Axes]) -> None:
    """Draw settling times, time constant, overshoot, bandwidth and phase margin over K_f."""
    time, swing, width, margin = axes
    loop, choices = synthesis.loop, synthesis.choices
    bands = tuple(choices[0].optimum.settling)
    ends = synthesis.rows[0].k_f, synthesis.rows[-1].k_f
    near = [choice.optimum.k_f * (1.0 + leap) for choice in choices for leap in (0.0, 1e-6)]
    grid = np.unique([*np.linspace(*ends, 400), *near])
    curve = [loop.response(float(k_f), bands) for k_f in grid]
    for series, band in zip(SERIES[1:], bands):
        settling = [r.settling[band] for r in curve]
        time.plot(grid, settling, color=colour(series), label=f"settled within {_band(band)}")
    tau = [r.time_constant for r in curve]
    time.plot(grid, tau, color=colour("blue"), ls="--", label="time constant (86.5 %)")
    swing.plot(grid, [100.0 * r.overshoot for r in curve], color=colour("blue"))
    width.plot(grid, [r.bandwidth for r in curve], color=colour("blue"))
    margin.plot(grid, [math.degrees(r.phase_margin) for r in curve], color=colour("blue"))
    for series, mark, choice in zip(SERIES[1:], MARKS, choices):
        _mark(axes, choice, series, mark)
    limit = 100.0 * synthesis.wish.overshoot
    swing.axhline(limit, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
    time.set(ylabel="time [s]", ylim=(0.0, 4.0 * choices[0].optimum.settling[bands[0]]))
    swing.set(ylabel="overshoot [%]")
    width.set(ylabel="bandwidth [rad/s]")
    margin.set(ylabel="phase margin [deg]", xlabel="feedback coefficient K_f", xlim=ends)
    look: dict[str, Any] = {"facecolor": colour("paper"), "edgecolor": "none", "fontsize": 8.5}
    time.legend(loc="upper right", framealpha=1.0, **look)
    swing.legend(loc="upper left", framealpha=1.0, **look)


def _mark(axes: Sequence[Axes], choice: Choice, series: str, mark: str) -> None:
    """Mark the best K_f of a band in every panel, named in the second."""
    best = choice.optimum
    heights = (
        best.settling[choice.band],
        100.0 * best.overshoot,
        best.bandwidth,
        math.degrees(best.phase_margin),
    )
    name = f"best for {_band(choice.band)}: {best.k_f:.4g}, set to {choice.setting.k_f:g}"
    for k, (panel, height) in enumerate(zip(axes, heights)):
        panel.axvline(best.k_f, color=colour(series), lw=0.8, ls=(0, (4, 3)))
        label = name if k == 1 else None
        panel.plot(best.k_f, height, mark, color=colour(series), mfc=colour("paper"), label=label)
