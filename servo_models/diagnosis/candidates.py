"""The effects that may cause a gap: every effect of the actuator that the model has switched off.

A cause is a parameter vector: its switches at some size, its shape at the default.  The
sizes tried before anything is fitted are shares of the typical one, of both signs where the
bounds allow.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from servo_models.actuator import Parameter
from servo_models.identification.problem import Free, free_parameter
from servo_models.simulate import Model

SHARES = (0.1, 0.3, 1.0, 3.0)
"""Sizes that are tried, over the typical size."""
LEAST = 0.01
"""Least size in a fit, over the typical one: a smaller effect is none, and may be slow."""
SHAPE = 0.1
"""Least shape parameter in a fit over its default, and the inverse of the largest."""
CHOICES = ("rounding", "full_scale", "jitter")
"""Shape parameters that say how an effect is counted, not how it looks."""
DETECTED = ("quantisation", "sample_hold")
"""Effects that have detectors of their own: an RMS cannot tell them."""


@dataclass(frozen=True)
class Candidate:
    """An effect at its place, off in the model.

    Attributes:
        name: of the place, such as ``"drive_dead_zone"``.
        wire: on which it acts.
        free: its parameters, switches first.
        sizes: settings [SI] of its switches to look at first.
    """

    name: str
    wire: str
    free: tuple[Free, ...]
    sizes: tuple[dict[str, float], ...]

    def at(self, settings: dict[str, float]) -> tuple[Free, ...]:
        """Return the parameters with the starts that ``settings`` give."""
        return tuple(replace(one, start=settings.get(one.name, one.start)) for one in self.free)


def candidates(model: Model, left_out: Iterable[str] = ()) -> tuple[Candidate, ...]:
    """Return the effects that a model has switched off, without those ``left_out``."""
    skipped = set(left_out)
    owned: dict[str, list[Parameter]] = {}
    for parameter in model.plant.parameters.values():
        if parameter.owner:
            owned.setdefault(parameter.owner, []).append(parameter)
    found = []
    for name, parameters in owned.items():
        switches = [p for p in parameters if p.param.switch and p.param.typical > 0.0]
        on = any(model.values[p.name] != 0.0 for p in parameters if p.param.switch)
        effect = model.plant.placements[name][0].effect.name
        if switches and not on and name not in skipped and effect not in DETECTED:
            found.append(_candidate(model, name, switches, parameters))
    return tuple(found)


def _candidate(
    model: Model, name: str, switches: list[Parameter], parameters: list[Parameter]
) -> Candidate:
    shape = [
        p for p in parameters if not p.param.switch and p.name.rpartition(".")[2] not in CHOICES
    ]
    free = [_narrowed(model, p, LEAST, math.inf) for p in switches]
    free += [_narrowed(model, p, SHAPE, 1.0 / SHAPE) for p in shape]
    sizes = [
        {switch.name: sign * share * switch.param.typical}
        for switch in switches
        for sign in ((1.0, -1.0) if switch.param.low < 0.0 else (1.0,))
        for share in SHARES
        if switch.param.low <= sign * share * switch.param.typical <= switch.param.high
    ]
    return Candidate(name, model.plant.placements[name][0].on[0], tuple(free), tuple(sizes))


def _narrowed(model: Model, parameter: Parameter, least: float, most: float) -> Free:
    """A free parameter between shares of its start, where that is positive."""
    free = free_parameter(parameter, model.values[parameter.name], None)
    if free.start <= 0.0:
        return free
    low = max(free.low, least * free.start) if free.low >= 0.0 else free.low
    return replace(free, low=low, high=min(free.high, most * free.start))
