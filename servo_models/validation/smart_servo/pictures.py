"""Section: pictures of the smart servo, with and without dry friction."""

from __future__ import annotations

import numpy as np

from servo_models.core.simulate import Result, model, simulate
from servo_models.report.parts import Section, number
from servo_models.report.style import Picture, colour, drawing, label, picture
from servo_models.validation.cases import grid
from servo_models.validation.rows import Validation

TITLE = "Smart servo: a step with dry friction"
GOAL = 0.3
FRICTION = 0.05
"""Coulomb friction [N m] of the example, a tenth of the stall torque."""


def section(validation: Validation) -> Section | None:
    """Return the section, None if this actuator was not examined."""
    if all(row.actuator != "smart_servo" for row in validation.rows):
        return None
    text = (
        "Dynamixel XL330 of the data sheet, goal 0.3 rad at time 0, position gain 400. Data sheets"
        " give no friction; the second curve has 0.05 N m of it, a tenth of the stall torque."
    )
    return Section("smart_servo", TITLE, text, pictures=(_step(),))


def _run(friction: float) -> Result:
    chosen = model("smart_servo", "xl330", {"coulomb_friction.level": friction})
    return simulate(chosen, grid(1.5, 2e-3), {"goal": GOAL})


def _step() -> Picture:
    free, dry = _run(0.0), _run(FRICTION)
    short = np.degrees(GOAL - dry["angle"][-1])
    with drawing("smart-step", rows=2, height=3.4) as (figure, (angle, duty)):
        for run, series in ((free, "orange"), (dry, "blue")):
            angle.plot(run.times, np.degrees(run["angle"]), color=colour(series))
            duty.plot(run.times, 100.0 * run["duty"], color=colour(series))
        angle.axhline(np.degrees(GOAL), color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
        label(angle, (0.3, 23.5), "no dry friction", "orange", (12, 0))
        label(angle, (1.5, np.degrees(dry["angle"][-1])), "0.05 N m", "blue", (0, 9), "right")
        label(angle, (0.0, np.degrees(GOAL)), "goal", "muted", (3, 7))
        angle.set(ylabel="angle [deg]", ylim=(0, 26))
        duty.set(xlabel="time [s]", ylabel="duty [%]", xlim=(0, 1.5))
        return picture(
            figure,
            "smart-step",
            "Step with and without dry friction",
            f"With friction the output sticks {number(abs(short), 2)} degrees"
            f" {'beyond' if short < 0.0 else 'short of'} the goal, and the duty of"
            f" {number(100.0 * dry['duty'][-1], 2)} % that is left cannot move it.",
        )
