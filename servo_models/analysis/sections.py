"""Reports of a run and of figures of merit, in the units that a person reads."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.compare import StepMetrics, step_metrics
from servo_models.analysis.experiment import display, shown
from servo_models.analysis.explain import display_unit, in_display_unit
from servo_models.analysis.figures import Figures, FrequencyFigures
from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.pictures import draw_signals, shown_signals
from servo_models.analysis.simulate import Result
from servo_models.core.plant import Wire
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.report.numbers import Quantity
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Cell, Picture, Section, Table
from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes


DEFINITIONS = (
    "Bandwidth: where the gain first is 3 dB below the static one. Equivalent delay: of the pure"
    " delay with the same phase lag at a quarter of the bandwidth. Slew rate: mean from 10 % to"
    " 90 % of the standard step. Under large commands gain and phase are those of the"
    " fundamental (describing function)."
)
SWING = math.radians(60.0)
SPAN = 30.0  # highest frequency of a Bode plot over the bandwidth, and bandwidth over the lowest
FINE = 300  # points of a Bode plot


@report_of.register(Result)
def run_report(result: Result, date: str = "") -> Report:
    """Return the signals of a run in figures and as a picture; for a step also its measures."""
    chosen = result.model
    wires = [chosen.plant.wire[name] for name in (*result.inputs, *result.outputs)]
    signals = Table(
        "Signals",
        ("signal", "first", "last", "least", "largest", "unit"),
        tuple(_range(wire, result[wire.name]) for wire in wires),
    )
    main = chosen.plant.wire[chosen.plant.outputs[0]]
    shown = shown_signals(result)
    is_step = all(np.ptp(values) == 0.0 for values in result.inputs.values())
    tables = [signals]
    if is_step and len(result.times) > 1:
        metrics = step_metrics(result.times, result[main.name])
        tables.append(step_table(main, metrics, f"Step response of {main.name}"))
    picture = Picture(
        "Response",
        partial(draw_signals, result),
        rows=len(shown),
        height=1.2 * len(shown) + 0.5,
        shared=True,
    )
    end = f"{len(result.times)} points, {result.times[0]:g} to {result.times[-1]:g} s"
    return Report(
        f"{chosen.actuator.name}, variant {chosen.variant}: {end}",
        "",
        remarks=(*_origin(chosen), *(f"Warning: {text}." for text in result.warnings)),
        sections=(Section("", tables=tuple(tables), pictures=(picture,)),),
        date=date,
    )


@document_of.register(Result)
def _run_document(result: Result) -> dict[str, Any]:
    return {
        "actuator": result.model.actuator.name,
        "variant": result.model.variant,
        "times": result.times,
        "inputs": result.inputs,
        "outputs": result.outputs,
        "warnings": result.warnings,
    }


def _origin(model: Model) -> tuple[str, ...]:
    """What a user of the model's values should know."""
    texts = {"Warning": model.warning, "Parameters changed by": model.provenance}
    return tuple(f"{key}: {text}." for key, text in texts.items() if text)


def _range(wire: Wire, values: Array) -> tuple[Cell, ...]:
    scale, unit = display(wire)
    figures = (values[0], values[-1], values.min(), values.max())
    return (wire.name, *(Quantity(scale * float(figure), digits=6) for figure in figures), unit)


def step_table(wire: Wire, metrics: StepMetrics, title: str) -> Table:
    """Return the measures of a step response [SI] in the unit that a person reads."""
    scale, unit = display(wire)
    share = None if metrics.overshoot is None else 100.0 * metrics.overshoot
    rows = (
        ("final value, the last one", scale * metrics.final, unit),
        ("delay to 50 %", metrics.delay, "s"),
        ("rise from 10 % to 90 %", metrics.rise, "s"),
        ("overshoot", share, "%"),
        ("settling to ±5 %", metrics.settling_5, "s"),
        ("settling to ±2 %", metrics.settling_2, "s"),
    )
    cells = tuple((name, _reached(figure, unit, 4)) for name, figure, unit in rows)
    return Table(title, ("measure", "value"), cells)


