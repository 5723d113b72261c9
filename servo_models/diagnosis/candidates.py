"""The effects that may cause a gap: every effect of the actuator that the model has switched off.

A cause is a parameter vector: its switches at some size, its shape at the default.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.plant import Parameter, Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.recording import Log
from servo_models.diagnosis.sizes import (
    CHOICES,
    COUNT,
    JUMP_PARTS,
    LEAST,
    LIMITING,
    NEAR,
    RESONANT,
    STAIRS,
    Settings,
    fine,
    near_to,
    quanta,
    resonances,
    ripple_of,
    ripples,
    shares,
    travel,
)
from servo_models.identification.problem import Free, free_parameter
from servo_models.identification.simulation import prepared

SHOWN = 10.0
"""Samples in a period of the fastest resonance that logs can show."""
PERIODS = 0.7
"""Periods of a ripple that the logs have to show at least."""


@dataclass(frozen=True)
class Candidate:
    """An effect at its place, off in the model.

    Attributes:
        name: of the place, such as ``"drive_dead_zone"``.
        wire: on which it acts.
        free: its parameters, and ``switches`` those of them that switch it on.
        sizes: settings [SI] to look at first; none where logs show that it is not there.
        stairs: whether the response is a staircase of the size, which no slope leads to.
        fine: of a staircase that nothing but a search finds, many more sizes for a second look.
        ripple: its switch and its phase, if it has one: each size is then to be looked at
            with a phase of 0 and of a quarter turn.
        jump: the part of a jump that it has, one of its parameters; None of most effects.
        fastest: least product of compliance and inertia [s2]: of a faster resonance the logs
            have too few samples in a period, and it is slow to simulate.
        late: whether its size is a period, by a part of which it is late.
        limiting: whether it does the more the smaller its size is, at sizes near each other.
        alone: what each of the sizes changes from where nominal parameters go, empty before a look.
    """

    name: str
    wire: str
    free: tuple[Free, ...]
    switches: tuple[str, ...]
    sizes: tuple[Settings, ...]
    stairs: bool = False
    fine: tuple[Settings, ...] = ()
    ripple: tuple[str, str] | None = None
    jump: Free | None = None
    fastest: float = 0.0
    late: bool = False
    limiting: bool = False
    alone: tuple[Array, ...] = ()

    @property
    def trials(self) -> int:
        """How many sizes and shapes there were to choose from, at least 1."""
        return max(len(self.sizes) + len(self.fine), 1)

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

        A switch that they do not name is as good as off, as it was where they were looked at.
        """
        off = {name: 0.0 for name in self.switches} if settings.keys() & self.switches else {}
        starts = {**off, **settings}
        started = [
            replace(it, start=_inside(it, starts.get(it.name, it.start))) for it in self.free
        ]
        kinds = {it.name.rpartition(".")[2]: it for it in started}
        if not kinds.keys() >= set(RESONANT):
            return tuple(started)
        softest = self.fastest / kinds[RESONANT[1]].start
        return tuple(_near(it, softest if it is kinds[RESONANT[0]] else 0.0) for it in started)


