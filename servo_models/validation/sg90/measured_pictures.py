"""Section: the SG90 that people have beside the paper's, and how far apart they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servo_models.analysis.figures import Figures, figures
from servo_models.core.simulate import model, simulate
from servo_models.report.parts import NONE, Line, Section, Table, number
from servo_models.report.style import Picture, colour, drawing, label, picture
from servo_models.validation.rows import Validation

TITLE = "SG90: measured against printed"
CHANGE = 0.5e-3
"""Size of the step from the pulse at rest [s]."""
SWING = math.radians(60.0)
FIRST, LAST = 0.02, 20.0
"""Times [s] between which the responses are drawn."""
COLUMNS = ("figure", "measured", "printed", "ratio", "unit")


@dataclass(frozen=True)
class Row:
    """A figure of both servos, in ``unit``; None where a response never gets there."""

    name: str
    measured: float | None
    printed: float | None
    unit: str

    @property
    def ratio(self) -> float | None:
        """Printed over measured, where both are above 0."""
        return self.printed / self.measured if self.printed and self.measured else None


def section(validation: Validation) -> Section | None:
    """Return the section, None if this actuator was not examined."""
    if all(row.actuator != "sg90" for row in validation.rows):
        return None
    rows = compare()
    cells = (
        (row.name, *(number(v, 3) for v in (row.measured, row.printed)), _ratio(row), row.unit)
        for row in rows
    )
    caption = "Both servos, pulse from 1.5 to 2.0 ms; frequencies: a sine of 0.5 ms about 1.5 ms"
    table = Table(caption, COLUMNS, tuple(map(Line, cells)), COLUMNS[1:4])
    return Section("sg90_measured", TITLE, sentence(rows), (table,), (_picture(),))


def compare() -> tuple[Row, ...]:
    """Return the figures of merit of the variants ``measured`` and ``printed``."""
    both = [figures(model("sg90", name), amplitude=CHANGE) for name in ("measured", "printed")]
    every = [_figures(found) for found in both]
    return tuple(
        Row(name, value, every[1][name, unit], unit) for (name, unit), value in every[0].items()
    )


def _figures(found: Figures) -> dict[tuple[str, str], float | None]:
    """Figures by name and unit."""
    large, step = found.large, found.step
    return {
        ("slew time", "s/60 deg"): found.slew_rate and SWING / found.slew_rate,
        ("bandwidth (-3 dB)", "Hz"): large.bandwidth if large else None,
        ("equivalent delay", "s"): large.delay if large else None,
        ("rise from 10 % to 90 %", "s"): step.rise,
        ("settling to ±5 %", "s"): step.settling_5,
        ("settling to ±2 %", "s"): step.settling_2,
        ("overshoot", "%"): None if step.overshoot is None else 100.0 * step.overshoot,
        ("angle after the step", "deg"): math.degrees(step.final),
    }


def sentence(rows: tuple[Row, ...]) -> str:
    """Return how far apart the two servos are, in words."""
    row = {row.name: row for row in rows}
    slower = [row.ratio for row in rows if row.unit.startswith("s") and row.ratio]
    slew, angle = row["slew time"], row["angle after the step"]
    band, delay = row["bandwidth (-3 dB)"].ratio, row["equivalent delay"]
    return (
        f"The servo as printed is {number(min(slower), 2)} to {number(max(slower), 2)} times slower"
        f" than the one that was measured, depending on the figure: it turns 60 degrees in"
        f" {number(slew.printed, 2)} s instead of {number(slew.measured, 2)} s, has"
        f" {number(band and 100.0 * band, 2)} % of the bandwidth and {_ratio(delay)} times the"
        f" equivalent delay, and rests at {number(angle.printed, 3)} instead of"
        f" {number(angle.measured, 3)} degrees."
    )


def _ratio(row: Row) -> str:
    return NONE if row.ratio is None else number(row.ratio, 2)


def _picture() -> Picture:
    times = np.concatenate([[0.0], np.geomspace(FIRST, LAST, 400)])
    with drawing("sg90-measured") as (figure, (axes,)):
        for variant, series, at in (("measured", "blue", 0.13), ("printed", "orange", 2.5)):
            run = simulate(model("sg90", variant), times, {"pulse_width": 1.5e-3 + CHANGE})
            angle = np.degrees(run["angle"])
            axes.semilogx(times[1:], angle[1:], color=colour(series))
            label(axes, (at, np.interp(at, times, angle)), variant, series, (8, -4))
        axes.set(xlabel="time [s], logarithmic", ylabel="angle [deg]", xlim=(FIRST, LAST))
        axes.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
        return picture(
            figure,
            "sg90-measured",
            "The same step of both servos",
            "Measured: identified from a real servo's steps. Printed: the paper's nonlinear"
            " servo, whose drive falls into the motor's dead zone before it arrives.",
        )
