"""Does the variant ``measured`` hold for another SG90, which a camera has watched?

The variant, identified from one servo's steps, is laid over the tracked angle of another one
that swings through 180 degrees with an AA cell on its horn.  Nothing is fitted but the clock of
the command, which is late against that of the video.

    SERVO_MODELS_DATA=LOGS python -m studies sg90_video

It prints the tables of the last part of ``docs/studies/sg90_measured.md`` and draws its figure.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize_scalar

from servo_models.analysis.compare import overshoot, rise_time
from servo_models.analysis.simulate import simulate
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.report.style import colour, drawing, label
from studies.sg90_measured import ANGLE, PULSE, described, save, table

STEP, BEFORE = 1e-3, 1.0
"""Communication step and time at rest before the log [s]."""
EARLY = 0.15  # a swing is looked at from so long [s] before the command: the horn moves ahead of it
PERIOD = 1.0  # time [s] between swings
MOVING = 100.0  # rate [deg/s] of the simulated servo above which it counts as moving


def response(chosen: Model, log: Log) -> tuple[Array, Array]:
    """Times [s] on the log's clock, and the simulated angle [deg] at them."""
    times = np.arange(-BEFORE, log.duration, STEP)
    row = np.maximum(np.searchsorted(log.times, times + 1e-9, side="right") - 1, 0)
    run = simulate(chosen, times + BEFORE, {PULSE: log.inputs[PULSE][row]})
    return times, np.degrees(run[ANGLE])


def late(log: Log, measured: Array, times: Array, simulated: Array) -> float:
    """Time [s] by which the command's clock is late against the video's."""

    def error(shift: float) -> float:
        moved = np.interp(log.times + shift, times, simulated)
        return float(np.sqrt(np.mean((moved - measured) ** 2)))

    grid = np.arange(0.0, 0.2, 0.01)
    near = grid[np.argmin([error(shift) for shift in grid])]
    found = minimize_scalar(error, bounds=(near - 0.01, near + 0.01), method="bounded")
    return float(found.x)


def swings(log: Log, times: Array, angle: Array) -> list[tuple[bool, float, float]]:
    """Direction, slew rate [deg/s] from 10 % to 90 % and overshoot [deg] of every whole swing."""
    pulse = log.inputs[PULSE]
    found = []
    for k in np.flatnonzero(np.diff(pulse)) + 1:
        first, end = log.times[k] - EARLY, log.times[k] - EARLY + PERIOD
        part = (times >= first) & (times < end)
        if end > log.duration:
            continue
        start, final = angle[part][0], float(np.median(angle[part][-5:]))
        rise = rise_time(times[part], angle[part], final=final) or math.nan
        over = overshoot(times[part], angle[part], final=final) or 0.0
        size = abs(final - start)
        found.append((bool(pulse[k] > pulse[k - 1]), 0.8 * size / rise, over * size))
    return found


def main() -> None:
    told = described("sg90_video.toml")
    log = told.logs[0]
    measured = np.degrees(log.outputs[ANGLE])
    times, simulated = response(told.model, log)
    clock = late(log, measured, times, simulated)
    aligned = np.interp(log.times + clock, times, simulated)
    error = aligned - measured
    rate = np.gradient(aligned, log.times)
    moving = np.abs(rate) > MOVING
    print(f"\nThe description moves the command; it is another {1e3 * clock:.0f} ms late.")
    rows = [
        (what, f"{np.sqrt(np.mean(error[mask] ** 2)):.1f}", f"{np.mean(error[mask]):.1f}")
        for what, mask in (
            ("all", np.ones(len(error), dtype=bool)),
            ("moving", moving),
            ("at rest", ~moving),
        )
    ]
    table(("samples", "RMS error [deg]", "mean error [deg]"), rows)
    both = [swings(log, log.times, measured), swings(log, times - clock, simulated)]
    compared = []
    for rising in (True, False):
        for what, index, unit in (("slew rate", 1, "deg/s"), ("overshoot", 2, "deg")):
            one, other = ([s[index] for s in found if s[0] is rising] for found in both)
            compared.append(
                (
                    f"{what} {'up' if rising else 'down'}",
                    f"{np.mean(one):.1f} ± {np.std(one, ddof=1):.1f}",
                    f"{np.mean(other):.1f}",
                    unit,
                )
            )
    table(("swing", "video", "variant measured", "unit"), compared)
    draw(log, measured, times - clock, simulated)


def draw(log: Log, measured: Array, times: Array, simulated: Array) -> None:
    """Two swings of both servos, and the difference."""
    with drawing(rows=2, height=4.0) as (figure, (angle, difference)):
        angle.plot(log.times, measured, ".", color=colour("ink"))
        angle.plot(times, simulated, color=colour("blue"), lw=1.2)
        label(angle, (1.12, 60.0), "dots: video", "ink", (0, 0), "center")
        label(angle, (1.12, 30.0), "line: variant", "blue", (0, 0), "center")
        angle.set(ylabel="angle [deg]")
        error = np.interp(log.times, times, simulated) - measured
        difference.plot(log.times, error, ".-", color=colour("orange"), lw=1.0)
        difference.set(xlabel="time [s]", ylabel="difference [deg]", xlim=(0.3, 2.3))
        save(figure, "sg90_measured_video")


if __name__ == "__main__":
    main()
