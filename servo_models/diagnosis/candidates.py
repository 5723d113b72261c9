"""The effects that may cause a gap: every effect of the actuator that the model has switched off.

A candidate is a parameter vector: its switches at some trial value, its shape at the default.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.block import Hints
from servo_models.core.plant import Parameter
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.trial_values import (
    LEAST_OVER_TYPICAL,
    Settings,
    about_codes,
    few,
    on_grid,
    quanta,
    resonances,
    ripples,
    travel,
)
from servo_models.identification.problem import Free, free_parameter
from servo_models.identification.simulation import prepared

LEAST_SAMPLES_IN_A_PERIOD = 10.0
"""Of the fastest resonance that logs can show."""
LEAST_RIPPLE_PERIODS_IN_TRAVEL = 0.7
"""With less, a ripple looks like any load."""
RESONANCE_REACH_FACTOR = 4.0
"""By which a fit may move compliance and inertia: a high frequency is slow to simulate."""


@dataclass(frozen=True)
class Candidate:
    """An effect at its place, off in the model.

    Attributes:
        name: of the place, such as ``"drive_dead_zone"``.
        hints: what its file says of it.
        free: its parameters, and ``switches`` those of them that switch it on.
        trial_values: settings [SI] to try first; none where logs show that it is not there.
        grid: of a discontinuous parameter that nothing but a search finds, many more of them.
        fastest: least product of compliance and inertia [s2]: of a faster resonance the logs
            have too few samples in a period, and it is slow to simulate.
        alone: what each of the trial values changes from where nominal parameters go, empty before
            that is simulated.
    """

    name: str
    hints: Hints
    free: tuple[Free, ...]
    switches: tuple[str, ...]
    trial_values: tuple[Settings, ...]
    grid: tuple[Settings, ...] = ()
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

    def shape_at(self, settings: Settings) -> tuple[tuple[str, float], ...]:
        """Return the shape that ``settings`` give, to which slopes hardly lead.

        A ripple has one for each count.  Inertia and compliance of a resonance are no shape and
        size, but as good as two sizes.
        """
        if self.fastest:
            return ()
        sizes = (*self.switches, *(self.ripple or ()))
        return tuple((name, 0.0 if name in sizes else it) for name, it in settings.items())

    def at(self, settings: Settings) -> tuple[Free, ...]:
        """Return the parameters with the starts that ``settings`` give.

        A switch that they do not name is as good as off, as it was where they were tried.
        """
        off = {name: 0.0 for name in self.switches} if settings.keys() & self.switches else {}
        starts = {**off, **settings}
        started = tuple(
            replace(it, start=_inside(it, starts.get(it.name, it.start))) for it in self.free
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
    found = []
    for name, parameters in owned.items():
        switches = [p for p in parameters if p.param.switch and p.param.typical > 0.0]
        on = any(model.values[p.name] != 0.0 for p in parameters if p.param.switch)
        if switches and not on and name not in skipped:
            found.append(_Off(model, logs, name, switches, parameters).candidate())
    return tuple(found)


class _Off:
    """An effect that is off in a model, at its place, and the logs that may have it."""

    def __init__(
        self,
        model: Model,
        logs: Sequence[Log],
        name: str,
        switches: list[Parameter],
        parameters: list[Parameter],
    ) -> None:
        self.model, self.logs, self.name, self.switches = model, logs, name, switches
        self.plant = model.plant
        main = model.plant.main(name)
        self.hints, self.wire = main.effect.hints, main.on[0]
        self.shape = [
            it for it in parameters if not it.param.switch and it.key not in self.hints.assumed
        ]
        # codes of the very signal tell whether and how it is quantised
        self.has_codes = self.hints.signature == "codes"
        self.reads_codes = self.has_codes and any(self.wire in log.outputs for log in logs)

    def candidate(self) -> Candidate:
        return Candidate(
            name=self.name,
            hints=self.hints,
            free=self.free(),
            switches=tuple(it.name for it in self.switches),
            trial_values=tuple(self.trial_values()),
            grid=tuple(self.grid()),
            fastest=_fastest(self.logs) if self.hints.inertia else 0.0,
        )

    def free(self) -> tuple[Free, ...]:
        """Its parameters within its reach: those that switch it on, then its shape."""
        values = self.model.values
        free = [_narrowed(free_parameter(it, values[it.name], None)) for it in self.switches]
        for parameter in self.shape:
            one = free_parameter(parameter, values[parameter.name], None)
            free.append(self.periodic(one) if parameter is self.shaped(self.hints.count) else one)
        return tuple(free)

    def shaped(self, key: str) -> Parameter | None:
        """One of its parameters that are no switches."""
        return next((it for it in self.shape if it.key == key), None)

    def periodic(self, free: Free) -> Free:
        """A count with so many periods in the travel at least."""
        travelled = travel(self.plant, self.logs)
        least = LEAST_RIPPLE_PERIODS_IN_TRAVEL * 2.0 * math.pi / travelled
        low = min(max(free.low, least), 0.5 * free.high)
        return replace(free, low=low, start=max(free.start, low))

    def trial_values(self) -> list[Settings]:
        """Settings to try first."""
        switch, inertia = self.switches[0], self.shaped(self.hints.inertia)
        if self.hints.phase:
            return ripples(switch, self.shaped(self.hints.count), self.plant, self.logs)
        if inertia:
            return resonances(switch, inertia)
        if self.reads_codes:
            steps = quanta(switch, [self.wire], self.logs)
            return about_codes(switch, (it for it in steps if it.sure))
        found = few(self.hints, self.switches, self.shape)
        if self.has_codes:
            found += [{switch.name: it.size} for it in quanta(switch, self.like_it(), self.logs)]
        return found

    def like_it(self) -> list[str]:
        """Outputs in the unit of the signal that it acts on."""
        wires = self.plant.wire
        return [it for it in self.plant.outputs if wires[it].unit == wires[self.wire].unit]

    def grid(self) -> list[Settings]:
        """Many values of a discontinuous parameter, unless codes tell it."""
        grid = self.hints.grid
        if grid is None or self.reads_codes:
            return []
        if grid.divides == "duration":
            parts = [log.duration + log.settle for log in self.logs]
        else:
            parts = [_range(self.model, log, self.wire) for log in self.logs]
        return on_grid(grid, self.switches[0], max(parts, default=math.inf))


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


def _inside(free: Free, value: float) -> float:
    return min(max(value, free.low), free.high)


def _near(free: Free, least: float) -> Free:
    """The same, a parameter of a resonance within reach of its start and not below ``least``."""
    # what is slow is kept out by being near, not by being small against the typical size
    low = min(max(free.start / RESONANCE_REACH_FACTOR, least), free.start)
    return replace(free, low=low, high=min(free.high, free.start * RESONANCE_REACH_FACTOR))


def _fastest(logs: Iterable[Log]) -> float:
    """Square of the shortest 1 / angular frequency [s] of which logs have enough samples."""
    steps = [float(np.median(np.diff(log.times))) for log in logs if len(log.times) > 1]
    return (LEAST_SAMPLES_IN_A_PERIOD * min(steps, default=0.0) / (2.0 * math.pi)) ** 2


def _narrowed(free: Free) -> Free:
    """A free switch, a share of its start at least where that is positive."""
    if free.start <= 0.0:
        return free
    low = max(free.low, LEAST_OVER_TYPICAL * free.start) if free.low >= 0.0 else free.low
    return replace(free, low=low)
