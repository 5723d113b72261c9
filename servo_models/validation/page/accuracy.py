"""Section: error against internal step, beside what the accuracy costs."""

from __future__ import annotations

import math
from collections.abc import Sequence

from servo_models.report.parts import Section
from servo_models.report.style import SERIES, Picture, colour, drawing, picture
from servo_models.validation.rows import CostCurve, Validation

TITLE = "Error against step size, and its cost"

MARKERS = "os^D"


def section(validation: Validation) -> Section | None:
    """Return the section, None if no step sizes were tried."""
    if not validation.cost:
        return None
    pictures = tuple(_picture(curve, i) for i, curve in enumerate(validation.cost))
    return Section(
        "accuracy",
        TITLE,
        "Above: the largest error of each output as a share of its full scale. Below: seconds"
        " of computing per second simulated. Dashed: the default internal step.",
        pictures=pictures,
    )


def _picture(curve: CostCurve, index: int) -> Picture:
    steps = [point.internal_step * 1e6 for point in curve.points]
    default = curve.default_step * 1e6
    name = f"accuracy-{index}"
    with drawing(name, rows=2, height=4.2) as (figure, (error, cost)):
        for series, mark, output in zip(SERIES, MARKERS, curve.points[0].error):
            values = [point.error[output] for point in curve.points]
            error.loglog(steps, values, f"{mark}-", color=colour(series), ms=4.5, label=output)
        error.legend(loc="best", frameon=False)
        seconds = [point.seconds for point in curve.points]
        cost.loglog(steps, seconds, "o-", color=colour("ink"), ms=4.5)
        for axes in (error, cost):
            axes.axvline(default, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
            axes.set_ylim(*_decades(axes.dataLim.intervaly))
            axes.minorticks_off()
        error.set_ylabel("error / full scale")
        cost.set(xlabel="internal step [µs]", ylabel="cost [s/s]")
        cost.set_xticks(steps, [f"{step:g}" for step in steps])
        return picture(
            figure,
            name,
            f"{curve.actuator}, {curve.variant}: {curve.case}",
            f"Default internal step {default:g} µs.",
        )


def _decades(ends: Sequence[float]) -> tuple[float, float]:
    """Whole powers of ten around both ends, so that an axis has numbers on it."""
    low, high = (math.log10(end) for end in ends)
    return 10.0 ** math.floor(low), 10.0 ** math.ceil(high)
