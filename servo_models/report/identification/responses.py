"""Section: measured and simulated responses, held-out stretches shaded, and their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from servo_models.identification.covariance import memory
from servo_models.identification.result import Accuracy, Identification
from servo_models.recording import Mask
from servo_models.report.identification.readings import (
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
from servo_models.report.parts import Line, Section, Table, number
from servo_models.report.style import Picture, colour, drawing, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

TITLE = "Responses"
COLUMNS = ("log", "output", "part", "samples", "before", "after", "fit [%]", "unit")
NUMBERS = ("samples", "before", "after", "fit [%]")
ZOOM = 8
"""Width of the zoomed panel, in times over which errors hang together ..."""
LARGEST, FEWEST = 0.1, 60
"""... at most that share of the log, at least so many samples."""
ROOM = 0.15
"""Space above and below the measured and the judged curve, as a part of their range."""

Style = tuple[str, Any, float, float]
MEASURED: Style = ("muted", "-", 3.0, 0.55)
NOMINAL: Style = ("orange", "--", 1.1, 1.0)
BETWEEN: Style = ("green", (0, (1, 1.2)), 1.3, 1.0)
JUDGED: Style = ("blue", "-", 1.1, 1.0)
"""Colour, dash, width and opacity of a curve."""


def section(found: Identification) -> Section:
    """Return the table of errors and a picture for each log and output."""
    units = {
        (log.name, output): unit_of(log, output) for log in found.logs for output in log.outputs
    }
    lines = tuple(_line(row, *units[row.log, row.output]) for row in found.accuracy)
    shown = drawn(found)
    left = not_drawn(found.logs)
    return Section(
        "responses",
        TITLE,
        "RMS errors of the nominal and of the fitted model, in the numbers of the log. Fit: share"
        f" of the measured movement that the fitted model explains. {left}".strip(),
        (Table("RMS error of every output in every part of every log", COLUMNS, lines, NUMBERS),),
        tuple(_picture(reading, f"response-{i}") for i, reading in enumerate(shown)),
    )


def _line(row: Accuracy, unit: str, scale: float) -> Line:
    figures = (number(row.before / scale), number(row.after / scale), number(row.fit, 5))
    return Line((row.log, words(row.output), row.part, f"{row.samples}", *figures, unit))


def _picture(reading: Reading, name: str) -> Picture:
    """Zoomed at the worst sample of those held out, if there are any."""
    held = reading.log.held_out
    return response(reading, name, "fitted", held if held.any() else ~held)


def response(reading: Reading, name: str, missed: str, judged: Mask) -> Picture:
    """Return a response as a whole, and around the sample that a model misses most.

    Args:
        reading: measured and simulated.
        name: keeps the ids of the drawing unique on the page.
        missed: name of the model whose largest error is shown.
        judged: samples among which it is sought, shape (n,).
    """
    errors = reading.simulated[missed] - reading.measured
    worst = int(np.argmax(np.where(judged, np.abs(errors), -1.0)))
    window = _window(errors, worst)
    times = reading.log.times
    with drawing(name, rows=2, height=4.6, shared=False) as (figure, (whole, zoom)):
        _curves(whole, reading, slice(None))
        whole.axvspan(
            times[window.start],
            times[window.stop - 1],
            facecolor="none",
            edgecolor=colour("ink"),
            lw=0.8,
        )
        whole.legend(
            loc="lower left",
            bbox_to_anchor=(-0.02, 0.98),
            ncols=1 + len(reading.simulated),
            frameon=False,
            columnspacing=1.2,
        )
        _curves(zoom, reading, window)
        zoom.axvline(times[worst], color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
        zoom.set_xlabel("time [s]")
        shaded = " Shaded: held out." if reading.log.held_out.any() else ""
        error = in_unit(abs(errors[worst]), reading.unit)
        return picture(
            figure,
            name,
            reading.title,
            f"Below: around the largest error of the {missed} model, {error}"
            f" at {times[worst]:.6g} s.{shaded}",
        )


def _window(errors: Array, worst: int) -> slice:
    n = len(errors)
    half = max(min(ZOOM * memory(errors), int(LARGEST * n)), FEWEST) // 2
    first = min(max(worst - half, 0), max(n - 2 * half, 0))
    return slice(first, min(first + 2 * half, n))


def _curves(axes: Axes, reading: Reading, part: slice) -> None:
    """Measured broad and grey, nominal dashed, the judged model on top; shaded if held out."""
    times = reading.log.times[part]
    shade_held_out(axes, reading.log, part)
    measured = reading.measured[part]
    simulated = {name: values[part] for name, values in reading.simulated.items()}
    styles = [NOMINAL, *[BETWEEN] * (len(simulated) - 2), JUDGED][-len(simulated) :]
    _curve(axes, times, measured, "measured", MEASURED)
    for (name, values), style in zip(simulated.items(), styles):
        _curve(axes, times, values, name, style)
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(*_limits(np.concatenate([measured, list(simulated.values())[-1]])))
    axes.set_ylabel(f"{words(reading.output)} [{reading.unit}]", parse_math=False)


def _curve(axes: Axes, times: Array, values: Array, name: str, style: Style) -> None:
    series, dash, width, opacity = style
    curve = envelope(times, values, BUCKETS)
    axes.plot(*curve, color=colour(series), ls=dash, lw=width, alpha=opacity, label=name)


def _limits(values: Array) -> tuple[float, float]:
    """Range of what was measured and what the judged model says; a nominal one may leave it."""
    low, high = float(values.min()), float(values.max())
    room = ROOM * (high - low) or 1.0
    return low - room, high + room
