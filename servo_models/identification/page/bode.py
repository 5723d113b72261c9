"""Section: frequency response of the fitted model, for small signals and beside the logs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.linearise import linearise
from servo_models.analysis.sine_test import hold
from servo_models.core.plant import Wire
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.page.empirical import Empirical, Record, empirical
from servo_models.identification.page.readings import words
from servo_models.identification.result import Identification
from servo_models.report.parts import Section
from servo_models.report.style import Picture, colour, drawing, picture
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Complex = NDArray[np.complex128]
Curve = tuple[Array, Complex]

TITLE = "Frequency response"
FINE = 300
"""Points of a line."""
POINTS = (
    "Circles: the logs, where at least 80 % of the output's power goes with the input."
    " Dots: the same estimate on the fitted model's responses to the same inputs."
)
LINE = "Line: the fitted model for small signals, its input held from sample to sample."
SILENT = "the logs are too short, or nothing in them goes with the input coherently"


@dataclass(frozen=True, eq=False)
class Pair:
    """An input and an output that logs relate."""

    input: Wire
    output: Wire
    records: tuple[Record, ...]

    @property
    def title(self) -> str:
        return f"{words(self.output.name)} over {words(self.input.name)}"

    @property
    def scale(self) -> float:
        """Gain in the units that a person reads over that in SI."""
        given, wanted = (factor(wire.unit, _unit(wire)) for wire in (self.input, self.output))
        return wanted / given

    @property
    def decibel(self) -> str:
        """What 0 dB is."""
        given, wanted = _unit(self.input), _unit(self.output)
        return "dB" if given == wanted else f"dB re {wanted}/{given}"

    @property
    def step(self) -> float:
        """Sampling step [s] of the slowest record."""
        return max(float(np.median(np.diff(record.times))) for record in self.records)


def _unit(wire: Wire) -> str:
    return wire.display or wire.unit


def section(found: Identification) -> Section | None:
    """Return a Bode plot for each input and output that logs relate, and what it lacks."""
    pairs = _pairs(found)
    if not pairs:
        return None
    linear, said = _small_signals(found)
    pictures: list[Picture] = []
    for pair in pairs:
        seen = empirical(pair.records, pair.step)
        line = _line(pair, seen, linear) if linear else None
        if seen is None:
            said.append(f"No measured response of {pair.title}: {SILENT}.")
        if linear and line is None:
            said.append(f"Nothing small passes from {pair.input.name} to {pair.output.name}.")
        if seen or line:
            pictures.append(_picture(pair, seen, line, f"bode-{len(pictures)}"))
    return Section("bode", TITLE, pictures=tuple(pictures), items=tuple(said))


def _pairs(found: Identification) -> list[Pair]:
    wires = found.fitted.plant.wire
    related: dict[tuple[str, str], list[Record]] = {}
    for log, after in zip(found.logs, found.after):
        for name, values in log.inputs.items():
            for output, measured in log.outputs.items():
                if np.ptp(values) > 0.0 and not wires[output].flag:
                    record = Record(log.times, values, measured, after[output])
                    related.setdefault((name, output), []).append(record)
    return [Pair(wires[i], wires[o], tuple(records)) for (i, o), records in related.items()]


def _small_signals(found: Identification) -> tuple[LinearModel | None, list[str]]:
    """The linear model where the first log begins, and what is missing from it."""
    log = found.logs[0]
    model = found.fitted
    settings = {**log.constants, **{name: float(u[0]) for name, u in log.inputs.items()}}
    inputs = {wire.name for wire in model.plant.inputs}
    fixed = {name: value for name, value in settings.items() if name not in inputs}
    at = {name: value for name, value in settings.items() if name in inputs}
    try:
        linear = linearise(replace(model, values={**model.values, **fixed}), at)
    except UserError as error:
        return None, [f"No response for small signals: {error}."]
    reasons = linear.left_out.items()
    return linear, [f"Small signals do not show '{name}': {reason}." for name, reason in reasons]


def _line(pair: Pair, seen: Empirical | None, linear: LinearModel) -> Curve | None:
    """Frequencies [Hz] and response for small signals, None where they do not pass."""
    nyquist = 0.5 / pair.step
    low, high = 1.0 / max(record.times[-1] for record in pair.records), nyquist
    if seen:
        low, high = 0.5 * seen.hertz[0], min(2.0 * seen.hertz[-1], nyquist)
    hertz = np.geomspace(low, high, FINE)
    response = linear.response(hertz, pair.input.name, pair.output.name)
    if not np.all(response):
        return None
    return hertz, response if linear.period else response * hold(2.0 * np.pi * hertz, pair.step)


def _picture(pair: Pair, seen: Empirical | None, line: Curve | None, name: str) -> Picture:
    with drawing(name, rows=2, height=4.2) as (figure, (gain, phase)):
        turns = None
        if line:
            hertz, response = line
            turns = hertz, np.degrees(np.unwrap(np.angle(response)))
            gain.plot(hertz, _decibel(pair, response), color=colour("blue"), lw=1.3)
            phase.plot(*turns, color=colour("blue"), lw=1.3)
        if seen:
            _points(pair, seen, (gain, phase), turns)
        gain.set(xscale="log", ylabel=f"gain [{pair.decibel}]")
        phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
        phase.locator_params(axis="y", nbins=6, steps=[1, 1.5, 3, 4.5, 9, 10])
        text = " ".join((*[LINE] * bool(line), *[POINTS] * bool(seen)))
        return picture(figure, name, pair.title, text)


def _points(
    pair: Pair, seen: Empirical, panels: tuple[Axes, Axes], turns: tuple[Array, Array] | None
) -> None:
    """Draw what was measured and simulated; phases go by the turns of the line, if there is one."""
    gain, phase = panels
    if turns:
        simulated = beside(np.interp(seen.hertz, *turns), seen.simulated)
    else:
        simulated = np.degrees(np.unwrap(np.angle(seen.simulated)))
    for axes, logs, model in (
        (gain, _decibel(pair, seen.measured), _decibel(pair, seen.simulated)),
        (phase, beside(simulated, seen.measured), simulated),
    ):
        axes.plot(seen.hertz, logs, "o", color=colour("ink"), mfc="none", ms=6, mew=1.0)
        axes.plot(seen.hertz, model, "o", color=colour("orange"), ms=3.5, mew=0.0)


def beside(reference: Array, response: Complex) -> Array:
    """Return the phase [deg] of a response in the turn that is nearest to ``reference``."""
    degrees = np.degrees(np.angle(response))
    return np.asarray(reference + (degrees - reference + 180.0) % 360.0 - 180.0)


def _decibel(pair: Pair, response: Complex) -> Array:
    return np.asarray(20.0 * np.log10(pair.scale * np.abs(response)))
