"""Section: a small and a large step of the general servo, and what each limit does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.report.sections import Picture, Section
from servo_models.report.style import colour, label
from servo_models.validation.cases import grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEP = math.radians(90.0)
OFF = {"speed_limit": 1e4, "acceleration_limit": 1e7}


def _run(**limits: float) -> Result:
    chosen = model("second_order_servo", "bus", {**OFF, **limits})
    return simulate(chosen, grid(0.5, 1e-3), {"goal": STEP})


def _limits(panels: Sequence[Axes]) -> None:
    limits = model("second_order_servo", "bus").values
    runs = {
        "no limit": ("muted", _run()),
        "acceleration": ("orange", _run(acceleration_limit=limits["acceleration_limit"])),
        "speed and acceleration": ("blue", _run(**{name: limits[name] for name in OFF})),
    }
    angle, rate = panels
    for series, run in runs.values():
        angle.plot(run.times, np.degrees(run["angle"]), color=colour(series))
        rate.plot(run.times, np.degrees(run["rate"]), color=colour(series))
    angle.set(ylabel="angle [deg]")
    rate.set(xlabel="time [s]", ylabel="rate [deg/s]", xlim=(0, 0.5))
    fastest = math.degrees(limits["speed_limit"])
    label(rate, (0.06, 1100.0), "no limit", "muted", (2, 0))
    label(rate, (0.1, 800.0), "acceleration limited", "orange", (4, 0))
    label(rate, (0.27, fastest), "speed limited too", "blue", (4, 2))


SECTIONS = (
    Section(
        "General servo: a large step and its limits",
        "Goal 90 deg at time 0, variant bus. A small step knows no limit; this one meets both.",
        pictures=(
            Picture(
                "Step without limits, with one, with both",
                _limits,
                "The limit of the speed makes the ramp, that of the acceleration bends its begin.",
                rows=2,
                height=3.4,
                shared=True,
            ),
        ),
        folded=True,
    ),
)
