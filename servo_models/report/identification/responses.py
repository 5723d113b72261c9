"""Section: measured and simulated responses, held-out stretches shaded, and their errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.identification.covariance import memory
from servo_models.identification.result import Accuracy, Identification
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

TITLE = "Responses"
COLUMNS = ("log", "output", "part", "samples", "before", "after", "fit [%]", "unit")
NUMBERS = ("samples", "before", "after", "fit [%]")
ZOOM = 8
"""Width of the zoomed panel, in times over which errors hang together ..."""
LARGEST, FEWEST = 0.1, 60
"""... at most that share of the log, at least so many samples."""
ROOM = 0.15
"""Space above and below the measured and the fitted curve, as a part of their range."""


def section(found: Identification) -> Section:
    """Return the table of errors and a picture for each log and output."""
    units = {
        (log.name, output): unit_of(log, output) for log in found.logs for output in log.outputs
    }
    lines = tuple(_line(row, *units[row.log, row.output]) for row in found.accuracy)
    shown = drawn(found)
    return Section(
        "responses",
        TITLE,
        "RMS errors of the nominal and of the fitted model, in the numbers of the log. Fit: share"
        f" of the measured movement that the fitted model explains. {not_drawn(found)}".strip(),
        (Table("RMS error of every output in every part of every log", COLUMNS, lines, NUMBERS),),
        tuple(_picture(reading, f"response-{i}") for i, reading in enumerate(shown)),
    )


def _line(row: Accuracy, unit: str, scale: float) -> Line:
    figures = (number(row.before / scale), number(row.after / scale), number(row.fit, 5))
    return Line((row.log, words(row.output), row.part, f"{row.samples}", *figures, unit))


def _picture(reading: Reading, name: str) -> Picture:
    worst = _worst(reading)
    window = _window(reading, worst)
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
        whole.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=3, frameon=False)
        _curves(zoom, reading, window)
        zoom.axvline(times[worst], color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
        zoom.set_xlabel("time [s]")
        shaded = " Shaded: held out." if reading.log.held_out.any() else ""
        error = in_unit(abs(reading.error[worst]), reading.unit)
        return picture(
            figure,
            name,
            reading.title,
            f"Below: around the largest error of the fitted model, {error}"
            f" at {times[worst]:.6g} s.{shaded}",
        )


def _worst(reading: Reading) -> int:
    """Sample with the largest error after the fit, of those held out if there are any."""
    held = reading.log.held_out
    judged = held if held.any() else np.ones(len(held), dtype=bool)
    return int(np.argmax(np.where(judged, np.abs(reading.error), -1.0)))


def _window(reading: Reading, worst: int) -> slice:
    n = len(reading.measured)
    half = max(min(ZOOM * memory(reading.error), int(LARGEST * n)), FEWEST) // 2
    first = min(max(worst - half, 0), max(n - 2 * half, 0))
    return slice(first, min(first + 2 * half, n))


def _curves(axes: Axes, reading: Reading, part: slice) -> None:
    """Measured broad and grey, nominal dashed, fitted on top; shaded where held out."""
    times = reading.log.times[part]
    shade_held_out(axes, reading.log, part)
    measured, before, after = (
        values[part] for values in (reading.measured, reading.before, reading.after)
    )
    for label, values, series, dash, width, opacity in (
        ("measured", measured, "muted", "-", 3.0, 0.55),
        ("nominal", before, "orange", "--", 1.1, 1.0),
        ("fitted", after, "blue", "-", 1.1, 1.0),
    ):
        curve = envelope(times, values, BUCKETS)
        axes.plot(*curve, dash, color=colour(series), lw=width, alpha=opacity, label=label)
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(*_limits(np.concatenate([measured, after])))
    axes.set_ylabel(f"{words(reading.output)} [{reading.unit}]", parse_math=False)


def _limits(values: NDArray[np.float64]) -> tuple[float, float]:
    """Range of what was measured and fitted; a nominal model far off may leave it."""
    low, high = float(values.min()), float(values.max())
    room = ROOM * (high - low) or 1.0
    return low - room, high + room
