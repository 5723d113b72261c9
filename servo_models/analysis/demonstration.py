"""What an effect does: the same run without and with it, where it can be seen.

The command steps up, rests, then runs back through zero as a slow ramp: a step shows
delays and limits, the ramp friction, play and steps of a quantiser.  All other effects are
neutral.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis import pictures
from servo_models.analysis.characteristic import Characteristic, characteristic
from servo_models.analysis.explain import (
    Place,
    display_unit,
    effect_name,
    in_display_unit,
    is_actuator,
    places,
)
from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.core.plant import Actuator, Wire

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DURATION = 2.0  # duration of the run in stop times of the actuator
POINTS = 2001  # communication points of the run
BREAKS = (0.0, 0.05, 0.05, 0.45, 0.85, 1.0)  # times of the command's corners over the run's
HEIGHTS = (0.0, 0.0, 1.0, 1.0, -1.0, -1.0)  # command at the corners in standard steps
STRENGTHS = (1.0, 3.0, 10.0, 0.3, 0.1)  # sizes tried in turn, over typical: limits show when low
LOADS = (0.0, 0.3)  # loads tried in turn [full scales]: some effects show only under load
HELD = slice(int(0.35 * POINTS), int(0.45 * POINTS))  # points at which the command rests, the last
VISIBLE = 0.02  # smallest change of the output, over its range, that the eye sees


@dataclass(frozen=True)
class Demonstration:
    """Two runs on one grid.

    Attributes:
        place: where the effect acts.
        neutral, active: switches [SI] of all effects, and those of this one.
        values: its parameters, as a person reads them.
        without, changed: the runs.
        signals: the input that moves and the output to look at.
    """

    place: Place
    neutral: dict[str, float]
    active: dict[str, float]
    values: str
    without: Result
    changed: Result
    signals: tuple[str, str]

    @property
    def law(self) -> Characteristic | None:
        """The effect as textbooks draw it, with the values of the run."""
        actuator = self.place.actuator
        values = actuator.values(None, {**self.neutral, **self.active})
        return characteristic(actuator.plant, values, self.place.name)

    @property
    def visibility(self) -> float:
        """Largest change of the output as a part of its range [1]."""
        before, after = (run[self.signals[1]] for run in (self.without, self.changed))
        return float(np.max(np.abs(after - before)) / np.ptp(before))

    @property
    def hunts(self) -> bool:
        """Whether the effect keeps the output moving under a command that rests."""
        before, after = (run[self.signals[1]] for run in (self.without, self.changed))
        more = np.ptp(after[HELD]) - np.ptp(before[HELD])
        return bool(more > VISIBLE * np.ptp(before))


def demonstrate(effect: str) -> Demonstration:
    """Return the first run in which an effect can be seen, else the one that shows it best.

    An effect on the command itself comes first, since it cannot upset a loop there; then the
    slowest actuator, whose curves are the plainest.  A loop that hunts shows nothing else.
    """
    best: Demonstration | None = None
    for run in _runs(effect):
        if run.visibility > VISIBLE and not run.hunts:
            return run
        if best is None or run.visibility > best.visibility:
            best = run
    assert best is not None, "an effect of the catalogue acts somewhere"
    return best


def _runs(effect: str) -> Iterator[Demonstration]:
    for load in LOADS:
        for place in sorted(places(effect), key=_depth):
            if load and not _load(place.actuator):
                continue
            parameters = place.actuator.plant.parameters.values()
            neutral = {it.name: 0.0 for it in parameters if it.param.switch}
            without = _run(place.actuator, neutral, load)
            for strength in STRENGTHS:
                active = {
                    it.name: min(strength * it.param.typical, it.param.high)
                    for it in place.parameters
                    if it.param.switch
                }
                changed = _run(place.actuator, {**neutral, **active}, load)
                yield Demonstration(
                    place,
                    neutral,
                    active,
                    _shown(place, active),
                    without,
                    changed,
                    (place.actuator.step_of()[0], place.actuator.plant.outputs[0]),
                )


def _depth(place: Place) -> tuple[bool, float]:
    """Sort key: effects on an input first, then the slowest actuator."""
    inputs = {wire.name for wire in place.actuator.plant.inputs}
    return place.placements[0].on[0] not in inputs, -model(place.actuator).stop_time


def _run(actuator: Actuator, parameters: dict[str, float], load: float) -> Result:
    name, value = actuator.step_of()
    wires = actuator.plant.wire
    rest = float(wires[name].rest)
    chosen = model(actuator, None, parameters)
    times = np.linspace(0.0, DURATION * chosen.stop_time, POINTS)
    command = rest + (value - rest) * np.interp(times / times[-1], BREAKS, HEIGHTS)
    inputs = {name: command}
    if against := _load(actuator):
        inputs[against.name] = np.full(POINTS, load * against.scale)
    return simulate(chosen, times, inputs)


def _load(actuator: Actuator) -> Wire | None:
    """The input for a load against the motion, None if the actuator has none."""
    return next((wire for wire in actuator.plant.inputs if wire.name.startswith("load_")), None)


def _shown(place: Place, active: dict[str, float]) -> str:
    """Parameters with values, the place's name on the first one only."""
    texts: list[str] = []
    for name, value in active.items():
        parameter = place.actuator.plant.parameters[name]
        shown = name.removeprefix(place.name) if texts else name
        unit = display_unit(parameter)
        texts.append(f"{shown} = {in_display_unit(value, parameter)} {unit}".rstrip())
    return ", ".join(texts)


def portrait(name: str, variant: str | None = None) -> Figure:
    """Return the picture of an actuator's standard step, or of an effect: its law, then at work.

    Args:
        name: as in ``explain``.
        variant: of the actuator, by default the first one.

    Raises:
        UserError: nobody knows that name.
    """
    if is_actuator(name):
        chosen = model(name, variant)
        times = np.linspace(0.0, chosen.stop_time, POINTS)
        return pictures.response(simulate(chosen, times, dict([chosen.step])))
    effect = effect_name(name)
    shown = demonstrate(effect)
    actuator = shown.place.actuator
    title = f"{effect} on {actuator.name}"
    wire = _load(actuator)
    if wire and (load := shown.without[wire.name][0]):
        title += f", {wire.name.replace('_', ' ')} {load:g} {wire.unit}"
    runs = shown.without, shown.changed
    return pictures.comparison(*runs, actuator.plant, shown.signals, title, shown.values, shown.law)
