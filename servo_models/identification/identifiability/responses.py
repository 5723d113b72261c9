"""Responses of a model to changes of parameters and effects, in noise floors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from servo_models.core.simulate import Model
from servo_models.core.types import Array, Mask
from servo_models.errors import UserError
from servo_models.identification.information import Information, information
from servo_models.identification.problem import Free, Problem, free_parameter
from servo_models.identification.uncertainty import Axis


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
        if not model.plant.main(place).effect.hints.learnt  # it has no size that is typical
    ]


def difference(problem: Problem, nominal: Array, place: str, sizes: Mapping[str, float]) -> Cause:
    """Return what settings of an effect change against the nominal response."""
    found = response(problem, sizes)
    moved = None if found is None else found - nominal
    return Cause(place, sizes, owner=place, effect=True, difference=moved)


@dataclass(frozen=True, eq=False)
class Slopes:
    """What single parameters change, as far as several widths agree on it.

    Attributes:
        causes: one a parameter, in the order asked for; its difference is the slope per scale.
        steps: by name, a standard error [scales] with steps of the response in it, of one without.
        jitter: variance of the response by roughness [noise floors^2], shape (m,).
        groups: names of parameters that show only together.
    """

    causes: list[Cause]
    steps: dict[str, Callable[[float], float]]
    jitter: Array
    groups: tuple[tuple[str, ...], ...]


def slopes(problem: Problem, model: Model, changes: Sequence[Free], together: bool) -> Slopes:
    """Return the slopes of parameters, those that are ``together`` free of one another as well.

    An effect that is off is on at its typical size meanwhile.
    """
    batches = [list(changes)] if together and changes else [[change] for change in changes]
    found = [_slopes(problem, model, batch) for batch in batches]
    causes = [cause for one in found for cause in one.causes]
    jitters = [one.jitter for one in found if one.jitter.any()]
    return Slopes(
        causes,
        {name: step for one in found for name, step in one.steps.items()},
        min(jitters, key=np.sum) if jitters else np.zeros(problem.samples),
        tuple(group for one in found for group in one.groups),
    )


def _slopes(problem: Problem, model: Model, batch: Sequence[Free]) -> Slopes:
    owners = {change.name: model.plant.parameters[change.name].owner for change in batch}
    known = _switches(model)
    off = [known[it] for it in owners.values() if it in known and not any(known[it].values())]
    around = {name: value for sizes in off for name, value in _typical(model, sizes).items()}
    at = replace(model, values={**model.values, **around})
    own = Problem(at, problem.logs, batch, sigma=problem.sigma, workers=problem.workers)
    told = information(own, own.start)
    names = [change.name for change in batch]
    causes: list[Cause] = []
    steps: dict[str, Callable[[float], float]] = {}
    for i, change in enumerate(batch):
        moved = None if i in told.refused else told.slopes[: own.samples, i]
        sizes = {change.name: change.start}
        causes.append(Cause(change.name, sizes, change.scale, owners[change.name], False, moved))
        steps[change.name] = partial(_with_steps, own, i, told)
    groups = tuple(tuple(names[i] for i in group) for group in told.groups)
    return Slopes(causes, steps, told.jitter, groups)


def _with_steps(problem: Problem, i: int, told: Information, error: float) -> float:
    """A standard error [scales] to expect, with steps of the response in it."""
    along = Axis(problem, problem.start, i)
    if np.isfinite(error):
        return along.tread(error, float(np.linalg.norm(told.slopes[: problem.samples, i])))
    alone = told.open[i] and not any(i in group for group in told.groups)
    return along.needle(right=True) if alone else error
