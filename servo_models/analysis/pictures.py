"""Pictures of simulated responses, for a file: one panel a signal, over one time axis.

Colours and line styles are those of the report.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.characteristic import FRICTION, Characteristic
from servo_models.analysis.experiment import display
from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.linearise import linearise
from servo_models.analysis.simulate import Result, simulate
from servo_models.core.plant import Plant, Wire
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.files import write_with
from servo_models.report.curves import shade
from servo_models.report.style import SERIES, colour, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SUFFIXES = (".svg", ".png", ".pdf")
PANEL = 1.25  # height of a panel [inch]
MARGIN = 1.0  # height of title and time axis together [inch]
WIDTH = 7.0  # width of a figure [inch]
POINTS = 601  # points of a curve
LEAD = 0.04  # rest shown before time 0 over the duration of the run, so that a step is seen as one
SMALL = 1e-9  # range of a signal in full scales below which it is drawn as a straight line


def check_suffix(path: Path) -> None:
    """Raise UserError unless ``path`` names a kind of picture that we draw."""
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(
            f"'{path}' is no picture: use a name that ends in {', '.join(SUFFIXES[:-1])}"
            f" or {SUFFIXES[-1]}"
        )


def save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, PNG or PDF by the suffix of ``path``; the same figure, same bytes.

    Raises:
        UserError: another suffix, or a folder that cannot be written.
    """
    check_suffix(path)
    import matplotlib as mpl

    dates = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    metadata = dates.get(path.suffix.lower())
    with mpl.rc_context({"svg.hashsalt": "servo-models", "svg.fonttype": "none"}):
        write_with(path, lambda part: figure.savefig(part, dpi=200, metadata=metadata))


def response(result: Result) -> Figure:
    """Draw the inputs that move and all outputs; flags are shaded bands over all panels."""
    with _page(result.report().title, len(shown_signals(result))) as (figure, panels):
        draw_signals(result, panels)
        return figure


def shown_signals(result: Result) -> list[Wire]:
    """Return the inputs that move and all outputs but flags."""
    plant = result.model.plant
    moving = [wire for wire in plant.inputs if np.any(result[wire.name] != wire.rest)]
    outputs = [plant.wire[name] for name in plant.outputs]
    return [*moving, *(wire for wire in outputs if not wire.flag)]


def draw_signals(result: Result, panels: Sequence[Axes]) -> None:
    """Draw ``shown_signals`` on as many axes, or the main output on a single one."""
    plant = result.model.plant
    outputs = [plant.wire[name] for name in plant.outputs]
    shown = shown_signals(result) if len(panels) > 1 else outputs
    scale, unit = _time_scale(result.times)
    time = scale * result.times
    lead = time[0] - LEAD * (time[-1] - time[0])
    for axes, wire in zip(panels, shown):
        values, label = _display(result[wire.name], wire)
        _heading(axes, wire.name, label)
        if wire in plant.inputs:
            rest, _ = _display(np.array([float(wire.rest)]), wire)
            _input(axes, np.array([lead, *time]), np.array([*rest, *values]))
        else:
            axes.plot(time, values, color=colour("blue"))
            _room(axes, values, wire)
    for wire in (wire for wire in outputs if wire.flag and np.any(result[wire.name])):
        _shade(panels, time, result[wire.name], wire)
    _time_axis(panels[-1], lead, time[-1], unit)


def characteristic(axes: Axes, law: Characteristic) -> None:
    """Draw a signal after an effect over its input, with the signal itself where it is swept."""
    given, across = _display(law.given, law.over)
    result, up = _display(law.found, law.wire)
    name = law.wire.name.replace("_", " ")
    if law.over is law.wire:
        ends = [min(given), max(given)]
        axes.plot(ends, ends, color=colour("muted"), ls="--", lw=1.0)
        name = f"{name}, as the effect leaves it"
    elif law.wire.name != FRICTION:
        name = f"added to {name}"
    axes.plot(given, result, color=colour("orange"))
    _heading(axes, name, up)
    axes.set_xlabel(f"{law.over.name.replace('_', ' ')} [{across}]" if across else law.over.name)


def comparison(
    without: Result,
    changed: Result,
    plant: Plant,
    names: Sequence[str],
    title: str,
    label: str,
    law: Characteristic | None = None,
) -> Figure:
    """Draw one response without and with an effect, and the difference that it makes.

    Args:
        without, changed: two runs on the same grid.
        plant: whose signals they hold.
        names: the input that moves and the output to look at.
        title: of the page.
        label: says in the picture what ``changed`` has.
        law: of the effect, drawn above.
    """
    source, output = (plant.wire[name] for name in names)
    scale, unit = _time_scale(without.times)
    time = scale * without.times
    heights = (2.2, 1.0, 2.2, 1.0) if law else (1.0, 2.2, 1.0)
    with _page(title, len(heights), heights, shared=not law) as (figure, panels):
        top, middle, bottom = panels[-3:]
        if law:
            characteristic(panels[0], law)
            for axes in (top, middle):
                axes.sharex(bottom)
                axes.tick_params(labelbottom=False)
        values, shown = _display(without[source.name], source)
        _heading(top, source.name, shown)
        _input(top, time, values)
        before, shown = _display(without[output.name], output)
        after, _ = _display(changed[output.name], output)
        _heading(middle, output.name, shown)
        middle.plot(time, before, color=colour("muted"), lw=2.4, alpha=0.55)
        middle.plot(time, after, color=colour("orange"))
        middle.text(0.2, 1.03, "without", transform=middle.transAxes, color=colour("muted"), size=9)
        middle.set_title(f"with {label}", loc="right", color=colour("orange"), size=9)
        _heading(bottom, "difference", shown)
        bottom.fill_between(time, after - before, color=colour("orange"), alpha=0.25, lw=0)
        bottom.plot(time, after - before, color=colour("orange"), lw=1.0)
        _time_axis(bottom, time[0], time[-1], unit)
        return figure