def candidates(
    model: Model, logs: Sequence[Log], left_out: Iterable[str] = ()
) -> tuple[Candidate, ...]:
    """Return the effects that a model has switched off, without those ``left_out``.

    The logs have a say in the sizes to look at.
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
            found.append(_candidate(model, logs, name, switches, parameters))
    return tuple(found)


def _candidate(
    model: Model,
    logs: Sequence[Log],
    name: str,
    switches: list[Parameter],
    parameters: list[Parameter],
) -> Candidate:
    effect = model.plant.placements[name][0].effect.name
    wire = model.plant.main_wire(name)
    shape = [
        p for p in parameters if not p.param.switch and p.name.rpartition(".")[2] not in CHOICES
    ]
    free = _freed(model, logs, switches, shape)
    phase, part = ripple_of(name, shape), JUMP_PARTS.get(effect)
    sizes = _sizes(model.plant, logs, name, switches, shape)
    searched = effect in STAIRS and not _reads(effect, wire, logs)
    whole = _whole(model, logs, effect, wire) if searched else 0.0
    return Candidate(
        name=name,
        wire=wire,
        free=free,
        switches=tuple(it.name for it in switches),
        sizes=tuple(sizes),
        stairs=effect in STAIRS,
        fine=tuple(fine(effect, switches[0], whole)) if searched else (),
        ripple=(switches[0].name, phase) if phase else None,
        jump=next((it for it in free if part and it.name == f"{name}.{part}"), None),
        fastest=_fastest(logs) if _inertia(name, shape) else 0.0,
        late=effect == "sample_hold",
        limiting=effect in LIMITING,
    )


def _freed(
    model: Model, logs: Sequence[Log], switches: Iterable[Parameter], shape: Iterable[Parameter]
) -> tuple[Free, ...]:
    """The parameters of an effect within its reach: those that switch it on, then its shape."""
    free = [_narrowed(model, p) for p in switches]
    free += [free_parameter(p, model.values[p.name], None) for p in shape]
    once = PERIODS * 2.0 * math.pi / travel(model.plant, logs)
    return tuple(_periodic(it, once) for it in free)


def _sizes(
    plant: Plant,
    logs: Sequence[Log],
    name: str,
    switches: Sequence[Parameter],
    shape: Sequence[Parameter],
) -> list[Settings]:
    """Settings of an effect to look at first."""
    effect, switch = plant.placements[name][0].effect.name, switches[0]
    wire = plant.main_wire(name)
    inertia = _inertia(name, shape)
    if ripple_of(name, shape):
        return ripples(switch, shape, plant, logs)
    if inertia:
        return resonances(switch, inertia)
    if _reads(effect, wire, logs):
        # codes of the very signal tell whether and how it is quantised
        return near_to(switch, (it for it in quanta(switch, [wire], logs) if it.sure))
    found = shares(effect, switches, shape)
    if effect == "quantisation":
        alike = [it for it in plant.outputs if plant.wire[it].unit == plant.wire[wire].unit]
        found += [{switch.name: it.size} for it in quanta(switch, alike, logs)]
    return found


def _inertia(name: str, shape: Iterable[Parameter]) -> Parameter | None:
    """The inertia of an effect that is a resonance, None of any other."""
    return next((p for p in shape if p.name == f"{name}.{RESONANT[1]}"), None)


def _reads(effect: str, wire: str, logs: Iterable[Log]) -> bool:
    """Whether an effect quantises a signal that is logged."""
    return effect == "quantisation" and any(wire in log.outputs for log in logs)


def _whole(model: Model, logs: Sequence[Log], effect: str, wire: str) -> float:
    """What the stairs of an effect divide [SI], infinity where unknown."""
    if effect == "sample_hold":
        return max((log.duration + log.settle for log in logs), default=math.inf)
    return max((_range(model, log, wire) for log in logs), default=math.inf)


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
    if free.name.rpartition(".")[2] not in RESONANT:
        return free
    # what is slow is kept out by being near, not by being small against the typical size
    low = min(max(free.start / NEAR, least), free.start)
    return replace(free, low=low, high=min(free.high, free.start * NEAR))


def _fastest(logs: Iterable[Log]) -> float:
    """Square of the shortest 1 / angular frequency [s] of which logs have enough samples."""
    steps = [float(np.median(np.diff(log.times))) for log in logs if len(log.times) > 1]
    return (SHOWN * min(steps, default=0.0) / (2.0 * math.pi)) ** 2


def _periodic(free: Free, least: float) -> Free:
    """A count of so many periods a turn at least: with less, a ripple looks like any load."""
    if free.name.rpartition(".")[2] != COUNT:
        return free
    low = min(max(free.low, least), 0.5 * free.high)
    return replace(free, low=low, start=max(free.start, low))


def _narrowed(model: Model, parameter: Parameter) -> Free:
    """A free size, a share of its start at least where that is positive."""
    free = free_parameter(parameter, model.values[parameter.name], None)
    if free.start <= 0.0:
        return free
    low = max(free.low, LEAST * free.start) if free.low >= 0.0 else free.low
    return replace(free, low=low)
