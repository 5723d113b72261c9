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
FINE = tuple(0.05 * 1.08**k for k in range(67))
"""Those of an effect whose size no slope leads to."""
STEPWISE = ("quantisation", "sample_hold")
"""Effects of which a response is no smooth function."""
SHAPES = (0.1, 1.0, 10.0)
"""Values of a shape parameter that are tried, over its default."""
LEAST = 0.01
"""Least size in a fit, over the typical one: a smaller effect is none, and may be slow."""
CHOICES = ("rounding", "full_scale", "jitter")
"""Shape parameters that say how an effect is counted, not how it looks."""
SLOW = ("gear_compliance",)
"""Effects whose simulation is slow where their shape is far from the default."""


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
        if switches and not on and name not in skipped:
            found.append(_candidate(model, name, switches, parameters))
    return tuple(found)


def _candidate(
    model: Model, name: str, switches: list[Parameter], parameters: list[Parameter]
) -> Candidate:
    placement = model.plant.placements[name][0]
    stepwise = placement.effect.name in STEPWISE
    shape = [
        p for p in parameters if not p.param.switch and p.name.rpartition(".")[2] not in CHOICES
    ]
    free = [_narrowed(model, p, LEAST, math.inf) for p in switches]
    if name in SLOW:
        free += [_narrowed(model, p, min(SHAPES), max(SHAPES)) for p in shape]
        shape = []
    else:
        free += [free_parameter(p, model.values[p.name], None) for p in shape]
    sizes = [
        {switch.name: size, **form}
        for switch in switches
        for size in _sizes(switch, FINE if stepwise else SHARES)
        for form in _forms(shape)
    ]
    return Candidate(name, placement.on[0], tuple(free), tuple(sizes))


def _sizes(switch: Parameter, shares: Iterable[float]) -> list[float]:
    """Sizes of a switch inside its bounds, of both signs where there are two."""
    param = switch.param
    both = [sign * share * param.typical for share in shares for sign in (1.0, -1.0)]
    return [size for size in both if param.low <= size <= param.high]


def _forms(shape: list[Parameter]) -> list[dict[str, float]]:
    """Shapes to look at: the default, and each parameter apart from it."""
    forms: dict[tuple[tuple[str, float], ...], None] = {}
    for parameter in shape:
        param = parameter.param
        for share in SHAPES:
            value = min(max(share * param.default, param.low), param.high)
            forms[((parameter.name, value),)] = None
    return [dict(form) for form in forms] or [{}]


def _narrowed(model: Model, parameter: Parameter, least: float, most: float) -> Free:
    """A free parameter between shares of its start, where that is positive."""
    free = free_parameter(parameter, model.values[parameter.name], None)
    if free.start <= 0.0:
        return free
    low = max(free.low, least * free.start) if free.low >= 0.0 else free.low
    return replace(free, low=low, high=min(free.high, most * free.start))
