"""Section: pictures of the torque motor, with the figures of eq. 12 marked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.simulate import Result, simulate
from servo_models.analysis.sine_test import SineTest
from servo_models.catalogue import model
from servo_models.report.numbers import number, with_unit
from servo_models.report.sections import Picture, Section
from servo_models.report.style import colour, label
from servo_models.validation.torque_motor.cases import NO_STOPS
from servo_models.validation.torque_motor.reference import DELAY, EQ_12

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

FINAL = 3.0004  # angle [deg] at which eq. 12 rests at 40 V

STOP = 3.0  # half range between the stops [deg]

FRACTIONS = {2.80: 0.1, 9.37: 0.632, 20.23: 0.9}  # fraction of the final angle by time [ms]

SHOWN = 0.06  # duration that is drawn [s]

SINES = np.array([2.0, 5.0, 10.0, 20.0, 35.0, 50.0, 75.0, 100.0, 150.0, 188.0, 230.0, 300.0])
"""Frequencies [Hz] of the simulated sine runs."""

EQ_12_POINTS = {10.0: (-1.03, -32.5), 50.0: (-8.40, -93.5), 100.0: (-12.14, -130.3)}
"""Gain [dB] and phase [deg] of eq. 12 by frequency [Hz]."""

PEAK = 2.66  # peak angle [deg] of eq. 12 at 10 Hz and 40 V


def _step(volt: float, stops: bool) -> Result:
    chosen = model("torque_motor", "identified", {} if stops else NO_STOPS)
    grid = np.arange(0.0, SHOWN + 1e-5, 1e-4)
    return simulate(chosen, grid, {"voltage": volt})


def _free_step(panels: Sequence[Axes]) -> None:
    run = _step(40.0, stops=False)
    (axes,) = panels
    axes.plot(run.times * 1e3, np.degrees(run["angle"]), color=colour("blue"))
    axes.axhline(FINAL, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
    label(axes, (60.0, FINAL), "3.0004 deg", "muted", (0, 8), "right")
    for milliseconds, share in FRACTIONS.items():
        axes.plot(milliseconds, share * FINAL, "o", color=colour("orange"), mfc="none", ms=8)
        note = f"{100 * share:g} % at {milliseconds:.2f} ms"
        label(axes, (milliseconds, share * FINAL), note, "orange", (8, -6))
    axes.set(xlabel="time [ms]", ylabel="angle [deg]", xlim=(0, 60), ylim=(0, 3.4))


def _step_into_stop(panels: Sequence[Axes]) -> None:
    run, free = _step(50.0, stops=True), _step(50.0, stops=False)
    (axes,) = panels
    axes.axhspan(STOP, 4.2, color=colour("shade"), lw=0)
    axes.plot(free.times * 1e3, np.degrees(free["angle"]), color=colour("orange"), ls="--")
    axes.plot(run.times * 1e3, np.degrees(run["angle"]), color=colour("blue"))
    label(axes, (60.0, 3.75), "stops off", "orange", (0, 8), "right")
    label(axes, (60.0, STOP), "stops on", "blue", (0, -9), "right")
    label(axes, (0.0, 3.8), "beyond the stop", "muted", (6, 0))
    axes.set(xlabel="time [ms]", ylabel="angle [deg]", xlim=(0, 60), ylim=(0, 4.2))


def _sine(hertz: float, periods: int, points: int = 400) -> Result:
    """Response to 40 V peak at ``hertz``, ``points`` communication steps a period."""
    grid = np.arange(periods * points + 1) / (points * hertz)
    voltage = 40.0 * np.sin(2.0 * np.pi * hertz * grid)
    return simulate(model("torque_motor", "identified", NO_STOPS), grid, {"voltage": voltage})


def _response(hertz: float) -> complex:
    """Angle per voltage [rad/V] of the simulation at ``hertz``, 40 V peak, after it has settled."""
    chosen = model("torque_motor", "identified", NO_STOPS)
    return SineTest(chosen, "voltage", "angle", 40.0).response(hertz)


def _eq_12(hertz: Real) -> Complex:
    s = 2j * np.pi * hertz
    gain, poles = EQ_12
    return np.asarray(gain * np.exp(-DELAY * s) / np.polyval(poles, s))


def _decibel(response: Complex) -> Real:
    return 20.0 * np.log10(np.abs(response) / np.abs(_eq_12(np.zeros(1))))


def _degrees(response: Complex) -> Real:
    return np.degrees(np.unwrap(np.angle(response)))


def _bode(panels: Sequence[Axes]) -> None:
    simulated = np.array([_response(hertz) for hertz in SINES])
    curve = np.geomspace(1.0, 400.0, 200)
    exact = _eq_12(curve)
    gain, phase = panels
    gain.semilogx(curve, _decibel(exact), color=colour("blue"))
    gain.plot(SINES, _decibel(simulated), "o", color=colour("orange"), mfc="none")
    phase.plot(curve, _degrees(exact), color=colour("blue"))
    phase.plot(SINES, _degrees(simulated), "o", color=colour("orange"), mfc="none")
    for hertz, (decibel, degrees) in EQ_12_POINTS.items():
        for axes, value, text in ((gain, decibel, "dB"), (phase, degrees, "deg")):
            axes.plot(hertz, value, "+", color=colour("ink"), ms=9)
            label(axes, (hertz, value), with_unit(number(value), text), "ink", (-4, -11), "right")
    gain.set(ylabel="gain re. static [dB]", ylim=(-42, 5))
    phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]", xlim=(1, 400))
    phase.set_yticks(range(-360, 1, 90))
    phase.set_xticks([1, 10, 100], ["1", "10", "100"])


def _waveforms(panels: Sequence[Axes]) -> None:
    run = _sine(10.0, 4)
    shown = run.times >= 0.2
    rows = (
        ("voltage", 1.0, "voltage [V]", "muted"),
        ("current", 1e3, "current [mA]", "orange"),
        ("angle", 180.0 / np.pi, "angle [deg]", "blue"),
    )
    for axes, (name, scale, text, series) in zip(panels, rows):
        axes.plot((run.times[shown] - 0.2) * 1e3, scale * run[name][shown], color=colour(series))
        axes.set_ylabel(text)
        axes.margins(y=0.15)
    for peak in (PEAK, -PEAK):
        panels[2].axhline(peak, color=colour("muted"), lw=0.8, ls=(0, (4, 3)))
    label(panels[2], (200.0, PEAK), f"{PEAK:g} deg", "muted", (0, -8), "right")
    panels[2].set(xlabel="time [ms]", xlim=(0, 200))


SECTIONS = (
    Section(
        "Torque motor: steps, frequency response, waveforms",
        "Identified variant (eq. 12) throughout.",
        pictures=(
            Picture(
                "Step of 40 V, stops off (eq. 12)",
                _free_step,
                "Circles: where the identified transfer function must pass, its 1.1 ms delay"
                " included.",
            ),
            Picture(
                "Step of 50 V into the stop",
                _step_into_stop,
                "The rotor comes to rest on the stop without rebound; without stops the same"
                " voltage would turn it to 3.75 deg.",
            ),
            Picture(
                "Frequency response",
                _bode,
                "Line: eq. 12. Circles: settled sine runs of the simulation, 40 V peak, stops off."
                " Crosses with figures: eq. 12 at 10, 50 and 100 Hz.",
                rows=2,
                height=4.2,
                shared=True,
            ),
            Picture(
                "Waveforms at 10 Hz, 40 V peak",
                _waveforms,
                "Third and fourth period. Dashed: the peak angle that eq. 12 gives, 2.66 deg.",
                rows=3,
                height=4.2,
                shared=True,
            ),
        ),
        folded=True,
    ),
)