def _reached(value: float | None, unit: str, digits: int = 5) -> Quantity | str:
    return "not reached" if value is None else Quantity(value, unit, digits=digits)


@document_of.register(Figures)
def _document(figures: Figures) -> dict[str, Any]:
    model, wires, linear = figures.model, figures.model.plant.wire, figures.linear
    return {
        "actuator": model.actuator.name,
        "variant": model.variant,
        "provenance": model.provenance,
        "input": {"name": figures.input, "unit": wires[figures.input].unit},
        "output": {"name": figures.output, "unit": wires[figures.output].unit},
        "at": dict(figures.at),
        "amplitude": figures.amplitude,
        "slew_rate": figures.slew_rate,
        "small_signals": asdict(figures.small) if figures.small else None,
        "at_amplitude": asdict(figures.large) if figures.large else None,
        "missing": list(figures.missing),
        "step": asdict(figures.step),
        "state_space": linear and _matrices(linear),
        "parameters": dict(model.values),
    }


def _matrices(linear: LinearModel) -> dict[str, Any]:
    return {
        **{name: matrix.tolist() for name, matrix in zip("ABCD", linear.matrices())},
        "states": list(linear.states),
        "inputs": list(linear.inputs),
        "outputs": list(linear.outputs),
        "delays": dict(linear.delays),
        "period": linear.period,
        "left_out": dict(linear.left_out),
        "point": dict(linear.point),
    }


@report_of.register(Figures)
def _report(figures: Figures, date: str = "") -> Report:
    """Return figures of merit, and the state space that they are computed from."""
    model, linear = figures.model, figures.linear
    wire = model.plant.wire[figures.output]
    merits = Table(
        "Figures of merit", ("figure", "small signals", _size(figures)), tuple(_rows(figures))
    )
    step = step_table(wire, figures.step, f"Step of {_size(figures)}")
    values = (f"{it} = {shown(model.plant.wire[it], figures.at[it], 5)}" for it in figures.at)
    where = ", ".join(values)
    return Report(
        f"{model.actuator.name}, variant {model.variant}: {figures.input} to {figures.output}",
        _sentence(figures),
        remarks=(
            *_origin(model),
            f"Working point: {where or 'inputs at rest'}.",
            DEFINITIONS,
            *(f"{why[0].upper()}{why[1:]}." for why in figures.missing),
        ),
        sections=(
            Section(
                "Response",
                tables=(merits, step),
                pictures=(_bode(figures, linear),) if linear and figures.small else (),
            ),
            Section(
                "State space",
                tables=(*_state_space(linear), _left_out(figures, linear)) if linear else (),
                folded=True,
            ),
        ),
        date=date,
    )


def _sentence(measured: Figures) -> str:
    """Bandwidth and slew rate, the two most wanted figures."""
    scale, unit = display(measured.model.plant.wire[measured.output])
    slew = measured.slew_rate and scale * measured.slew_rate
    size, figures = (
        (_size(measured), measured.large) if measured.large else ("small signals", measured.small)
    )
    bandwidth = _reached(figures.bandwidth, "Hz", 3) if figures else "unknown"
    return f"Bandwidth {bandwidth} at {size}, slew rate {_reached(slew, f'{unit}/s', 3)}"


def _size(figures: Figures) -> str:
    return f"±{shown(figures.model.plant.wire[figures.input], figures.amplitude, 5)}"


def _rows(figures: Figures) -> Iterator[tuple[Cell, ...]]:
    """Figures of small signals and of commands of the given size, side by side."""
    wires = figures.model.plant.wire
    (into, per), (out, unit) = display(wires[figures.input]), display(wires[figures.output])
    gain = (out / into, f"{unit}/{per}" if per else unit)
    small = _of_response(figures.small, *gain) if figures.small else []
    large = _of_response(figures.large, *gain) if figures.large else []
    for left, right in itertools.zip_longest(small, large, fillvalue=("", "")):
        yield left[0] or right[0], left[1], right[1]
    yield "slew rate", "", _reached(figures.slew_rate and out * figures.slew_rate, f"{unit}/s")
    if wires[figures.output].unit == "rad":
        yield "slew time", "", _reached(figures.slew_rate and SWING / figures.slew_rate, "s/60 deg")


