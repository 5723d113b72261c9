"""Section: pictures of the smart servo, with and without dry friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.report.numbers import number
from servo_models.report.sections import Picture, Section
from servo_models.report.style import colour, label
from servo_models.validation.cases import grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GOAL = 0.3  # rad
FRICTION = 0.05  # Coulomb friction [N m], a tenth of the stall torque


def _run(friction: float) -> Result:
    chosen = model("smart_servo", "xl330", {"coulomb_friction.level": friction})
    return simulate(chosen, grid(1.5, 2e-3), {"goal": GOAL})


def _step(panels: Sequence[Axes]) -> None:
    free, dry = _run(0.0), _run(FRICTION)
    short = np.degrees(GOAL - dry["angle"][-1])
    angle, duty = panels
    for run, series in ((free, "orange"), (dry, "blue")):
        angle.plot(run.times, np.degrees(run["angle"]), color=colour(series))
        duty.plot(run.times, 100.0 * run["duty"], color=colour(series))
    angle.axhline(np.degrees(GOAL), color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
    label(angle, (0.3, 23.5), "no dry friction", "orange", (12, 0))
    label(
        angle,
        (1.5, np.degrees(dry["angle"][-1])),
        f"0.05 N m, {number(short, 2)} deg short",
        "blue",
        (0, 9),
        "right",
    )
    label(angle, (0.0, np.degrees(GOAL)), "goal", "muted", (3, 7))
    angle.set(ylabel="angle [deg]", ylim=(0, 26))
    duty_left = 100.0 * dry["duty"][-1]
    label(duty, (1.5, duty_left), f"{number(duty_left, 2)} % left", "blue", (0, 9), "right")
    duty.set(xlabel="time [s]", ylabel="duty [%]", xlim=(0, 1.5))


SECTIONS = (
    Section(
        "Smart servo: a step with dry friction",
        "Dynamixel XL330 of the data sheet, goal 0.3 rad at time 0, position gain 400. Data sheets"
        " give no friction; the second curve has 0.05 N m of it, a tenth of the stall torque.",
        pictures=(
            Picture(
                "Step with and without dry friction",
                _step,
                "With friction the output sticks short of the goal, and the duty that is left"
                " cannot move it.",
                rows=2,
                height=3.4,
                shared=True,
            ),
        ),
        folded=True,
    ),
)
