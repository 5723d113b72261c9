"""The cases that are flown, and what is measured of each in the co-simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from margins import HERE, Array, Complex, LimitCycle, Margin, own
from masters import Master, Signal
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from systems import SPLIT, SURFACES, System, uav

import servo_models as sm

STEPS = {"roll": math.radians(20.0), "pitch": math.radians(5.0)}
"""Commanded steps [rad]."""
COMMANDS = {"roll": "aileron", "pitch": "elevator"}
MOVES = {"roll": "left_aileron", "pitch": "elevator"}
LAST = 5.0
"""End of a run [s] in which a limit cycle is looked for."""
REST = math.radians(0.01)
"""A surface that moves less than this has come to rest."""
TURNS = 4
"""Of an oscillation: fewer are a slow return to rest."""
FRAMES, WARM = 500, 2
"""Frames in a period of the test signal, and periods until the loops have settled into it."""
LINES = {"roll": np.arange(3, 60, 2), "pitch": np.arange(4, 60, 2)}
"""Sines of the test signal, in turns a period: each loop has its own, for one test of both."""
AMPLITUDE = math.radians(0.1)
"""Of each of them: small, since the margin is one of small signals."""


@dataclass(frozen=True)
class Case:
    """One kind of actuator.

    Attributes:
        name: of its package.
        about: what it is.
        servo: its model.
        fmu: its kind of FMU.
        parameters: of the FMU [SI], where they are not those that it was built with.
    """

    name: str
    about: str
    servo: sm.Model
    fmu: str
    parameters: Mapping[str, float]

    @property
    def play(self) -> float:
        """Half width of the play in its gears [rad]."""
        return self.servo.values.get("backlash.half_width", 0.0)

    def system(self, fmus: Path, commands: Mapping[str, float]) -> System:
        """Return the UAV with these servos; ``commands`` are angles [rad] by axis."""
        fmu, each = fmus / f"{self.fmu}.native.fmu", dict.fromkeys(SURFACES, self.parameters)
        return uav(self.name, fmu, fmus, each, pilot_inputs(commands))


def pilot_inputs(commands: Mapping[str, float]) -> dict[str, float]:
    """Return the start values of the autopilot: an FMU alone would begin with its standard step."""
    return {f"{axis}_command": commands.get(axis, 0.0) for axis in STEPS}


def ten_servos(fmus: Path) -> System:
    """Return the UAV with ten instances of one servo, each with a play of its own."""
    names = (*SURFACES, *SPLIT)
    plays = {
        name: {"backlash.half_width": math.radians(0.1 * k)} for k, name in enumerate(names, 1)
    }
    return uav("ten_servos", fmus / "sg90.native.fmu", fmus, plays, pilot_inputs(STEPS))


def cases() -> tuple[Case, ...]:
    """Return what is compared: no actuator at all, the one assumed, the one diagnosed."""
    gap = sm.read_parameters(HERE / "GAP.toml")
    return (
        Case("ideal", "at once", own("ideal_servo"), "ideal_servo", {}),
        Case("measured", "SG90 as identified", sm.model("sg90", "measured"), "sg90", {}),
        Case("diagnosed", "SG90 with the diagnosed play", gap.model(), "sg90", gap.settings()),
    )


@dataclass(frozen=True)
class Step:
    """A response to a step of one command: all of shape (n,), angles [rad]."""

    times: Array
    attitude: Array
    surface: Array
    command: float

    @property
    def overshoot(self) -> float:
        """Largest excess over the command, as a share of it."""
        return float(np.max(self.attitude)) / self.command - 1.0

    def limit_cycle(self) -> LimitCycle | None:
        """Return the oscillation at the end of the run, None where all is at rest."""
        last = self.times > self.times[-1] - LAST
        times, swing = self.times[last], self.attitude[last] - np.mean(self.attitude[last])
        up = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
        if len(up) < TURNS or np.ptp(self.surface[last]) < REST:
            return None
        begin, end = up[0], up[-1]
        turns = 2.0 * math.pi * (len(up) - 1) / (times[end] - times[begin])
        wave = np.exp(-1j * turns * times[begin:end])
        attitude, surface = (
            2.0 * float(abs(np.mean(wave * (x - np.mean(x)))))
            for x in (swing[begin:end], self.surface[last][begin:end])
        )
        return LimitCycle(surface, float(turns), attitude)


def fly(case: Case, fmus: Path, axis: str, stop: float) -> Step:
    """Fly a step of one command."""
    wanted = [("airframe", axis), (MOVES[axis], "angle")]
    system = case.system(fmus, {axis: STEPS[axis]})
    with Master(system) as master:
        found = master.simulate(stop, wanted)
    times: Array = system.step * np.arange(1.0, len(found[wanted[0]]) + 1.0)
    return Step(times, found[wanted[0]], found[wanted[1]], STEPS[axis])


def measured_loops(case: Case, fmus: Path, frame: float) -> dict[str, tuple[Array, Complex]]:
    """Return frequencies [rad/s] and the open loop there, measured in the closed ones.

    Sines are added to both commands of the autopilot at once.  What comes back at each frequency is
    the command without the sine.
    """
    system = case.system(fmus, {})
    held = round(frame / system.step)
    tests = {axis: _multisine(lines) for axis, lines in LINES.items()}
    driven: dict[Signal, Array] = {
        ("autopilot", f"{COMMANDS[axis]}_test"): np.repeat(np.tile(test, WARM + 1), held)
        for axis, test in tests.items()
    }
    wanted = [("autopilot", COMMANDS[axis]) for axis in STEPS]
    with Master(system) as master:
        found = master.simulate((WARM + 1) * FRAMES * frame, wanted, driven)
    loops = {}
    for axis, lines in LINES.items():
        given = np.fft.fft(found["autopilot", COMMANDS[axis]][::held][-FRAMES:])[lines]
        back = given - np.fft.fft(tests[axis])[lines]
        frequencies = np.multiply(lines, 2.0 * math.pi / (FRAMES * frame), dtype=np.float64)
        loops[axis] = frequencies, -back / given
    return loops


def measured_margin(frequencies: Array, loop: Complex) -> Margin:
    """Return the least phase margin of a loop that is known at some frequencies [rad/s]."""
    octaves = np.log(frequencies)
    gain = CubicSpline(octaves, np.log(np.abs(loop)))
    phase = CubicSpline(octaves, np.unwrap(np.angle(loop)))
    crossings = gain.roots(extrapolate=False)
    margins = [Margin(math.pi + float(phase(at)), math.exp(at)) for at in crossings]
    return min(margins, key=lambda margin: margin.phase)


def _multisine(lines: NDArray[np.int_]) -> Array:
    """A sum of sines over one period, with phases that keep it low.

    Source: Schroeder, IEEE Trans. Information Theory 16 (1970) 85.
    """
    turns = np.outer(lines, np.arange(FRAMES)) / FRAMES
    phases = 0.5 * np.arange(len(lines)) ** 2 / len(lines)
    sines = AMPLITUDE * np.sin(2.0 * math.pi * (turns + phases[:, None]))
    return np.asarray(sines.sum(axis=0), dtype=np.float64)
