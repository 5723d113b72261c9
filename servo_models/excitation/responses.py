"""Responses of a model to changes of parameters and effects, in noise floors."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from servo_models.errors import UserError
from servo_models.identification.problem import Free, Problem, free_parameter
from servo_models.recording import Array, Mask
from servo_models.simulate import Model

STEP = 1e-2
"""Change of a parameter in scales: larger than the jumps that frames and steps make of it."""


@dataclass(frozen=True, eq=False)
class Cause:
    """A change of the model and the difference that it makes.

    Attributes:
        name: parameter, or place of an effect.
        sizes: SI values of the parameters changed; of a parameter around which it changes.
        scale: size of the change [SI], 1 for an effect.
        owner: place of the effect that it belongs to, "" for a parameter of the plant.
        effect: whether it is the effect as a whole.
        difference: of all outputs of all logs, shape (m,); None where a run leaves the
            finite numbers.
    """

    name: str
    sizes: Mapping[str, float]
    scale: float = 1.0
    owner: str = ""
    effect: bool = False
    difference: Array | None = None


def response(problem: Problem, values: Mapping[str, float]) -> Array | None:
    """Return all outputs that a fit may see, in noise floors, or None if they are not finite."""
    try:
        found = [run.outputs(values)[run.log.fitted] for run in problem.runs]
    except UserError:
        return None
    weights = [np.array([problem.sigma[name] for name in log.outputs]) for log in problem.logs]
    return np.concatenate([(out / weight).T.ravel() for out, weight in zip(found, weights)])


def outputs(problem: Problem) -> dict[str, Mask]:
    """Return where in a response each output stands, shape (m,) of bool."""
    names = [np.full(int(log.fitted.sum()), name) for log in problem.logs for name in log.outputs]
    every = np.concatenate(names)
    return {name: every == name for name in np.unique(every).tolist()}


def parameters(model: Model, asked: Collection[str], priors: Mapping[str, float]) -> list[Free]:
    """Return the parameters asked for; without any those of the plant and of effects that are on.

    Nobody who asks for none means one that is fixed during a run, such as the internal step.
    """
    known = model.plant.parameters
    on = {"", *(name for name, sizes in _switches(model).items() if any(sizes.values()))}
    return [
        free_parameter(parameter, model.values[name], priors.get(name))
        for name, parameter in known.items()
        if (name in asked if asked else parameter.owner in on and not parameter.param.fixed)
        and parameter.param.low < parameter.param.high
    ]


def _switches(model: Model) -> dict[str, dict[str, float]]:
    """Values of the switches of every effect, by its place."""
    found: dict[str, dict[str, float]] = {}
    for name, parameter in model.plant.parameters.items():
        if parameter.owner and parameter.param.switch:
            found.setdefault(parameter.owner, {})[name] = model.values[name]
    return found


def _typical(model: Model, sizes: Mapping[str, float]) -> dict[str, float]:
    return {name: model.plant.parameters[name].param.typical for name in sizes}


def effects(model: Model) -> list[tuple[str, dict[str, float]]]:
    """Return settings that put each effect on at its typical size, or off if it is on."""
    return [
        (place, dict.fromkeys(sizes, 0.0) if any(sizes.values()) else _typical(model, sizes))
        for place, sizes in _switches(model).items()
    ]


def difference(problem: Problem, nominal: Array, place: str, sizes: Mapping[str, float]) -> Cause:
    """Return what settings of an effect change against the nominal response."""
    found = response(problem, sizes)
    moved = None if found is None else found - nominal
    return Cause(place, sizes, owner=place, effect=True, difference=moved)


def slope(problem: Problem, model: Model, change: Free) -> Cause:
    """Return the slope by central differences, one-sided on a bound.

    An effect that is off is on at its typical size meanwhile.
    """
    owner = model.plant.parameters[change.name].owner
    switches = _switches(model).get(owner, {})
    around = {} if any(switches.values()) else _typical(model, switches)
    upper = min(change.start + STEP * change.scale, change.high)
    lower = max(change.start - STEP * change.scale, change.low)
    ends = [response(problem, {**around, change.name: end}) for end in (upper, lower)]
    high, low = ends
    moved = None
    if high is not None and low is not None:
        moved = (high - low) * change.scale / (upper - lower)
    sizes = {change.name: change.start}
    return Cause(change.name, sizes, change.scale, owner, difference=moved)