def _of_response(
    figures: FrequencyFigures, scale: float, unit: str
) -> list[tuple[str, Quantity | str]]:
    """Name and value of every figure."""
    rows = [
        ("static gain", Quantity(scale * figures.static_gain, unit, digits=5)),
        ("bandwidth (-3 dB)", _reached(figures.bandwidth, "Hz")),
        ("phase lag of 90 deg", _reached(figures.phase_90, "Hz")),
        ("equivalent delay", _reached(figures.delay and 1e3 * figures.delay, "ms")),
    ]
    for point in figures.points:
        at = f"at {point.frequency:g} Hz"
        gain = Quantity(_decibel(point.gain), "dB", digits=5)
        rows.append((f"gain {at}, over the static one", gain))
        rows.append((f"phase lag {at}", Quantity(math.degrees(point.lag), "deg", digits=5)))
    return rows


def _decibel(gain: float) -> float:
    return 20.0 * math.log10(gain) if gain > 0.0 else -math.inf


def _state_space(linear: LinearModel) -> Iterator[Table]:
    a, b, c, d = linear.matrices()
    columns = ("", *linear.states, *linear.inputs)
    what = f"states {1e3 * linear.period:g} ms later" if linear.period else "derivatives of states"
    for title, names, rows in (
        (f"A and B: {what}, in SI", linear.states, np.hstack([a, b])),
        ("C and D: outputs, in SI", linear.outputs, np.hstack([c, d])),
    ):
        cells = ((Quantity(value, digits=7) for value in row) for row in rows.tolist())
        yield Table(title, columns, tuple((name, *row) for name, row in zip(names, cells)))


def _left_out(figures: Figures, linear: LinearModel) -> Table:
    """What A, B, C, D do not hold."""
    reasons = {name: "counted exactly in the small signals" for name in linear.delays}
    reasons |= linear.left_out
    rows = tuple((name, _settings(figures.model, name), why) for name, why in reasons.items())
    return Table("Not in A, B, C, D", ("effect", "", ""), rows)


def _settings(model: Model, effect: str) -> str:
    return ", ".join(
        f"{p.name} = {in_display_unit(model.values[p.name], p)} {display_unit(p)}".rstrip()
        for p in model.plant.parameters.values()
        if p.owner == effect
    )


def _bode(figures: Figures, linear: LinearModel) -> Picture:
    return Picture(
        "Gain over the static one, and phase",
        partial(_draw_bode, figures, linear),
        f"Line: small signals. Circles: {_size(figures)}, at the frequencies asked for.",
        rows=2,
        height=4.2,
        shared=True,
    )


def _draw_bode(figures: Figures, linear: LinearModel, panels: Sequence[Axes]) -> None:
    """The linear model as a line, the whole model as circles where it was measured."""
    small, large = figures.small, figures.large
    assert small
    middle = small.bandwidth or small.phase_90 or 1.0 / (2.0 * math.pi * linear.slowest())
    top = min(SPAN * middle, 0.49 / linear.period if linear.period else math.inf)
    hertz = np.geomspace(middle / SPAN, top, FINE)
    ratio = linear.response(hertz, figures.input, figures.output) / small.static_gain
    phase = np.degrees(np.unwrap(np.angle(ratio)))
    lines = (20.0 * np.log10(np.abs(ratio)), phase)
    points = large.points if large else ()
    measured = ([_decibel(p.gain) for p in points], [-math.degrees(p.lag) for p in points])
    for axes, line, marks, label in zip(panels, lines, measured, ("gain [dB]", "phase [deg]")):
        axes.plot(hertz, line, color=colour("blue"))
        axes.plot([p.frequency for p in points], marks, "o", color=colour("ink"), mfc="none")
        axes.set(xscale="log", ylabel=label)
    panels[-1].set_xlabel("frequency [Hz]")