def small_signals(models: Mapping[str, Model], at: Mapping[str, float] | None = None) -> Figure:
    """Draw models together: a step as simulated, and gain, phase, poles and zeros as linearised.

    Args:
        models: of one actuator, by what they are called.
        at: inputs [SI] at the working point, see ``linearise``.

    Raises:
        UserError: see ``linearise`` and ``simulate``.
    """
    first = next(iter(models.values()))
    command, size = first.step
    wires, output = first.plant.wire, first.plant.outputs[0]
    scale, unit = _time_scale(np.array([0.0, first.stop_time]))
    times = np.linspace(0.0, first.stop_time, POINTS)
    title = f"{first.actuator.name}: {output.replace('_', ' ')} over {command.replace('_', ' ')}"
    with _page(title, 4, heights=(1.8, 1.6, 1.3, 1.8), shared=False) as (figure, panels):
        step, gain, phase, plane = panels
        for (name, model), line in zip(models.items(), SERIES * len(models)):
            linear, look = linearise(model, at), {"color": colour(line), "label": name}
            values, shown = _display(simulate(model, times, {command: size})[output], wires[output])
            step.plot(scale * times, values, **look)
            frequencies = _band(linear)
            response = linear.response(frequencies, command, output)
            gain.loglog(frequencies, abs(response), **look)
            phase.semilogx(frequencies, np.degrees(np.unwrap(np.angle(response))), **look)
            poles, zeros = linear.poles_and_zeros(command, output)
            plane.plot(poles.real, poles.imag, "x", **look)
            plane.plot(zeros.real, zeros.imag, "o", mfc="none", color=colour(line))
        _heading(step, "step", shown)
        _time_axis(step, 0.0, scale * times[-1], unit)
        _heading(gain, "gain", f"{wires[output].unit} per {wires[command].unit}")
        _heading(phase, "phase", "deg")
        phase.set_xlabel("frequency [Hz]")
        _heading(plane, "poles x, zeros o", "rad/s")
        plane.set_xlabel("real part [rad/s]")
        plane.axvline(0.0, color=colour("muted"), lw=0.8)
        if len(models) > 1:
            step.legend(frameon=False, fontsize=8.5)
        return figure


def _band(linear: LinearModel) -> Array:
    """Frequencies [Hz] about the poles of a model, below half its sampling frequency."""
    rates = abs(linear.rates())
    rates = rates[rates > 1e-9 * np.max(rates, initial=0.0)]
    low, high = (rates.min(), rates.max()) if len(rates) else (1.0, 1.0)
    low, high = 0.03 * low / (2.0 * np.pi), 30.0 * high / (2.0 * np.pi)
    return np.geomspace(low, min(high, 0.5 / linear.period) if linear.period else high, POINTS)


@contextmanager
def _page(
    title: str, rows: int, heights: Sequence[float] = (), shared: bool = True
) -> Iterator[tuple[Figure, Any]]:
    """Give a titled figure with ``rows`` panels, ``heights`` in panel heights."""
    ratios = list(heights) or [1.0] * rows
    height = MARGIN + PANEL * sum(ratios)
    with drawing(rows, height, shared) as (figure, panels):
        figure.set_size_inches(WIDTH, height)
        figure.set_facecolor(colour("paper"))
        figure.suptitle(title, x=0.01, ha="left", size=11, weight="bold")
        grid: Any = panels[0].get_gridspec()
        grid.set_height_ratios(ratios)
        yield figure, panels


def _heading(axes: Axes, name: str, unit: str) -> None:
    shown = f" [{unit}]" if unit else ""
    axes.set_title(f"{name.replace('_', ' ')}{shown}", loc="left", size=9)


def _display(values: Array, wire: Wire) -> tuple[Array, str]:
    """Values in the unit that a person reads, and that unit."""
    scale, unit = display(wire)
    return scale * values, unit


def _time_scale(times: Array) -> tuple[float, str]:
    return (1e3, "ms") if times[-1] - times[0] < 1.0 else (1.0, "s")


def _input(axes: Axes, time: Array, values: Array) -> None:
    axes.plot(time, values, color=colour("muted"), drawstyle="steps-post")


def _room(axes: Axes, values: Array, wire: Wire) -> None:
    """Keep rounding errors of a signal at rest from filling its panel."""
    if np.ptp(values) <= SMALL * wire.scale:
        middle = float(values[0])
        axes.set_ylim(middle - wire.scale, middle + wire.scale)


def _shade(panels: Sequence[Axes], time: Array, flag: Array, wire: Wire) -> None:
    for axes in panels:
        shade(axes, time, flag > 0.0)
    name = wire.name.replace("_", " ")
    panels[0].set_title(f"shaded: {name}", loc="right", color=colour("muted"), size=9)


def _time_axis(axes: Axes, begin: float, end: float, unit: str) -> None:
    axes.set_xlabel(f"time [{unit}]")
    axes.set_xlim(begin, end)
