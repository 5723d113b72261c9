"""At which sizes and shapes an effect is looked at before anything is fitted.

Sizes are shares of the typical one, of both signs where the bounds allow.  Where a response
is a staircase of the size, or a comb, no slope leads to the best one: there they lie close to
each other, and what the logs themselves show of a quantum is among them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from servo_models.core.plant import Parameter, Plant
from servo_models.data.log import Log
from servo_models.diagnosis.codes import Step, hidden_steps

SHARES = (0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.5, 10.0)
"""Sizes that are tried, over the typical size."""
SIGNED = (0.3, 3.0)
"""Those of effects that have either sign, whose response is nearly straight."""
SHAPED = (0.02, 0.1, 0.5, 2.0, 8.0)
"""Those of effects with a shape, with each of which they are tried."""
LIMITS = (0.06, 0.1, 0.16, 0.24, 0.35, 0.5, 0.65, 0.8, 0.95, 1.15, 1.45, 2.0, 2.5, 3.0, 3.4, 4.0)
RATES = tuple(0.03 * 1.35**k for k in range(28))
OWN = {"saturation": LIMITS, "end_stops": LIMITS, "rate_limit": RATES}
"""Those of limits, which act below the largest value that occurs, or not at all."""
LIMITING = ("rate_limit",)
"""Those that do the more the smaller their size is, and over a wide range: they are looked at so
near each other that a part of what one does is no better known than what the next one does."""
STAIRS = {"quantisation": (0.2, 150.0), "sample_hold": (0.15, 10.0), "dead_band": (0.05, 10.0)}
"""Least and largest of those of which a response is a staircase, which no slope leads to."""
STEPWISE = tuple(STAIRS)
"""Effects of which a response is no smooth function."""
JUMP_PARTS = {"dead_zone": "kept"}
"""Parameters that say which part of a jump an effect has: 0 is none, 1 is all of it."""
NEAREST = {"quantisation": 0.0015, "sample_hold": 0.0015, "dead_band": 0.005}
NEEDLE, WIDEST = 0.1, 0.06
"""How far apart such sizes are, relative to each other: so many times one over the stairs of the
whole, whose last one then is off by that part of a stair; at least, and at most."""
SHAPES = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Values of a shape parameter that are tried, over its default."""
RESONANT = ("compliance", "inertia")
"""Parameters of a resonance, whose frequency is the root of 1 / their product."""
WEIGHTS, PITCHES = (0.03, 0.1, 0.3, 1.0, 3.0), (0.5, 1.0, 2.0, 4.0, 8.0)
"""Inertias over the default, and frequencies over the default one, that are tried."""
NEAR = 4.0
"""Factor by which a fit may move either: a high frequency is slow to simulate."""
CHOICES = ("rounding", "full_scale", "jitter")
"""Shape parameters that say how an effect is counted, not how it looks."""
PHASE, COUNT = "phase", "count"
"""Shape parameters of a ripple: it is looked at as a sine and a cosine, over a grid of counts."""
COUNTS, APART = 48, 1.5
"""Counts of such a grid, and how far apart [rad over the travel]."""
RIPPLE = 0.3
"""Size of a ripple that is looked at, over the typical one."""
LEAST = 0.01
"""Least size in a fit, over the typical one: a smaller effect is none, and may be slow."""
PRECISE, ERRORS, AROUND = 0.001, 3.0, 4
"""Relative distance at least of sizes about a step that a code histogram shows, standard errors of
it that they cover, and sizes to either side."""

Settings = dict[str, float]


def resonances(switch: Parameter, inertia: Parameter) -> list[Settings]:
    """Return loads on a spring, of several inertias and frequencies."""
    return [
        {
            inertia.name: weight * inertia.param.default,
            switch.name: switch.param.typical / (weight * pitch**2),
        }
        for weight in WEIGHTS
        for pitch in PITCHES
        if switch.param.typical / (weight * pitch**2) <= switch.param.high
    ]


