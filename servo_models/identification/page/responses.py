"""Section: measured and simulated responses, held-out stretches shaded, and their errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.statistics import memory
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.identification.page.readings import (
    BUCKETS,
    Reading,
    drawn,
    envelope,
    in_unit,
    not_drawn,
    shade_held_out,
    unit_of,
    words,
)
from servo_models.identification.result import Accuracy, Identification
from servo_models.report.parts import Line, Section, Table, number
from servo_models.report.style import Picture, colour, drawing, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes


TITLE = "Responses"
CAPTION = "RMS error of every output in every part of every log"
COLUMNS = ("log", "output", "part", "samples", "before", "after", "fit [%]", "unit")
NUMBERS = ("samples", "before", "after", "fit [%]")
ZOOM = 8
"""Width of the zoomed panel, in times over which errors hang together ..."""
LARGEST, FEWEST = 0.1, 60
"""... at most that share of the log, at least so many samples."""
DASHED = (0, (4, 3))
WIDE_LABELS = 44
"""Characters of names of curves that fit on a line above a panel."""
ROOM = 0.15
"""Space above and below the measured and the judged curve, as a part of their range."""

Units = Mapping[tuple[str, str], tuple[str, float]]
"""Unit and its size in SI, by log and output."""
Style = tuple[str, Any, float, float]
MEASURED: Style = ("muted", "-", 3.0, 0.55)
NOMINAL: Style = ("orange", "--", 1.1, 1.0)
BETWEEN: Style = ("green", (0, (1, 1.2)), 1.3, 1.0)
JUDGED: Style = ("blue", "-", 1.1, 1.0)
"""Colour, dash, width and opacity of a curve."""


def section(found: Identification) -> Section:
    """Return the table of errors and a picture for each log and output."""
    shown = drawn(found)
    left = not_drawn(found.logs)
    return Section(
        "responses",
        TITLE,
        "RMS errors of the nominal and of the fitted model, in the numbers of the log. Fit: share"
        f" of the measured movement that the fitted model explains. {left}".strip(),
        (accuracy_table(CAPTION, found.accuracy, units_of(found.logs)),),
        tuple(_picture(reading, f"response-{i}") for i, reading in enumerate(shown)),
    )


def units_of(logs: Iterable[Log]) -> Units:
    """Return those of the numbers in the logs."""
    return {(log.name, output): unit_of(log, output) for log in logs for output in log.outputs}


def accuracy_table(caption: str, rows: Iterable[Accuracy], units: Units) -> Table:
    """Return errors by log, output and part."""
    lines = tuple(_line(row, *units[row.log, row.output]) for row in rows)
    return Table(caption, COLUMNS, lines, NUMBERS)


def _line(row: Accuracy, unit: str, scale: float) -> Line:
    figures = (number(row.before / scale), number(row.after / scale), number(row.fit, 5))
    return Line((row.log, words(row.output), row.part, f"{row.samples}", *figures, unit))


def _picture(reading: Reading, name: str) -> Picture:
    held = reading.log.held_out
    worst = worst_sample(reading.error, held if held.any() else ~held)
    window = stretch(reading.error, worst)
    times = reading.log.stamps
    with drawing(name, rows=2, height=4.6, shared=False) as (figure, (whole, zoom)):
        draw_responses(whole, reading, slice(None))
        draw_frame(whole, times[window])
        draw_legend(whole, 1 + len(reading.simulated))
        draw_responses(zoom, reading, window)
        zoom.axvline(times[worst], color=colour("muted"), lw=0.8, ls=DASHED)
        zoom.set_xlabel("time [s]")
        shaded = " Shaded: held out." if held.any() else ""
        error = in_unit(abs(reading.error[worst]), reading.unit)
        return picture(
            figure,
            name,
            reading.title,
            f"Below: around the largest error of the fitted model, {error}"
            f" at {times[worst]:.6g} s.{shaded}",
        )


def worst_sample(errors: Array, judged: Mask) -> int:
    """Return the sample with the largest error, of those that are judged."""
    return int(np.argmax(np.where(judged, np.abs(errors), -1.0)))


def stretch(errors: Array, worst: int) -> slice:
    """Return the samples around one that a zoomed panel shows."""
    n = len(errors)
    half = max(min(ZOOM * memory(errors), int(LARGEST * n)), FEWEST) // 2
    first = min(max(worst - half, 0), max(n - 2 * half, 0))
    return slice(first, min(first + 2 * half, n))


def draw_responses(axes: Axes, reading: Reading, part: slice) -> None:
    """Draw measured broad and grey, the judged model on top; shaded where held out."""
    measured = reading.measured[part]
    simulated = {name: values[part] for name, values in reading.simulated.items()}
    draw_curve(axes, reading.log.stamps[part], measured, "measured", MEASURED)
    draw_models(axes, reading.log, part, simulated)
    axes.set_ylim(*_limits(np.concatenate([measured, list(simulated.values())[-1]])))
    axes.set_ylabel(f"{words(reading.output)}\n[{reading.unit}]", parse_math=False)


def draw_models(axes: Axes, log: Log, part: slice, curves: Mapping[str, Array]) -> None:
    """Draw a curve for each model, nominal dashed and first, the judged one solid and last."""
    times = log.stamps[part]
    shade_held_out(axes, log, part)
    styles = [NOMINAL, *[BETWEEN] * (len(curves) - 2), JUDGED][: len(curves)]
    for (name, values), style in zip(curves.items(), styles):
        draw_curve(axes, times, values, name, style)
    axes.set_xlim(times[0], times[-1])


def draw_curve(axes: Axes, times: Array, values: Array, name: str, style: Style) -> None:
    """Draw a curve, thinned out to what a screen shows."""
    series, dash, width, opacity = style
    curve = envelope(times, values, BUCKETS)
    axes.plot(*curve, color=colour(series), ls=dash, lw=width, alpha=opacity, label=name)


def draw_frame(axes: Axes, times: Array) -> None:
    """Frame the stretch that another panel shows."""
    axes.axvspan(times[0], times[-1], facecolor="none", edgecolor=colour("ink"), lw=0.8)


def draw_legend(axes: Axes, count: int) -> None:
    """Name ``count`` curves above a panel, in one line as wide as they need, or one below another
    where that is wider than a panel."""
    _, labels = axes.get_legend_handles_labels()
    if sum(map(len, labels)) > WIDE_LABELS:
        count = 1
    lines = -(-len(labels) // count)
    axes.set_title(" ", fontsize=8.5, pad=6.0 + 13.0 * (lines - 1))
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.06, 0.98),
        ncols=count,
        frameon=False,
        handlelength=1.4,
        handletextpad=0.4,
        columnspacing=0.8,
        fontsize=8.5,
    ).set_in_layout(False)


def _limits(values: Array) -> tuple[float, float]:
    """Range of what was measured and what the judged model says; a nominal one may leave it."""
    low, high = float(values.min()), float(values.max())
    room = ROOM * (high - low) or 1.0
    return low - room, high + room
