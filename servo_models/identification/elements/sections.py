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
from servo_models.identification.elements.estimate import Estimate
from servo_models.identification.elements.identify import ElementsResult
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
IN_CARD = 6  # parameters that the answer names; all are in the table
DASHED: dict[str, Any] = {"lw": 0.8, "ls": (0, (4, 3))}


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
    units = {name: (known[name].param.unit, display_unit(known[name])) for name in result.estimates}
    parameters = [(name, _quantity(e, *units[name])) for name, e in result.estimates.items()]
    lines = [f"{name} {value}" for name, value in parameters]
    more = [f"and {len(lines) - IN_CARD} more"] if len(lines) > IN_CARD else []
    figures = tuple(
        (f.element, f.name, _quantity(f.estimate, f.unit, f.display, True), f.file)
        for f in result.figures
    )
    margin = number(math.degrees(best.phase_margin), 3)
    loop = (
        f"{number(100.0 * best.overshoot, 3)} % overshoot, bandwidth {number(best.bandwidth)}"
        f" rad/s, phase margin {margin} deg"
    )
    best_each = [
        f"{_band(choice.band)}: {_best(choice)}, set to {choice.setting.k_f:g}"
        for choice in synthesis.choices
    ]
    text = (
        "Vertical lines: the best K_f for each band. Time constant: to 86.5 % of the step;"
        " bandwidth: to -3 dB."
    )
    picture = Picture(LOOP, partial(_draw, synthesis), rows=4, height=7.0, shared=True)
    columns = ("element", "figure", f"value {ERROR} error (95 % interval)", "file")
    tables = {
        "Loop for other K_f": _responses(synthesis),
        "Elements": Table("", columns, figures),
        PARAMETERS: Table("", ("parameter", "value"), tuple(parameters)),
    }
    report = Report(
        title=f"{model.actuator.name}, variant {model.variant}: element by element",
        sentence=f"K_f = {best.k_f:g} settles within {_band(band)} in"
        f" {number(best.settling[band], 3)} s",
        cards=(
            Card("loop", loop, section=LOOP),
            Card("best K_f", "\n".join(best_each), section=LOOP),
            Card("elements", "\n".join([*lines[:IN_CARD], *more]), section=PARAMETERS),
        ),
        remarks=(
            *(f"{note}." for note in result.notes),
            *(f"Warning: {warning}." for warning in result.warnings),
        ),
        sections=(
            Section(LOOP, text, tables=(_choices(synthesis),), pictures=(picture,)),
            *(Section(title, tables=(table,), folded=True) for title, table in tables.items()),
        ),
        date=date,
    )
    return judged(report, result.warnings)


def _best(choice: Choice) -> Quantity:
    return Quantity(choice.optimum.k_f, error=choice.relative_error * choice.optimum.k_f)


def _quantity(estimate: Estimate, unit: str, display: str, interval: bool = False) -> Quantity:
    shown = estimate.scaled(factor(unit, display or unit))
    known = interval and 0.0 < shown.standard_error < math.inf
    limits = (shown.low, shown.high) if known else None
    return Quantity(shown.value, display or unit, shown.standard_error, limits, digits=5)


def _choices(synthesis: Synthesis) -> Table:
    rows = tuple(
        (
            _band(choice.band),
            _best(choice),
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
    settling = [f"settling {_band(band)}" for band in rows[0].settling]
    columns = ("K_f", "time constant", "overshoot", "bandwidth", "phase margin", *settling, "")
    cells: list[tuple[Cell, ...]] = [
        (
            Quantity(row.k_f, digits=5),
            Quantity(row.time_constant, "s"),
            Quantity(100.0 * row.overshoot, "%", digits=3),
            Quantity(row.bandwidth, "rad/s"),
            Quantity(math.degrees(row.phase_margin), "deg", digits=3),
            *(Quantity(time, "s", digits=3) for time in row.settling.values()),
            "chosen" if row.k_f == chosen else "",
        )
        for row in rows
    ]
    return Table("", columns, tuple(cells))


def _band(share: float) -> str:
    return f"{ERROR}{100.0 * share:g} %"


def _draw(synthesis: Synthesis, axes: Sequence[Axes]) -> None:
    """Draw settling times, time constant, overshoot, bandwidth and phase margin over K_f."""
    choices, (time, swing, *_) = synthesis.choices, axes
    bands = tuple(choices[0].optimum.settling)
    ends = synthesis.rows[0].k_f, synthesis.rows[-1].k_f
    near = [choice.optimum.k_f * (1.0 + leap) for choice in choices for leap in (0.0, 1e-6)]
    grid = np.unique([*np.linspace(*ends, 400), *near])
    curve = [synthesis.loop.response(float(k_f), bands) for k_f in grid]
    for series, mark, choice in zip(SERIES[1:], "osD", choices):
        best, band = choice.optimum, choice.band
        style: dict[str, Any] = {"color": colour(series)}
        settling = [response.settling[band] for response in curve]
        time.plot(grid, settling, label=f"settled within {_band(band)}", **style)
        name = f"best for {_band(band)}: {best.k_f:.4g}, set to {choice.setting.k_f:g}"
        for panel, height in zip(axes, (best.settling[band], *_heights(best))):
            panel.axvline(best.k_f, **style, **DASHED)
            label = name if panel is swing else None
            panel.plot(best.k_f, height, mark, mfc=colour("paper"), label=label, **style)
    tau = [response.time_constant for response in curve]
    time.plot(grid, tau, color=colour("blue"), ls="--", label="time constant (86.5 %)")
    for panel, values in zip(axes[1:], zip(*map(_heights, curve))):
        panel.plot(grid, values, color=colour("blue"))
    swing.axhline(100.0 * synthesis.wish.overshoot, color=colour("muted"), **DASHED)
    time.set_ylim(0.0, 4.0 * choices[0].optimum.settling[bands[0]])
    labels = ("time [s]", "overshoot [%]", "bandwidth [rad/s]", "phase margin [deg]")
    for panel, label in zip(axes, labels):
        panel.set_ylabel(label)
    axes[-1].set(xlabel="feedback coefficient K_f", xlim=ends)
    look: dict[str, Any] = {"facecolor": colour("paper"), "edgecolor": "none", "fontsize": 8.5}
    time.legend(loc="upper right", framealpha=1.0, **look)
    swing.legend(loc="upper left", framealpha=1.0, **look)


def _heights(response: Response) -> tuple[float, float, float]:
    """What the lower panels show."""
    margin = math.degrees(response.phase_margin)
    return 100.0 * response.overshoot, response.bandwidth, margin