def ripple_of(name: str, shape: Iterable[Parameter]) -> str | None:
    """Return the name of an effect's phase, None where it has none."""
    wanted = f"{name}.{PHASE}"
    return next((p.name for p in shape if p.name == wanted), None)


def ripples(
    switch: Parameter, shape: Iterable[Parameter], plant: Plant, logs: Iterable[Log]
) -> list[Settings]:
    """Return counts of a ripple so near each other that the best is not missed between two."""
    size = {switch.name: RIPPLE * switch.param.typical}
    counts = [p for p in shape if p.name.endswith(f".{COUNT}")]
    if not counts:
        return [size]
    apart = APART / travel(plant, logs)
    grid = [2.0 * np.pi / APART * apart + k * apart for k in range(COUNTS)]
    inside = [it for it in grid if it <= counts[0].param.high] or [counts[0].param.high]
    return [{**size, counts[0].name: it} for it in inside]


def shares(
    effect: str, switches: Iterable[Parameter], shape: Sequence[Parameter]
) -> list[Settings]:
    """Return sizes of each switch of an effect, with each of its shapes."""
    forms = _forms(shape, SHAPES)
    return [
        {switch.name: size, **form}
        for switch in switches
        for size in _sizes(switch, OWN.get(effect) or _wanted(switch, shape))
        for form in forms
    ]


def _wanted(switch: Parameter, shape: Sequence[Parameter]) -> tuple[float, ...]:
    if switch.param.low < 0.0:
        return SIGNED
    return SHAPED if shape else SHARES


def fine(effect: str, switch: Parameter, whole: float) -> list[Settings]:
    """Return the many sizes of a switch on which a response is a staircase.

    ``whole`` [SI] is divided into stairs of that size: the range of a quantised signal, or the
    duration of a log.  The more there are, the narrower is what a size has to meet.
    """
    low, high = (share * switch.param.typical for share in STAIRS[effect])
    low, size, found = max(low, switch.param.low), min(high, switch.param.high), []
    while size >= low:
        found.append({switch.name: size})
        apart = NEEDLE * size / whole if whole > 0.0 else WIDEST
        size *= 1.0 - min(max(apart, NEAREST[effect]), WIDEST)
    return found


def quanta(switch: Parameter, readings: Iterable[str], logs: Sequence[Log]) -> list[Step]:
    """Return the steps that code histograms of some readings suggest."""
    records = ([log.outputs[name] for log in logs if name in log.outputs] for name in readings)
    found = [step for values in records if values for step in hidden_steps(values)]
    least = LEAST * switch.param.typical
    return [step for step in found if least <= step.size <= switch.param.high]


def near_to(switch: Parameter, steps: Iterable[Step]) -> list[Settings]:
    """Return the sizes about the steps that a code histogram of the quantised signal shows."""
    return [
        {switch.name: size + k * max(PRECISE * size, ERRORS * error / AROUND)}
        for size, error, _ in steps
        for k in range(-AROUND, AROUND + 1)
    ]


def travel(plant: Plant, logs: Iterable[Log]) -> float:
    """Return the largest range of an angle [rad] or a position [m] in some logs, 1 without any."""
    ranges = [
        float(np.ptp(values))
        for log in logs
        for name, values in log.outputs.items()
        if plant.wire[name].unit in ("rad", "m")
    ]
    return max(ranges, default=1.0) or 1.0


def _sizes(switch: Parameter, wanted: Iterable[float]) -> list[float]:
    """Sizes of a switch inside its bounds, of both signs where there are two."""
    param = switch.param
    both = [sign * share * param.typical for share in wanted for sign in (1.0, -1.0)]
    return [size for size in both if param.low <= size <= param.high]


def _forms(shape: Iterable[Parameter], wanted: Iterable[float]) -> list[Settings]:
    """Shapes to look at: the default, and each parameter apart from it."""
    forms: dict[tuple[tuple[str, float], ...], None] = {}
    for parameter in shape:
        param = parameter.param
        for share in wanted:
            value = min(max(share * param.default, param.low), param.high)
            forms[((parameter.name, value),)] = None
    return [dict(form) for form in forms] or [{}]
