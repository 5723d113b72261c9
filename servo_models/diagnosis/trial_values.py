"""At which values an effect is tried before anything is fitted, from its own search hints.

Trial values are a few over the typical one, of both signs where the bounds allow.  Of a
discontinuous parameter, or a ripple, no slope leads to the best one: there they are a grid, and
what the logs themselves show of a quantum is among them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from servo_models.core.block import Grid, Hints
from servo_models.core.plant import Parameter, Plant
from servo_models.data.log import Log
from servo_models.diagnosis.codes import Step, steps_under_noise

TRIALS_OVER_TYPICAL = (0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.5, 10.0)
"""Of a switch whose effect has no trial values of its own."""
SIGNED_TRIALS_OVER_TYPICAL = (0.3, 3.0)
"""Of one of either sign, to which the response is nearly straight."""
SHAPED_TRIALS_OVER_TYPICAL = (0.02, 0.1, 0.5, 2.0, 8.0)
"""Of one whose effect has a shape, with each of which they are tried."""
SHAPE_TRIALS_OVER_DEFAULT = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Of a parameter that is no switch."""
GRID_SPACING_IN_PERIODS = 0.1
"""Between two values of a grid the last of the periods that logs hold moves by this part of one."""
LARGEST_RELATIVE_GRID_SPACING = 0.06
INERTIAS_OVER_DEFAULT = (0.03, 0.1, 0.3, 1.0, 3.0)
"""Behind a compliance."""
RESONANCES_OVER_DEFAULT = (0.5, 1.0, 2.0, 4.0, 8.0)
"""Frequencies of such a resonance."""
RIPPLE_OVER_TYPICAL = 0.3
"""Amplitude at which a ripple is tried: its response is straight."""
RIPPLE_COUNTS = 48
"""Values of the count of a ripple."""
COUNT_SPACING_RAD = 1.5
"""By which the phase of a ripple changes over the travel from one count to the next."""
LEAST_OVER_TYPICAL = 0.01
"""Of a switch in a fit: a smaller effect is none, and may be slow."""
LEAST_RELATIVE_CODE_SPACING = 0.001
"""Between trial values about a step that a code histogram shows."""
CODE_TRIALS_TO_A_SIDE = 4
CODE_TRIALS_REACH_IN_STANDARD_ERRORS = 3.0

Settings = dict[str, float]


def resonances(compliance: Parameter, inertia: Parameter) -> list[Settings]:
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
) -> list[Settings]:
    """Return counts of a ripple so near each other that the best is not missed between two."""
    size = {switch.name: RIPPLE_OVER_TYPICAL * switch.param.typical}
    if count is None:
        return [size]
    apart = COUNT_SPACING_RAD / travel(plant, logs)
    grid = [2.0 * np.pi / COUNT_SPACING_RAD * apart + k * apart for k in range(RIPPLE_COUNTS)]
    inside = [it for it in grid if it <= count.param.high] or [count.param.high]
    return [{**size, count.name: it} for it in inside]


def few(hints: Hints, switches: Iterable[Parameter], shape: Sequence[Parameter]) -> list[Settings]:
    """Return a few values of each switch of an effect, with each of its shapes."""
    forms = _shapes(shape)
    return [
        {switch.name: size, **form}
        for switch in switches
        for size in _inside(switch, hints.trial_values or _usual(switch, shape))
        for form in forms
    ]


def _usual(switch: Parameter, shape: Sequence[Parameter]) -> tuple[float, ...]:
    if switch.param.low < 0.0:
        return SIGNED_TRIALS_OVER_TYPICAL
    return SHAPED_TRIALS_OVER_TYPICAL if shape else TRIALS_OVER_TYPICAL


def on_grid(grid: Grid, switch: Parameter, divided: float) -> list[Settings]:
    """Return the many values of a discontinuous parameter, the largest first.

    ``divided`` [SI] is what they divide, infinity where unknown: the range of a signal, or the
    duration of a log.  The more periods or codes there are, the narrower is the minimum.
    """
    param = switch.param
    low = max(grid.low * param.typical, param.low)
    size = min(grid.high * param.typical, param.high)
    found = []
    while size >= low:
        found.append({switch.name: size})
        relative = LARGEST_RELATIVE_GRID_SPACING
        if divided > 0.0:
            relative = min(
                max(GRID_SPACING_IN_PERIODS * size / divided, grid.least_spacing), relative
            )
        size *= 1.0 - relative
    return found


def quanta(switch: Parameter, readings: Iterable[str], logs: Sequence[Log]) -> list[Step]:
    """Return the steps that code histograms of some readings suggest."""
    records = ([log.outputs[name] for log in logs if name in log.outputs] for name in readings)
    found = [step for values in records if values for step in steps_under_noise(values)]
    least = LEAST_OVER_TYPICAL * switch.param.typical
    return [step for step in found if least <= step.size <= switch.param.high]


def about_codes(switch: Parameter, steps: Iterable[Step]) -> list[Settings]:
    """Return values about the steps that a code histogram of the quantised signal shows."""
    n, reach = CODE_TRIALS_TO_A_SIDE, CODE_TRIALS_REACH_IN_STANDARD_ERRORS
    return [
        {switch.name: size + k * max(LEAST_RELATIVE_CODE_SPACING * size, reach * error / n)}
        for size, error, _ in steps
        for k in range(-n, n + 1)
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


def _inside(switch: Parameter, over_typical: Iterable[float]) -> list[float]:
    """Values of a switch inside its bounds, of both signs where there are two."""
    param = switch.param
    both = [sign * share * param.typical for share in over_typical for sign in (1.0, -1.0)]
    return [size for size in both if param.low <= size <= param.high]


def _shapes(shape: Iterable[Parameter]) -> list[Settings]:
    """Shapes to try: the default, and each parameter apart from it."""
    forms: dict[tuple[tuple[str, float], ...], None] = {}
    for parameter in shape:
        param = parameter.param
        for share in SHAPE_TRIALS_OVER_DEFAULT:
            value = min(max(share * param.default, param.low), param.high)
            forms[((parameter.name, value),)] = None
    return [dict(form) for form in forms] or [{}]
