"""The effects that may cause a gap: every effect of the actuator that the model has switched off.

A candidate is an effect with its free parameters and the values at which it is tried before
anything is fitted, by its own search hints: a few over the typical one, of both signs where the
bounds allow.  Of a discontinuous parameter, or a ripple, no slope leads to the best value: there
they are a grid, and what the logs themselves show of a quantum is among them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.block import Grid, Hints
from servo_models.core.plant import Parameter, Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.sensor import off_neighbours
from servo_models.diagnosis.codes import Step, steps_under_noise
from servo_models.identification.problem import Free, free_parameter, travel
from servo_models.identification.simulation import prepared

SURE_OF_RANGE = 0.9  # share of a measured range that play and the gain of a reading leave sure
LEAST_SAMPLES_IN_A_PERIOD = 10.0  # samples in a period of the fastest resonance that logs can show
LEAST_RIPPLE_PERIODS_IN_TRAVEL = 0.7  # fewest periods in the travel: fewer look like any load
RESONANCE_REACH_FACTOR = 4.0  # reach of compliance and inertia in a fit: fast ones run slowly


@dataclass(frozen=True)
class Candidate:
    """An effect at its place, off in the model.

    Attributes:
        name: name of the place, such as ``"drive_dead_zone"``.
        hints: what its file says of it.
        free: its parameters, and ``switches`` those of them that switch it on.
        trial_values: settings [SI] to try first; none where logs show that it is not there.
        grid: many more trial values of a discontinuous parameter, which only a search finds.
        fastest: least product of compliance and inertia [s2]: of a faster resonance the logs
            have too few samples in a period, and it is slow to simulate.
        alone: what each of the trial values changes from where nominal parameters go, empty before
            that is simulated.
    """

    name: str
    hints: Hints
    free: tuple[Free, ...]
    switches: tuple[str, ...]
    trial_values: tuple[Values, ...]
    grid: tuple[Values, ...] = ()
    fastest: float = 0.0
    alone: tuple[Array, ...] = ()

    @property
    def discontinuous(self) -> bool:
        """Whether the response jumps as the switch changes, so that no slope leads to it."""
        return self.hints.grid is not None

    @property
    def late(self) -> bool:
        """Whether its switch is a period, by a part of which it is late."""
        return self.hints.grid is not None and self.hints.grid.divides == "duration"

    @property
    def ripple(self) -> tuple[str, str] | None:
        """Switch and phase of a sine: it is tried with a phase of 0 and of a quarter turn."""
        phase = self.hints.phase
        return (self.switches[0], f"{self.name}.{phase}") if phase else None

    @property
    def jump(self) -> Free | None:
        """The part of a jump that it has, one of its parameters; None of most effects."""
        jump = self.hints.jump and f"{self.name}.{self.hints.jump}"
        return next((it for it in self.free if it.name == jump), None)

    @property
    def trials(self) -> int:
        """How many values and shapes there were to choose from, at least 1."""
        return max(len(self.trial_values) + len(self.grid), 1)

    def shape_at(self, settings: Values) -> tuple[tuple[str, float], ...]:
        """Return the shape that ``settings`` give, to which slopes hardly lead.

        A ripple has one for each count.  Inertia and compliance of a resonance are no shape and
        size, but as good as two sizes.
        """
        if self.fastest:
            return ()
        sizes = (*self.switches, *(self.ripple or ()))
        return tuple((name, 0.0 if name in sizes else it) for name, it in settings.items())

    def at(self, settings: Values) -> tuple[Free, ...]:
        """Return the parameters with the starts that ``settings`` give.

        A switch that they do not name is as good as off, as it was where they were tried.
        """
        off = {name: 0.0 for name in self.switches} if settings.keys() & self.switches else {}
        starts = {it.name: it.start for it in self.free} | off | settings
        started = tuple(
            replace(it, start=min(max(starts[it.name], it.low), it.high)) for it in self.free
        )
        if not self.hints.inertia:
            return started
        compliance, inertia = self.switches[0], f"{self.name}.{self.hints.inertia}"
        softest = self.fastest / next(it.start for it in started if it.name == inertia)
        least = {compliance: softest, inertia: 0.0}
        return tuple(_near(it, least[it.name]) if it.name in least else it for it in started)


def candidates(
    model: Model, logs: Sequence[Log], left_out: Iterable[str] = ()
) -> tuple[Candidate, ...]:
    """Return the effects that a model has switched off, without those ``left_out``.

    The logs have a say in the trial values.
    """
    skipped = set(left_out)
    owned: dict[str, list[Parameter]] = {}
    for parameter in model.plant.parameters.values():
        if parameter.owner:
            owned.setdefault(parameter.owner, []).append(parameter)
    switched_off = []
    for name, parameters in owned.items():
        effect = _Off(model, logs, name, parameters)
        on = any(model.values[p.name] != 0.0 for p in parameters if p.param.switch)
        hints = effect.hints
        vain = hints.learnt or (hints.of_changes and _never_changes(model, logs, effect.wire))
        vain = vain or any(effect.exceeded >= it.param.high for it in effect.switches)
        if effect.switches and not on and not vain and name not in skipped:
            switched_off.append(effect.candidate())
    return tuple(switched_off)


def _never_changes(model: Model, logs: Iterable[Log], wire: str) -> bool:
    """Whether a wire is an input that has one value in all logs."""
    if wire not in {it.name for it in model.plant.inputs}:
        return False
    rest = model.plant.wire[wire].rest
    values = [{*log.inputs.get(wire, [log.constants.get(wire, rest)])} for log in logs]
    return len(set().union(*values)) < 2


class _Off:
    """An effect that is off in a model, at its place, and the logs that may have it."""

    def __init__(
        self, model: Model, logs: Sequence[Log], name: str, parameters: list[Parameter]
    ) -> None:
        self.model, self.plant, self.logs, self.name = model, model.plant, logs, name
        self.switches = [p for p in parameters if p.param.switch and p.param.typical > 0.0]
        main = model.plant.main(name)
        self.hints, self.wire = main.effect.hints, main.on[0]
        self.shape = [
            it for it in parameters if not it.param.switch and it.key not in self.hints.not_at_first
        ]
        # codes of the very signal tell whether and how it is quantised
        self.has_codes = self.hints.signature == "codes"
        self.reads_codes = self.has_codes and any(self.wire in log.outputs for log in logs)
        self.exceeded = self._exceeded()

    def _exceeded(self) -> float:
        """A limit that readings of the limited signal surely exceed, those held out as well: by
        their range, since their zero may be off, and without single wild ones; 0 for none."""
        readings = [
            values - off_neighbours(values)
            for log in self.logs
            for name in self.hints.limited
            if (values := log.outputs.get(name or self.wire)) is not None
        ]
        return SURE_OF_RANGE * 0.5 * float(np.ptp(np.concatenate(readings))) if readings else 0.0

    def candidate(self) -> Candidate:
        interval = min((log.interval for log in self.logs), default=0.0)
        fastest = (LEAST_SAMPLES_IN_A_PERIOD * interval / (2.0 * math.pi)) ** 2
        return Candidate(
            name=self.name,
            hints=self.hints,
            free=tuple(map(self.free, [*self.switches, *self.shape])),
            switches=tuple(it.name for it in self.switches),
            trial_values=tuple(self.trial_values()),
            grid=tuple(self.grid()),
            fastest=fastest if self.hints.inertia else 0.0,
        )

    def free(self, parameter: Parameter) -> Free:
        """One of its parameters within its reach."""
        free = free_parameter(parameter, self.model.values[parameter.name], None)
        low = free.low
        if parameter is self.shaped(self.hints.count):  # so many periods in the travel at least
            least = LEAST_RIPPLE_PERIODS_IN_TRAVEL * 2.0 * math.pi / travel(self.plant, self.logs)
            low = min(max(low, least), 0.5 * free.high)
        elif parameter.param.switch and free.start > 0.0 and low >= 0.0:
            low = max(low, LEAST_OVER_TYPICAL * free.start, self.exceeded)
        return replace(free, low=low, start=max(free.start, low))

    def shaped(self, key: str) -> Parameter | None:
        """One of its parameters that are no switches."""
        return next((it for it in self.shape if it.key == key), None)

    def trial_values(self) -> list[Values]:
        """Values to try first."""
        switch, inertia = self.switches[0], self.shaped(self.hints.inertia)
        if self.hints.phase:
            return ripples(switch, self.shaped(self.hints.count), self.plant, self.logs)
        if inertia:
            return resonances(switch, inertia)
        if self.reads_codes:
            steps = quanta(switch, [self.wire], self.logs)
            return about_codes(switch, (it for it in steps if it.sure))
        values = few(self.hints, self.switches, self.shape)
        if self.exceeded:
            larger = [it for it in values if it[switch.name] > self.exceeded]
            return [{switch.name: self.exceeded}, *larger]
        if self.has_codes:
            wires = self.plant.wire
            alike = [it for it in self.plant.outputs if wires[it].unit == wires[self.wire].unit]
            values += [{switch.name: it.size} for it in quanta(switch, alike, self.logs)]
        return values

    def grid(self) -> list[Values]:
        """Many values of a discontinuous parameter, unless codes tell it."""
        grid = self.hints.grid
        if grid is None or self.reads_codes:
            return []
        if grid.divides == "duration":
            parts = [log.duration + log.settle for log in self.logs]
            least = min((log.interval for log in self.logs), default=math.inf)
        else:
            parts = [_range(self.model, log, self.wire) for log in self.logs]
            least = math.inf
        return on_grid(grid, self.switches[0], max(parts, default=math.inf), least)


def _range(model: Model, log: Log, wire: str) -> float:
    """Range of a signal in a log, measured or else simulated.

    One that is neither input nor output has about that of the least signal of its unit: the
    command of a loop that of its feedback, which a controller makes larger.
    """
    plant = model.plant
    simulated = dict(zip(plant.outputs, prepared(model, log).simulate({}).T))
    ranges = {name: float(np.ptp(it)) for name, it in {**simulated, **log.inputs}.items()}
    ranges |= {name: float(np.ptp(it)) for name, it in log.outputs.items()}
    if wire in ranges:
        return ranges[wire]
    alike = [it for name, it in ranges.items() if plant.wire[name].unit == plant.wire[wire].unit]
    return min((it for it in alike if it > 0.0), default=math.inf)


def _near(free: Free, least: float) -> Free:
    """The same, a parameter of a resonance within reach of its start and not below ``least``."""
    # what is slow is kept out by being near, not by being small against the typical size
    low = min(max(free.start / RESONANCE_REACH_FACTOR, least), free.start)
    return replace(free, low=low, high=min(free.high, free.start * RESONANCE_REACH_FACTOR))


TRIALS_OVER_TYPICAL = (0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.5, 10.0)
"""Trial values of a switch whose effect has none of its own."""
SIGNED_TRIALS_OVER_TYPICAL = (0.3, 3.0)  # trial values of either sign: nearly straight response
SHAPED_TRIALS_OVER_TYPICAL = (0.02, 0.1, 0.5, 2.0, 8.0)  # trial values for each shape
SHAPE_TRIALS_OVER_DEFAULT = (0.1, 0.3, 1.0, 3.0, 10.0)  # trial values of what is no switch
GRID_SPACING_IN_PERIODS = 0.1  # move of the last period in a log from one grid value to the next
LARGEST_RELATIVE_GRID_SPACING = 0.06  # spacing of grid values over the value
INERTIAS_OVER_DEFAULT = (0.03, 0.1, 0.3, 1.0, 3.0)  # trial inertias behind a compliance
RESONANCES_OVER_DEFAULT = (0.5, 1.0, 2.0, 4.0, 8.0)  # trial frequencies of such a resonance
RIPPLE_OVER_TYPICAL = 0.3  # amplitude at which a ripple is tried: its response is straight
RIPPLE_COUNTS = 48  # trial values of the count of a ripple
COUNT_SPACING_RAD = 1.5  # change of a ripple's phase over the travel from one count to the next
LEAST_OVER_TYPICAL = 0.01  # least size of a switch in a fit: a smaller one is none, and may be slow
LEAST_RELATIVE_CODE_SPACING = 0.001  # spacing of trial values about a step in a code histogram
CODE_TRIALS_TO_A_SIDE = 4  # trial values above such a step, and as many below
CODE_TRIALS_REACH_IN_STANDARD_ERRORS = 3.0  # distance of the farthest from it

Values = dict[str, float]


def resonances(compliance: Parameter, inertia: Parameter) -> list[Values]:
    """Return loads on a spring, of several inertias and frequencies."""
    typical = compliance.param.typical
    return [
        {
            inertia.name: weight * inertia.param.default,
            compliance.name: typical / (weight * pitch**2),
        }
        for weight in INERTIAS_OVER_DEFAULT
        for pitch in RESONANCES_OVER_DEFAULT
        if typical / (weight * pitch**2) <= compliance.param.high
    ]


def ripples(
    switch: Parameter, count: Parameter | None, plant: Plant, logs: Iterable[Log]
) -> list[Values]:
    """Return counts of a ripple so near each other that the best is not missed between two."""
    size = {switch.name: RIPPLE_OVER_TYPICAL * switch.param.typical}
    if count is None:
        return [size]
    apart = COUNT_SPACING_RAD / travel(plant, logs)
    grid = [2.0 * np.pi / COUNT_SPACING_RAD * apart + k * apart for k in range(RIPPLE_COUNTS)]
    inside = [it for it in grid if it <= count.param.high] or [count.param.high]
    return [{**size, count.name: it} for it in inside]


def few(hints: Hints, switches: Iterable[Parameter], shape: Sequence[Parameter]) -> list[Values]:
    """Return a few values of each switch of an effect, with each of its shapes."""
    usual = SHAPED_TRIALS_OVER_TYPICAL if shape else TRIALS_OVER_TYPICAL
    forms = _shapes(shape)
    tried = []
    for switch in switches:
        param = switch.param
        shares = hints.trial_values or (SIGNED_TRIALS_OVER_TYPICAL if param.low < 0.0 else usual)
        both = [sign * share * param.typical for share in shares for sign in (1.0, -1.0)]
        sizes = [size for size in both if param.low <= size <= param.high]
        tried += [{switch.name: size, **form} for size in sizes for form in forms]
    return tried


def on_grid(grid: Grid, switch: Parameter, divided: float, least: float = math.inf) -> list[Values]:
    """Return the many values of a discontinuous parameter, the largest first.

    ``divided`` [SI] is what they divide, infinity where unknown: the range of a signal, or the
    duration of a log.  The more periods or codes there are, the narrower is the minimum.  Logs show
    values down to ``least``, where that is less than the end of the grid.
    """
    param = switch.param
    low = max(min(grid.low * param.typical, least), LEAST_OVER_TYPICAL * param.typical, param.low)
    size = min(grid.high * param.typical, param.high)
    values = []
    while size >= low:
        values.append({switch.name: size})
        relative = GRID_SPACING_IN_PERIODS * size / divided if divided > 0.0 else math.inf
        relative = min(max(relative, grid.least_spacing), LARGEST_RELATIVE_GRID_SPACING)
        size *= 1.0 - relative
    return values


def quanta(switch: Parameter, readings: Iterable[str], logs: Sequence[Log]) -> list[Step]:
    """Return the steps that code histograms of some readings suggest."""
    records = ([log.outputs[name] for log in logs if name in log.outputs] for name in readings)
    steps = [step for values in records if values for step in steps_under_noise(values)]
    least = LEAST_OVER_TYPICAL * switch.param.typical
    return [step for step in steps if least <= step.size <= switch.param.high]


def about_codes(switch: Parameter, steps: Iterable[Step]) -> list[Values]:
    """Return values about the steps that a code histogram of the quantised signal shows."""
    n, reach = CODE_TRIALS_TO_A_SIDE, CODE_TRIALS_REACH_IN_STANDARD_ERRORS
    return [
        {switch.name: size + k * max(LEAST_RELATIVE_CODE_SPACING * size, reach * error / n)}
        for size, error, _ in steps
        for k in range(-n, n + 1)
    ]


def _shapes(shape: Iterable[Parameter]) -> list[Values]:
    """Shapes to try: the default, and each parameter apart from it."""
    forms: dict[tuple[str, float], None] = {}
    for parameter in shape:
        param = parameter.param
        for share in SHAPE_TRIALS_OVER_DEFAULT:
            forms[parameter.name, min(max(share * param.default, param.low), param.high)] = None
    return [{name: value} for name, value in forms] or [{}]
