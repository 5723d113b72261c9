"""What logs can determine: how far each parameter and effect would move what was measured.

Every figure is a response difference of the model in the loop that made the log, in units
of the noise floor, which is taken as white.  A difference is what remains after the free
parameters, inside their priors, have explained what they can; so an effect that passes for
another gain is not counted as shown.
Source: Ljung, System Identification, 2nd ed., sec. 9.4 (asymptotic covariance) and sec. 13
(informative experiments).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain

import numpy as np

from servo_models.errors import UserError
from servo_models.identification.problem import Free, Problem, free_parameter
from servo_models.lookalikes import cause, experiment
from servo_models.recording import Array, Log
from servo_models.simulate import Model

STEP = 1e-2
"""Change of a parameter in scales: larger than the jumps that frames and steps make of it."""
SHOWN = 0.5
"""RMS difference in noise floors below which a log shows nothing: noise is never quite white,
and models are never quite right."""
ALIKE = 0.98
"""Cosine between two differences from which they cannot be told apart."""
DETERMINED = 0.1
"""Expected standard error over the scale of a parameter up to which a log determines it."""


@dataclass(frozen=True, eq=False)
class Reach:
    """How far one cause would move what was measured.

    Attributes:
        name: parameter, or place of an effect.
        effect: whether it is an effect, on at its typical size (or off, if it was on).
        sizes: SI values of the parameters that were changed, by name; of a parameter its
            nominal value.
        output: the output that it moves most, in noise floors.
        moves: RMS of that movement in noise floors; of a parameter, for a change by one
            prior standard deviation, or by its value.
        remains: the same after the free parameters have explained what they can.
        standard_error: expected [SI] if only this parameter were free, without a prior; of
            an effect the share of its size.
    """

    name: str
    effect: bool
    sizes: Mapping[str, float]
    output: str
    moves: float
    remains: float
    standard_error: float

    @property
    def shown(self) -> bool:
        """Whether the logs can show it."""
        return self.remains >= SHOWN

    @property
    def absorbed(self) -> bool:
        """Whether it moves the outputs, but free parameters explain that away."""
        return not self.shown and self.moves >= SHOWN


@dataclass(frozen=True)
class Group:
    """Causes of which these logs cannot tell one from another, and what would."""

    names: tuple[str, ...]
    experiments: tuple[str, ...]


@dataclass(frozen=True)
class Excitation:
    """What logs can determine.

    Attributes:
        parameters: of the plant and of effects that are on.
        effects: all that the plant has a place for.
        groups: shown causes that look alike.
        refused: effects whose simulation leaves the finite numbers.
    """

    parameters: tuple[Reach, ...]
    effects: tuple[Reach, ...]
    groups: tuple[Group, ...]
    refused: tuple[str, ...]


def excitation(
    model: Model,
    logs: Sequence[Log],
    floor: Mapping[str, float],
    free: Iterable[str] = (),
    priors: Mapping[str, float] | None = None,
    jobs: int | None = None,
) -> Excitation:
    """Return what logs can determine of a model.

    Args:
        model: nominal values.
        logs: measured runs; samples held out do not count.
        floor: noise floor [SI] of each output, above 0.
        free: parameters that will be estimated.
        priors: standard deviations [SI] of nominal values; those parameters are free too.
        jobs: runs at once, by default the processors there are.

    Raises:
        UserError: the nominal model cannot be simulated.
    """
    given = priors or {}
    problem = Problem(model, logs, [], sigma=dict(floor))
    nominal = _response(problem, {})
    if nominal is None:
        raise UserError("the nominal model leaves the finite numbers on these logs: correct it")
    changes = _parameters(model, given)
    effects = _effects(model)

    def slope(parameter: Free) -> Array | None:
        at, name = parameter.nominal, parameter.name
        upper = min(at + STEP * parameter.scale, parameter.high)
        lower = max(at - STEP * parameter.scale, parameter.low)
        high, low = _response(problem, {name: upper}), _response(problem, {name: lower})
        if high is None or low is None:
            return None
        change: Array = (high - low) * parameter.scale / (upper - lower)
        return change

    def difference(sizes: Mapping[str, float]) -> Array | None:
        found = _response(problem, sizes)
        return None if found is None else found - nominal

    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as pool:
        slopes = list(pool.map(slope, changes))
        differences = list(pool.map(difference, effects.values()))
    names = _outputs(problem)
    asked = set(free) | set(given)
    explain = _Explained(
        [(c, s) for c, s in zip(changes, slopes) if c.name in asked and s is not None]
    )
    found = [
        (_reach(c.name, {c.name: c.nominal}, c.scale, False, s, explain, names), s)
        for c, s in zip(changes, slopes)
        if s is not None
    ]
    shown = [
        (_reach(name, sizes, 1.0, True, d, explain, names), d)
        for (name, sizes), d in zip(effects.items(), differences)
        if d is not None
    ]
    return Excitation(
        parameters=tuple(reach for reach, _ in found),
        effects=tuple(reach for reach, _ in shown),
        groups=_groups(model, [*found, *shown], explain),
        refused=tuple(name for name, d in zip(effects, differences) if d is None),
    )


def _response(problem: Problem, values: Mapping[str, float]) -> Array | None:
    """Outputs of all logs that a fit may see, in noise floors; None where they are not finite."""
    try:
        found = [run.outputs(values)[~run.log.held_out] for run in problem.runs]
    except UserError:
        return None
    weights = [np.array([problem.sigma[name] for name in log.outputs]) for log in problem.logs]
    return np.concatenate([(out / weight).T.ravel() for out, weight in zip(found, weights)])


def _outputs(problem: Problem) -> dict[str, Array]:
    """Where in a response each output stands, shape (m,) of bool."""
    names = [[name] * int((~log.held_out).sum()) for log in problem.logs for name in log.outputs]
    every = np.array(list(chain.from_iterable(names)))
    return {name: every == name for name in dict.fromkeys(every.tolist())}


def _parameters(model: Model, priors: Mapping[str, float]) -> list[Free]:
    """Parameters of the plant and of effects that are on, which may change during a log."""
    on = {name for name, sizes in _switches(model).items() if any(sizes.values())}
    return [
        free_parameter(parameter, model.values[name], priors.get(name))
        for name, parameter in model.plant.parameters.items()
        if not parameter.param.fixed
        and parameter.param.low < parameter.param.high
        and (not parameter.owner or parameter.owner in on)
    ]


def _switches(model: Model) -> dict[str, dict[str, float]]:
    """Values of the switches of every effect, by its place."""
    found: dict[str, dict[str, float]] = {}
    for name, parameter in model.plant.parameters.items():
        if parameter.owner and parameter.param.switch:
            found.setdefault(parameter.owner, {})[name] = model.values[name]
    return found


def _effects(model: Model) -> dict[str, dict[str, float]]:
    """Settings that put each effect on at its typical size, or off if it is on."""
    typical = model.plant.parameters
    return {
        place: {name: 0.0 if any(sizes.values()) else typical[name].param.typical for name in sizes}
        for place, sizes in _switches(model).items()
    }


class _Explained:
    """Takes from a difference what free parameters explain within their priors.

    A prior is one more row of the regression: Ljung, sec. 7.4.
    """

    def __init__(self, free: Sequence[tuple[Free, Array]]) -> None:
        self.rows = np.diag([float(parameter.prior is not None) for parameter, _ in free])
        stacked = [np.concatenate([slope, row]) for (_, slope), row in zip(free, self.rows)]
        self.names = [parameter.name for parameter, _ in free]
        self.basis = _orthonormal(np.array(stacked).T) if stacked else np.zeros((0, 0))

    def rest(self, name: str, difference: Array) -> Array:
        """What remains of a difference, prior rows behind it; all of it for a free parameter."""
        full = np.concatenate([difference, np.zeros(len(self.rows))])
        if name in self.names:
            return full
        return full - self.basis @ (self.basis.T @ full) if len(self.rows) else full


def _orthonormal(columns: Array) -> Array:
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, singular > 1e-9 * singular[0]])


def _reach(
    name: str,
    sizes: Mapping[str, float],
    scale: float,
    effect: bool,
    difference: Array,
    explain: _Explained,
    outputs: Mapping[str, Array],
) -> Reach:
    rest = explain.rest(name, difference)[: len(difference)]
    by_output = {output: _rms(difference[where]) for output, where in outputs.items()}
    most = max(by_output, key=lambda output: by_output[output])
    norm = float(np.linalg.norm(difference))
    return Reach(
        name=name,
        effect=effect,
        sizes=sizes,
        output=most,
        moves=by_output[most],
        remains=max(_rms(rest[where]) for where in outputs.values()),
        standard_error=scale / norm if norm > 0.0 else np.inf,
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _groups(
    model: Model, found: Sequence[tuple[Reach, Array]], explain: _Explained
) -> tuple[Group, ...]:
    """Groups in which every cause looks like every other; the strongest come first."""
    groups: list[list[tuple[str, Array]]] = []
    for reach, difference in sorted(found, key=lambda item: -item[0].remains):
        if not reach.shown:
            continue
        rest = explain.rest(reach.name, difference)
        unit = rest / np.linalg.norm(rest)
        for group in groups:
            if all(abs(unit @ other) > ALIKE for _, other in group):
                group.append((reach.name, unit))
                break
        else:
            groups.append([(reach.name, unit)])
    return tuple(_group(model, [name for name, _ in group]) for group in groups if len(group) > 1)


def _group(model: Model, names: Sequence[str]) -> Group:
    causes = [cause(name, model.plant) for name in names]
    texts = [experiment(a, b) for i, a in enumerate(causes) for b in causes[:i]]
    return Group(tuple(names), tuple(dict.fromkeys(filter(None, texts))))
