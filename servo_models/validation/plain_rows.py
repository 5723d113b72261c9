"""Compare a model with the plain integration of its blocks, each effect switched on in turn.

The references of ``cases/`` judge the physics of the catalogue.  An actuator of one's own has
none; here at least what is printed and compiled of its blocks, for the simulation and for the
FMU, is judged by something that prints nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from servo_models.core.plant import Parameter
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.validation.implementation import excitation
from servo_models.validation.plain_integration import Course, integrate
from servo_models.validation.rows import MODEL, Row, failure, judged
from servo_models.validation.subject import Subject

FINER = 10
"""Steps of the plain integration in an internal step."""
STEPS = (1.0, 2.5, 0.4, 7.3, 1.0, 3.7, 5.0, 1.1, 2.0, 10.0) * 3
"""Communication steps over the internal step: together a hundred internal steps."""
HELD = 6
"""Communication steps from one jump of the inputs to the next."""
FLOOR = 1e-4
"""Least tolerance, of the range of an output: what the references allow too."""
SAFETY = 2.0
"""Tolerance over the change of the plain integration from one step in an internal step to
``FINER``: a model that locates its jumps, or does not, differs by no more than that change."""
LOOSE = 0.05
"""Of the range: where the plain integration itself changes by more, nothing is compared."""
JUMP = 0.5
"""An output jumps where one plain step makes this part of its change in two internal steps."""
TOGETHER = 0.5
"""Typical sizes of all effects at once."""


def effects_off(model: Model) -> dict[str, list[Parameter]]:
    """Return the switches of every effect that is off, by effect."""
    found: dict[str, list[Parameter]] = {}
    for parameter in model.plant.parameters.values():
        if parameter.param.switch:
            found.setdefault(parameter.owner, []).append(parameter)
    return {
        owner: switches
        for owner, switches in found.items()
        if all(model.values[switch.name] == 0.0 for switch in switches)
    }


def switched_on(model: Model, switches: list[Parameter], share: float = 1.0) -> Model:
    """Return the model with these switches at a share of their typical sizes."""
    return replace(model, values=model.values | {s.name: _size(s, share) for s in switches})


def _size(switch: Parameter, share: float) -> float:
    param = switch.param
    typical = param.typical or param.low + 0.1 * (param.high - param.low) or param.high
    return min(max(share * typical, param.low), param.high)


def plain_row(subject: Subject, chosen: Model, name: str) -> Row:
    """Compare the simulation and the FMU with the plain integration.

    Args:
        subject: the FMU.
        chosen: its model, with the effects to look at.
        name: of the case.
    """
    where = (chosen.actuator.name, chosen.variant, f"blocks as plain functions: {name}")
    times = chosen.values["internal_step"] * np.cumsum((0.0, *STEPS))
    inputs = excitation(chosen, times, held=HELD)
    try:
        coarse, fine = (
            integrate(chosen.plant, chosen.values, times, inputs, finer) for finer in (1, FINER)
        )
        found = [run(chosen, times, inputs) for run in (Model.run, subject.run)]
    except UserError as error:
        return failure(MODEL, where, str(error), subject.name)
    except Exception as error:  # a block is anybody's Python
        reason = f"a block fails: {type(error).__name__}: {error}"
        return failure(MODEL, where, reason, subject.name)
    value, limit, until = _compared(coarse, fine, found, chosen.values["internal_step"])
    quantity = "largest difference of any output"
    note = f"plain integration at 1/{FINER} of the internal step"
    if until < len(times):
        note += f"; to t = {times[until - 1]:g} s only, beyond it depends on the step by itself"
    if until < HELD:
        return judged(MODEL, where, quantity, value, None, "1", note, subject.name)
    if not value <= limit:
        note += "; try a shorter internal_step: if that does not help, the printed text is wrong"
    return judged(MODEL, where, quantity, value, limit, "1", note, subject.name)


def _compared(
    coarse: Course, fine: Course, found: list[Array], step: float
) -> tuple[float, float, int]:
    """Largest difference, its limit, both of the range of an output, and the rows compared."""
    expected = fine.outputs[fine.rows]
    scale = np.ptp(fine.outputs, axis=0)
    scale[scale == 0.0] = np.maximum(np.abs(expected[0]), 1.0)[scale == 0.0]
    own = np.max(np.abs(coarse.outputs[coarse.rows] - expected) / scale, axis=1)
    unsure = np.flatnonzero(~(own <= LOOSE))
    until = int(unsure[0]) if len(unsure) else len(own)
    low, high = _tube(fine, step)
    off = [np.maximum(np.maximum(low - got, got - high), 0.0) / scale for got in found]
    off += [np.where(np.isfinite(got), 0.0, np.nan) for got in found]
    value = float(np.max(np.array(off)[:, :until])) if until else 0.0
    return value, FLOOR + SAFETY * float(np.max(own[:until], initial=0.0)), until


def _tube(fine: Course, step: float) -> tuple[Array, Array]:
    """Least and largest value that each output may have at each communication point.

    They are one number, but where the output jumps within an internal step of that point: there
    every value from one such step before it to one after will do, for a jump has an instant.
    """
    at_rows = fine.outputs[fine.rows]
    low, high = at_rows.copy(), at_rows.copy()
    for k, time in enumerate(fine.times[fine.rows]):
        near = np.searchsorted(fine.times, (time - step, time + step))
        around = fine.outputs[near[0] : near[1] + 1]
        if len(around) < 2:
            continue
        jumps = np.max(np.abs(np.diff(around, axis=0)), axis=0) > JUMP * np.ptp(around, axis=0)
        low[k, jumps] = around.min(axis=0)[jumps]
        high[k, jumps] = around.max(axis=0)[jumps]
    return low, high


def named_cases(chosen: Model, each: bool) -> Mapping[str, Model]:
    """Return the models to look at, by name: as it is, then with effects.

    Args:
        chosen: the model.
        each: whether every effect is switched on in turn, or all of them at once only.
    """
    off = effects_off(chosen)
    found = {"as it is": chosen}
    if each:
        found |= {f"{owner} on": switched_on(chosen, switches) for owner, switches in off.items()}
    if off:
        every = [switch for switches in off.values() for switch in switches]
        found["all effects on"] = switched_on(chosen, every, TOGETHER)
    return found
