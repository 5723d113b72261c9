"""Section: pictures of the SG90, linear and as printed, with the paper's figures marked."""

from __future__ import annotations

import numpy as np

from servo_models.core.simulate import Result, model, simulate
from servo_models.report.parts import Section
from servo_models.report.style import SERIES, Picture, colour, drawing, label, picture
from servo_models.validation.rows import Validation
from servo_models.validation.sg90.paper import PRINTED_OVERSHOOT, PRINTED_TIMES, TIME_CONSTANT

TITLE = "SG90 of the paper: step responses"
COEFFICIENTS = {"_kf018": 0.18, "": 0.1, "_kf005": 0.05}
"""Feedback coefficient K_f by the ending of the variant's name."""
SHOWN = 15.0
STEP = 2.0e-3


def _step(variant: str, stop: float = SHOWN) -> Result:
    """Response to a pulse that goes from 1.5 ms to ``STEP`` [s] at time 0."""
    chosen = model("sg90", variant)
    grid = np.arange(0.0, stop + 0.01, 0.02)
    return simulate(chosen, grid, {"pulse_width": STEP})


def section(validation: Validation) -> Section | None:
    """Return the section, None if this actuator was not examined."""
    if all(row.actuator != "sg90" for row in validation.rows):
        return None
    pictures = (_linear(), _printed(), _inside(), _rejected())
    return Section("sg90", TITLE, "The pulse goes from 1.5 to 2.0 ms at time 0.", pictures=pictures)


def _linear() -> Picture:
    with drawing("sg90-linear") as (figure, (axes,)):
        for series, (ending, k_f) in zip(SERIES, COEFFICIENTS.items()):
            run = _step(f"linear{ending}", stop=60.0)
            share = run["angle"] / run["angle"][-1]
            shown = run.times <= SHOWN
            axes.plot(run.times[shown], share[shown], color=colour(series))
            axes.plot(
                PRINTED_TIMES[k_f],
                TIME_CONSTANT,
                "x" if k_f == 0.05 else "o",
                color=colour(series),
                markerfacecolor="none",
                markersize=8,
                markeredgewidth=1.6,
            )
        axes.axhline(1.0 + PRINTED_OVERSHOOT, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
        axes.axhline(TIME_CONSTANT, color=colour("muted"), lw=0.8, ls=(0, (1, 2)))
        label(axes, (3.4, 1.0 + PRINTED_OVERSHOOT), "K_f = 0.18", "blue", (0, 9))
        label(axes, (SHOWN, 1.0 + PRINTED_OVERSHOOT), "4.84 %", "muted", (0, 7), "right")
        label(axes, (3.4, 0.71), "K_f = 0.1", "orange", (6, 0))
        label(axes, (4.0, 0.45), "K_f = 0.05", "green", (6, 0))
        label(axes, (SHOWN, 0.6), "cross: 7.5 s, not reproducible", "green", (0, 0), "right")
        label(axes, (0.0, TIME_CONSTANT), "86.5 %", "muted", (4, 7))
        axes.set(xlabel="time [s]", ylabel="angle / final angle", xlim=(0, SHOWN), ylim=(0, 1.2))
        return picture(
            figure,
            "sg90-linear",
            "Linear SG90 (eq. 7), pulse 1.5 to 2.0 ms",
            "Circles: the printed time constants 2.6 s and 4.6 s lie on the curves at 86.5 % of"
            " the final angle. Cross: 7.5 s, printed for K_f = 0.05, does not; the curve needs"
            " 9.8 s. Dashed: the printed overshoot.",
        )


def _printed() -> Picture:
    with drawing("sg90-printed") as (figure, (axes,)):
        for series, (ending, k_f) in zip(SERIES, COEFFICIENTS.items()):
            run, linear = _step(f"printed{ending}"), _step(f"linear{ending}")
            angle = np.degrees(run["angle"])
            axes.plot(run.times, angle, color=colour(series))
            axes.plot(
                linear.times, np.degrees(linear["angle"]), color=colour(series), lw=1.0, ls="--"
            )
            label(axes, (SHOWN, angle[-1]), f"K_f = {k_f:g}", series, (0, -8), "right")
        label(axes, (9.0, 82.0), "dashed: linear", "green", (6, -4))
        axes.set(xlabel="time [s]", ylabel="angle [deg]", xlim=(0, SHOWN), ylim=(0, 100))
        return picture(
            figure,
            "sg90-printed",
            "SG90 as printed, the same step",
            "The dead zone of the motor leaves the servo far short of the linear resting angle:"
            " the drive voltage falls below the break-away voltage and the shaft stays where it"
            " is.",
        )


def _inside() -> Picture:
    run = _step("printed", stop=8.0)
    with drawing("sg90-inside", rows=2, height=3.4) as (figure, (drive, speed)):
        drive.step(run.times, run["motor_voltage"], color=colour("blue"), where="post")
        drive.axhspan(-0.6, 0.5, color=colour("shade"), lw=0)
        label(drive, (8.0, 0.0), "the motor does not turn here", "muted", (-4, 0), "right")
        drive.set(ylabel="drive [V]", ylim=(-0.6, 1.1))
        speed.plot(run.times, run["motor_speed"], color=colour("orange"))
        speed.set(xlabel="time [s]", ylabel="motor speed [rad/s]", xlim=(0, 8), ylim=(0, None))
        return picture(
            figure,
            "sg90-inside",
            "Inside the printed servo, K_f = 0.1",
            "Drive voltage and motor speed of the step above. Once the drive enters the zone in"
            " which the motor does not turn, the speed decays with the motor's time constant of"
            " 0.765 s.",
        )


def _rejected() -> Picture:
    stop = 25.0
    run, accepted = _step("oscillatory_motor", stop), _step("linear", stop)
    with drawing("sg90-rejected", height=3.4) as (figure, (axes,)):
        axes.plot(run.times, np.degrees(run["angle"]), color=colour("purple"), ls="--")
        axes.plot(accepted.times, np.degrees(accepted["angle"]), color=colour("orange"))
        label(axes, (13.2, 96.0), "model 1, undamped", "purple", (0, 26), "right")
        label(axes, (stop, 50.0), "model 2", "orange", (0, -9), "right")
        axes.set(xlabel="time [s]", ylabel="angle [deg]", xlim=(0, stop))
        return picture(
            figure,
            "sg90-rejected",
            "Why the paper rejects motor model 1",
            "With the undamped motor of eq. 5 the linear loop is unstable, its oscillation grows;"
            " with model 2 it settles.",
        )
