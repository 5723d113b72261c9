"""Section: what the fitted model leaves over."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.statistics import autocorrelation, memory
from servo_models.identification.page.readings import (
    BUCKETS,
    Reading,
    drawn,
    envelope,
    in_unit,
    shade_held_out,
)
from servo_models.identification.result import Identification
from servo_models.report.parts import Section
from servo_models.report.style import Picture, colour, drawing, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLE = "Residuals"
BINS = 41
NUMBERS = 5
"""Numbers on an axis of long ones."""
LAGS = 40
"""Lags that are drawn at least; else twice as many as matter."""
DASHED = (0, (4, 3))


def section(found: Identification) -> Section:
    """Return a picture of the errors for each log and output that is drawn."""
    return Section(
        "residuals",
        TITLE,
        "Simulated minus measured, after the fit. Errors that hang together over time are no"
        " noise: the model lacks something there.",
        pictures=tuple(_picture(r, f"residual-{i}") for i, r in enumerate(drawn(found))),
    )


def _picture(reading: Reading, name: str) -> Picture:
    with drawing(name, rows=3, height=5.4, shared=False) as (figure, (time, lag, size)):
        _over_time(time, reading)
        _over_lag(lag, reading)
        _over_size(size, reading)
        figure.align_ylabels([time, lag, size])
        spread = in_unit(float(np.std(reading.error)), reading.unit)
        mean = in_unit(float(np.mean(reading.error)), reading.unit)
        return picture(
            figure,
            name,
            reading.title,
            f"Mean {mean}, standard deviation {spread}; dashed: the normal distribution with"
            " these. Between the dashed lines: 95 % of the correlations that white noise would"
            " have.",
        )


def _over_time(axes: Axes, reading: Reading) -> None:
    times = reading.log.stamps
    shade_held_out(axes, reading.log, slice(None))
    axes.plot(*envelope(times, reading.error, BUCKETS), color=colour("blue"), lw=0.8)
    axes.set(xlabel="time [s]", xlim=(times[0], times[-1]))
    axes.set_ylabel(f"error [{reading.unit}]", parse_math=False)


def _over_lag(axes: Axes, reading: Reading) -> None:
    n = len(reading.error)
    every = autocorrelation(reading.error)
    shown = every[: max(2 * memory(reading.error), LAGS) + 1]
    lags = np.arange(len(shown)) * reading.log.duration / (n - 1)
    axes.plot(*envelope(lags, shown, BUCKETS), color=colour("blue"), lw=1.2)
    for side in (1.96, -1.96):
        axes.axhline(side / np.sqrt(n), color=colour("muted"), lw=0.8, ls=DASHED)
    axes.set(xlabel="lag [s]", ylabel="autocorrelation", xlim=(0.0, None), ylim=(None, 1.05))
    axes.locator_params(axis="x", nbins=NUMBERS)


def _over_size(axes: Axes, reading: Reading) -> None:
    error = reading.error
    axes.hist(error, BINS, density=True, color=colour("blue"), alpha=0.45, lw=0)
    mean, deviation = float(np.mean(error)), float(np.std(error))
    if deviation > 0.0:
        across = np.linspace(error.min(), error.max(), 101)
        height = np.exp(-0.5 * ((across - mean) / deviation) ** 2)
        height /= deviation * np.sqrt(2.0 * np.pi)
        axes.plot(across, height, color=colour("ink"), lw=1.0, ls=DASHED)
    axes.set_xlabel(f"error [{reading.unit}]", parse_math=False)
    axes.set(ylabel="frequency", yticks=[])
    axes.locator_params(axis="x", nbins=NUMBERS)
