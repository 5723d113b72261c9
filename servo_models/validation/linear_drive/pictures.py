"""Section: pictures of the linear drive in its position loop."""

from __future__ import annotations

from servo_models.core.simulate import Result, model, simulate
from servo_models.report.parts import Section
from servo_models.report.style import Picture, colour, drawing, label, picture
from servo_models.validation.cases import grid
from servo_models.validation.linear_drive.cases import to_and_fro
from servo_models.validation.rows import Validation

TITLE = "Linear drive: to and fro"
SLIDING = "coulomb_friction.level"


def section(validation: Validation) -> Section | None:
    """Return the section, None if this actuator was not examined."""
    if all(row.actuator != "linear_drive" for row in validation.rows):
        return None
    text = "The carriage goes 60 mm there and back in 2 s, commanded every 1 ms."
    return Section("linear_drive", TITLE, text, pictures=(_following(),))


def _run(friction: bool) -> Result:
    chosen = model("linear_drive", "identified", {} if friction else {SLIDING: 0.0})
    times = grid(4.0, 1e-3)
    return simulate(chosen, times, {"reference": to_and_fro(times)})


def _following() -> Picture:
    dry, free = _run(friction=True), _run(friction=False)
    with drawing("drive-following", rows=3, height=4.2) as (figure, (path, mark, drive)):
        path.plot(dry.times, 1e3 * dry["reference"], color=colour("muted"))
        path.set(ylabel="command [mm]")
        mark.plot(dry.times, 1e6 * (dry["position"] - free["position"]), color=colour("blue"))
        mark.set(ylabel="mark [µm]")
        drive.plot(free.times, free["drive"], color=colour("orange"))
        drive.plot(dry.times, dry["drive"], color=colour("blue"))
        label(drive, (0.2, 2.4), "Coulomb friction of 20.4 N", "blue", (0, 0))
        label(drive, (1.95, 0.5), "no dry friction", "orange", (0, 0), "right")
        drive.set(xlabel="time [s]", ylabel="drive [V]", xlim=(0, 4), ylim=(-3, 3))
        return picture(
            figure,
            "drive-following",
            "Identified drive with and without dry friction",
            "Middle: the mark that dry friction leaves on the position, which the loop all but"
            " hides. Below: the drive shows it; at every reversal it jumps by twice the friction"
            " over the force constant, 1.2 V.",
        )
