"""Measured and simulated responses with the error of each model, zoomed at the worst moment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from servo_models.identification.page.readings import Reading, in_unit
from servo_models.identification.page.responses import (
    DASHED,
    draw_frame,
    draw_legend,
    draw_models,
    draw_responses,
    stretch,
    worst_sample,
)
from servo_models.report.style import Picture, colour, drawing, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NUMBERS = 5
"""Numbers on the axis of a short stretch, which are long ones."""


def response(reading: Reading, name: str) -> Picture:
    """Return a response and its errors, as a whole and where the nominal model is worst.

    Args:
        reading: measured and simulated, the nominal model first.
        name: keeps the ids of the drawing unique on the page.
    """
    errors = next(iter(reading.simulated.values())) - reading.measured
    log = reading.log
    worst = worst_sample(errors, log.fitted if log.fitted.any() else log.checked)
    window = stretch(errors, worst)
    times = log.stamps
    with drawing(name, rows=4, height=6.2, shared=False) as (figure, panels):
        whole, over_all, zoom, close = panels
        draw_responses(whole, reading, slice(None))
        draw_legend(whole, 1 + len(reading.simulated))
        _errors(over_all, reading, slice(None))
        for axes in (whole, over_all):
            draw_frame(axes, times[window])
        draw_responses(zoom, reading, window)
        _errors(close, reading, window)
        for axes in (zoom, close):
            axes.axvline(times[worst], color=colour("muted"), lw=0.8, ls=DASHED)
            axes.locator_params(axis="x", nbins=NUMBERS)
        for axes in (whole, zoom):
            axes.tick_params(labelbottom=False)
        close.set_xlabel("time [s]")
        figure.align_ylabels(panels)
        held = " Shaded: held out by the description." if log.held_out.any() else ""
        error = in_unit(abs(errors[worst]), reading.unit)
        return picture(
            figure,
            name,
            reading.title,
            "Error: simulated minus measured. The lower two panels show the framed stretch,"
            f" where the nominal model is worst: {error} at {times[worst]:.5g} s.{held}",
        )


def _errors(axes: Axes, reading: Reading, part: slice) -> None:
    curves = {name: (values - reading.measured)[part] for name, values in reading.simulated.items()}
    axes.axhline(0.0, color=colour("muted"), lw=0.7)
    draw_models(axes, reading.log, part, curves)
    axes.set_ylabel(f"error\n[{reading.unit}]", parse_math=False)
    largest = max(float(np.abs(values).max()) for values in curves.values())
    if 0.0 < largest < 1e-3:
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)
