"""Pictures of the SG90: a real servo beside the paper's, and the paper's figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from servo_models.analysis.figures import Figures, figures
from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.report.curves import draw_label
from servo_models.report.numbers import ARROW, number, with_unit
from servo_models.report.sections import Picture, Section
from servo_models.report.style import SERIES, colour, label
from servo_models.validation.sg90.paper import PRINTED_OVERSHOOT, PRINTED_TIMES, TIME_CONSTANT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COEFFICIENTS = {"_kf018": 0.18, "": 0.1, "_kf005": 0.05}  # K_f by the variant's ending
SHOWN = 15.0  # duration that is drawn [s]
STEP = 2.0e-3  # pulse after the step [s]
CHANGE = 0.5e-3  # size of the step from the pulse at rest [s]
SWING = math.radians(60.0)
FIRST = 0.02  # time [s] from which both servos are drawn
LAST = 20.0  # time [s] up to which both servos are drawn


def _step(variant: str, stop: float = SHOWN) -> Result:
    """Response to a pulse that goes from 1.5 ms to ``STEP`` [s] at time 0."""
    chosen = model("sg90", variant)
    grid = np.arange(0.0, stop + 0.01, 0.02)
    return simulate(chosen, grid, {"pulse_width": STEP})


def _linear(panels: Sequence[Axes]) -> None:
    (axes,) = panels
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


def _printed(panels: Sequence[Axes]) -> None:
    (axes,) = panels
    for series, (ending, k_f) in zip(SERIES, COEFFICIENTS.items()):
        run, linear = _step(f"printed{ending}"), _step(f"linear{ending}")
        angle = np.degrees(run["angle"])
        axes.plot(run.times, angle, color=colour(series))
        axes.plot(linear.times, np.degrees(linear["angle"]), color=colour(series), lw=1.0, ls="--")
        label(axes, (SHOWN, angle[-1]), f"K_f = {k_f:g}", series, (0, -8), "right")
    label(axes, (9.0, 82.0), "dashed: linear", "green", (6, -4))
    axes.set(xlabel="time [s]", ylabel="angle [deg]", xlim=(0, SHOWN), ylim=(0, 100))


def _inside(panels: Sequence[Axes]) -> None:
    run = _step("printed", stop=8.0)
    drive, speed = panels
    drive.step(run.times, run["motor_voltage"], color=colour("blue"), where="post")
    drive.axhspan(-0.6, 0.5, color=colour("shade"), lw=0)
    label(drive, (8.0, 0.0), "the motor does not turn here", "muted", (-4, 0), "right")
    drive.set(ylabel="drive [V]", ylim=(-0.6, 1.1))
    speed.plot(run.times, run["motor_speed"], color=colour("orange"))
    speed.set(xlabel="time [s]", ylabel="motor speed [rad/s]", xlim=(0, 8), ylim=(0, None))


def _rejected(panels: Sequence[Axes]) -> None:
    stop = 25.0
    run, accepted = _step("oscillatory_motor", stop), _step("linear", stop)
    (axes,) = panels
    axes.plot(run.times, np.degrees(run["angle"]), color=colour("purple"), ls="--")
    axes.plot(accepted.times, np.degrees(accepted["angle"]), color=colour("orange"))
    label(axes, (13.2, 96.0), "model 1, undamped", "purple", (0, 26), "right")
    label(axes, (stop, 50.0), "model 2", "orange", (0, -9), "right")
    axes.set(xlabel="time [s]", ylabel="angle [deg]", xlim=(0, stop))


class Compared(NamedTuple):
    """A figure of both servos, in ``unit``; None where a response never gets there."""

    name: str
    measured: float | None
    printed: float | None
    unit: str

    @property
    def ratio(self) -> float | None:
        """Printed over measured, where both are above 0."""
        return self.printed / self.measured if self.printed and self.measured else None


def compare() -> tuple[Compared, ...]:
    """Return the figures of merit of the variants ``measured`` and ``printed``."""
    both = [figures(model("sg90", name), amplitude=CHANGE) for name in ("measured", "printed")]
    measured, printed = map(_figures, both)
    return tuple(
        Compared(name, value, printed[name, unit], unit) for (name, unit), value in measured.items()
    )


def _figures(measured: Figures) -> dict[tuple[str, str], float | None]:
    """Figures by name and unit."""
    large, step = measured.large, measured.step
    return {
        ("slew time", "s/60 deg"): measured.slew_rate and SWING / measured.slew_rate,
        ("bandwidth (-3 dB)", "Hz"): large.bandwidth if large else None,
        ("equivalent delay", "s"): large.delay if large else None,
        ("rise from 10 % to 90 %", "s"): step.rise,
        ("settling to ±5 %", "s"): step.settling_5,
        ("settling to ±2 %", "s"): step.settling_2,
        ("overshoot", "%"): None if step.overshoot is None else 100.0 * step.overshoot,
        ("angle after the step", "deg"): math.degrees(step.final),
    }


def _both_servos(panels: Sequence[Axes]) -> None:
    times = np.concatenate([[0.0], np.geomspace(FIRST, LAST, 400)])
    (axes,) = panels
    for variant, series, at in (("measured", "blue", 0.13), ("printed", "orange", 2.5)):
        run = simulate(model("sg90", variant), times, {"pulse_width": 1.5e-3 + CHANGE})
        angle = np.degrees(run["angle"])
        axes.semilogx(times[1:], angle[1:], color=colour(series))
        label(axes, (at, np.interp(at, times, angle)), variant, series, (8, -4))
    axes.set(xlabel="time [s], logarithmic", ylabel="angle [deg]", xlim=(FIRST, LAST))
    axes.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])


def _ratios(panels: Sequence[Axes]) -> None:
    (axes,) = panels
    rows = [row for row in compare() if row.ratio]
    for place, row in enumerate(reversed(rows)):
        assert row.ratio
        axes.plot([1.0, row.ratio], [place, place], "-o", color=colour("orange"), ms=4.0)
        values = (number(row.measured, 3), with_unit(number(row.printed, 3), row.unit))
        draw_label(axes, place + 0.15, f"{row.name}: {values[0]} {ARROW} {values[1]}")
    axes.axvline(1.0, color=colour("muted"), lw=0.8)
    axes.set(xlabel="printed / measured", xscale="log", yticks=[], ylim=(-0.5, len(rows)))
    axes.set_xticks([0.1, 1.0, 10.0, 100.0], ["0.1", "1", "10", "100"])


SECTIONS = (
    Section(
        "SG90: measured against printed",
        "The servo as printed is 18 to 79 times slower than the one that was measured, depending on"
        " the figure: it turns 60 degrees in 9.9 s instead of 0.13 s, has 3.1 % of the bandwidth"
        " and 79 times the equivalent delay, and rests at 25.4 instead of 48.5 degrees.",
        pictures=(
            Picture(
                "The same step of both servos",
                _both_servos,
                "Measured: identified from a real servo's steps. Printed: the paper's nonlinear"
                " servo, whose drive falls into the motor's dead zone before it arrives.",
            ),
            Picture(
                "Figures of both servos, measured and printed",
                _ratios,
                "Pulse from 1.5 to 2.0 ms; bandwidth and delay: a sine of 0.5 ms about 1.5 ms.",
                height=3.6,
            ),
        ),
        folded=True,
    ),
    Section(
        "SG90 of the paper: step responses",
        "The pulse goes from 1.5 to 2.0 ms at time 0.",
        pictures=(
            Picture(
                "Linear SG90 (eq. 7), pulse 1.5 to 2.0 ms",
                _linear,
                "Circles: the printed time constants 2.6 s and 4.6 s lie on the curves at 86.5 % of"
                " the final angle. Cross: 7.5 s, printed for K_f = 0.05, does not; the curve needs"
                " 9.8 s. Dashed: the printed overshoot.",
            ),
            Picture(
                "SG90 as printed, the same step",
                _printed,
                "The dead zone of the motor leaves the servo far short of the linear resting angle:"
                " the drive voltage falls below the break-away voltage and the shaft stays where it"
                " is.",
            ),
            Picture(
                "Inside the printed servo, K_f = 0.1",
                _inside,
                "Drive voltage and motor speed of the step above. Once the drive enters the zone in"
                " which the motor does not turn, the speed decays with the motor's time constant of"
                " 0.765 s.",
                rows=2,
                height=3.4,
                shared=True,
            ),
            Picture(
                "Why the paper rejects motor model 1",
                _rejected,
                "With the undamped motor of eq. 5 the linear loop is unstable, its oscillation"
                " grows; with model 2 it settles.",
                height=3.4,
            ),
        ),
        folded=True,
    ),
)
