"""Section: pictures of the linear drive in its position loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.report.sections import Picture, Section
from servo_models.report.style import colour, label
from servo_models.validation.cases import grid
from servo_models.validation.linear_drive.cases import to_and_fro

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SLIDING = "coulomb_friction.level"


def _run(friction: bool) -> Result:
    chosen = model("linear_drive", "identified", {} if friction else {SLIDING: 0.0})
    times = grid(4.0, 1e-3)
    return simulate(chosen, times, {"reference": to_and_fro(times)})


def _following(panels: Sequence[Axes]) -> None:
    dry, free = _run(friction=True), _run(friction=False)
    path, mark, drive = panels
    path.plot(dry.times, 1e3 * dry["reference"], color=colour("muted"))
    path.set(ylabel="command [mm]")
    mark.plot(dry.times, 1e6 * (dry["position"] - free["position"]), color=colour("blue"))
    mark.set(ylabel="mark [µm]")
    drive.plot(free.times, free["drive"], color=colour("orange"))
    drive.plot(dry.times, dry["drive"], color=colour("blue"))
    label(drive, (0.2, 2.4), "Coulomb friction of 20.4 N", "blue", (0, 0))
    label(drive, (1.95, 0.5), "no dry friction", "orange", (0, 0), "right")
    drive.set(xlabel="time [s]", ylabel="drive [V]", xlim=(0, 4), ylim=(-3, 3))


SECTIONS = (
    Section(
        "Linear drive: to and fro",
        "The carriage goes 60 mm there and back in 2 s, commanded every 1 ms.",
        pictures=(
            Picture(
                "Identified drive with and without dry friction",
                _following,
                "Middle: the mark that dry friction leaves on the position, which the loop all but"
                " hides. Below: the drive shows it; at every reversal it jumps by twice the"
                " friction over the force constant, 1.2 V.",
                rows=3,
                height=4.2,
                shared=True,
            ),
        ),
        folded=True,
    ),
)
