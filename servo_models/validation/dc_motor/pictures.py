"""Section: the speed loop at the limit of its current."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.report.sections import Picture, Section
from servo_models.report.style import colour, label
from servo_models.validation.cases import grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ACTUATORS = ("dc_motor_speed",)
SPEED = 300.0  # rad/s


def _run(limit: float) -> Result:
    chosen = model("dc_motor_speed", "direct", {"current_limit": limit})
    return simulate(chosen, grid(0.25, 1e-3), {"speed_command": SPEED})


def _limit(panels: Sequence[Axes]) -> None:
    free, limited = _run(100.0), _run(1.0)
    speed, current = panels
    for run, series in ((free, "orange"), (limited, "blue")):
        speed.plot(run.times, run["encoder_speed"], color=colour(series))
        current.plot(run.times, run["current"], color=colour(series))
    speed.axhline(SPEED, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
    label(speed, (0.07, 345.0), "no limit", "orange", (8, 4))
    label(speed, (0.05, 150.0), "1 A", "blue", (8, 0))
    speed.set(ylabel="speed [rad/s]")
    current.set(xlabel="time [s]", ylabel="current [A]", xlim=(0, 0.25))


SECTIONS = (
    Section(
        "Motor in a speed loop: the limit of the current",
        "300 rad/s at time 0, variant direct.",
        pictures=(
            Picture(
                "Step of the speed without a limit, and with one of 1 A",
                _limit,
                "The integral follows what the limit lets through, so it does not wind up: the"
                " limited run overshoots less than the other one.",
                rows=2,
                height=3.4,
                shared=True,
            ),
        ),
        folded=True,
    ),
)
