"""The elements of a servo and its loop as a data sheet."""

from __future__ import annotations

import math

from servo_models.analysis.explain import display_unit
from servo_models.identification.elements.identify import ElementsResult, Figure
from servo_models.identification.elements.loop import Choice, Response
from servo_models.report.sheets import Sheet, Table
from servo_models.units import factor

FIGURES = ("element", "figure", "value", "+-", "95 % interval", "unit", "file")
PARAMETERS = ("parameter", "value", "+-", "unit")


def sheet(result: ElementsResult) -> Sheet:
    """Return figures of the elements, parameters of the actuator, and the loop with its K_f."""
    model, synthesis = result.model, result.synthesis
    return Sheet(
        f"{model.actuator.name}, variant {model.variant}: element by element",
        (
            *(f"{note}." for note in result.notes),
            *(f"Warning: {warning}." for warning in result.warnings),
        ),
        (
            Table("Elements", FIGURES, tuple(map(_figure, result.figures))),
            Table("Parameters", PARAMETERS, _parameters(result)),
            _choices(synthesis.choices, synthesis.wish.overshoot),
            _responses(synthesis.rows, synthesis.choices[0]),
        ),
    )


def _figure(figure: Figure) -> tuple[str, ...]:
    unit = figure.display or figure.unit
    told = figure.estimate.scaled(factor(figure.unit, unit))
    return (
        figure.element,
        figure.name,
        f"{told.value:.5g}",
        _error(told.standard_error),
        f"{told.low:.5g} to {told.high:.5g}" if 0.0 < told.standard_error < math.inf else "",
        "" if unit == "1" else unit,
        figure.file,
    )


def _parameters(result: ElementsResult) -> tuple[tuple[str, ...], ...]:
    known = result.model.plant.parameters
    rows = []
    for name, (value, error) in result.parameters.items():
        unit = display_unit(known[name])
        scale = factor(known[name].param.unit, unit) if unit else 1.0
        rows.append((name, f"{scale * value:.5g}", _error(scale * error), unit))
    return tuple(rows)


def _error(error: float) -> str:
    return f"{error:.2g}" if error < math.inf else "not known"


def _choices(choices: tuple[Choice, ...], overshoot: float) -> Table:
    rows = tuple(
        (
            _percent(choice.band),
            f"{choice.optimum.k_f:.5g}",
            _error(choice.relative_error * choice.optimum.k_f),
            f"{choice.optimum.settling[choice.band]:.2f}",
            f"{choice.setting.k_f:g}",
            f"{100.0 * choice.setting.overshoot:.2f}",
            f"{choice.setting.settling[choice.band]:.2f}",
        )
        for choice in choices
    )
    return Table(
        f"K_f of the shortest settling with at most {100.0 * overshoot:g} % overshoot",
        (
            "settled within",
            "best K_f",
            "+-",
            "settling [s]",
            "set to",
            "overshoot %",
            "settling [s]",
        ),
        rows,
    )


def _responses(rows: tuple[Response, ...], chosen: Choice) -> Table:
    bands = tuple(rows[0].settling)

    def row(response: Response) -> tuple[str, ...]:
        return (
            f"{response.k_f:.5g}",
            f"{response.time_constant:.3f}",
            f"{100.0 * response.overshoot:.2f}",
            f"{response.bandwidth:.4g}",
            f"{math.degrees(response.phase_margin):.1f}",
            *(f"{response.settling[band]:.2f}" for band in bands),
            "chosen" if response.k_f == chosen.setting.k_f else "",
        )

    columns = (
        "K_f",
        "time constant [s]",
        "overshoot %",
        "bandwidth [rad/s]",
        "phase margin [deg]",
        *(f"settling {_percent(band)} [s]" for band in bands),
        "",
    )
    heading = "Closed loop; time constant: to 86.5 % of the step, bandwidth: to -3 dB"
    return Table(heading, columns, tuple(map(row, rows)))


def _percent(share: float) -> str:
    return f"+-{100.0 * share:g} %"
