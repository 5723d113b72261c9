"""Picture of a servo's closed loop over its feedback coefficient, with the one chosen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.identification.elements.identify import ElementsResult
from servo_models.identification.elements.loop import Choice
from servo_models.report.style import SERIES, colour, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 7.0, 7.0
"""Of the figure [inch]."""
MARKS = ("o", "s", "D")
"""Of the choices, in their order."""


def synthesis_picture(result: ElementsResult) -> Figure:
    """Draw settling times, time constant, overshoot, bandwidth and phase margin over K_f.

    A vertical line and a mark stand at the best K_f of each band.
    """
    synthesis = result.synthesis
    loop, choices = synthesis.loop, synthesis.choices
    bands = tuple(choices[0].optimum.settling)
    ends = synthesis.rows[0].k_f, synthesis.rows[-1].k_f
    near = [choice.optimum.k_f * (1.0 + leap) for choice in choices for leap in (0.0, 1e-6)]
    grid = np.unique([*np.linspace(*ends, 400), *near])
    curve = [loop.response(float(k_f), bands) for k_f in grid]
    with drawing("synthesis", rows=4, height=HEIGHT) as (figure, (time, swing, width, margin)):
        figure.set_size_inches(WIDTH, HEIGHT)
        figure.set_facecolor(colour("paper"))
        figure.suptitle("Closed loop over K_f", x=0.01, ha="left", size=11, weight="bold")
        for series, band in zip(SERIES[1:], bands):
            settling = [r.settling[band] for r in curve]
            time.plot(grid, settling, color=colour(series), label=f"settled within {_share(band)}")
        tau = [r.time_constant for r in curve]
        time.plot(grid, tau, color=colour("blue"), ls="--", label="time constant (86.5 %)")
        swing.plot(grid, [100.0 * r.overshoot for r in curve], color=colour("blue"))
        width.plot(grid, [r.bandwidth for r in curve], color=colour("blue"))
        margin.plot(grid, [math.degrees(r.phase_margin) for r in curve], color=colour("blue"))
        for series, mark, choice in zip(SERIES[1:], MARKS, choices):
            _mark([time, swing, width, margin], choice, series, mark)
        limit = 100.0 * synthesis.wish.overshoot
        swing.axhline(limit, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
        time.set(ylabel="time [s]", ylim=(0.0, 4.0 * choices[0].optimum.settling[bands[0]]))
        swing.set(ylabel="overshoot [%]")
        width.set(ylabel="bandwidth [rad/s]")
        margin.set(ylabel="phase margin [deg]", xlabel="feedback coefficient K_f", xlim=ends)
        look: dict[str, Any] = {"facecolor": colour("paper"), "edgecolor": "none", "fontsize": 8.5}
        time.legend(loc="upper right", framealpha=1.0, **look)
        swing.legend(loc="upper left", framealpha=1.0, **look)
        return figure


def _mark(panels: list[Axes], choice: Choice, series: str, mark: str) -> None:
    """Mark the best K_f of a band in every panel, named in the second."""
    best = choice.optimum
    heights = (
        best.settling[choice.band],
        100.0 * best.overshoot,
        best.bandwidth,
        math.degrees(best.phase_margin),
    )
    name = f"best for {_share(choice.band)}: {best.k_f:.4g}, set to {choice.setting.k_f:g}"
    for axes, height in zip(panels, heights):
        axes.axvline(best.k_f, color=colour(series), lw=0.8, ls=(0, (4, 3)))
        axes.plot(
            best.k_f,
            height,
            mark,
            color=colour(series),
            markerfacecolor=colour("paper"),
            label=name if axes is panels[1] else None,
        )


def _share(share: float) -> str:
    return f"±{100.0 * share:g} %"
