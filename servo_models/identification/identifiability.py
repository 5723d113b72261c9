"""What logs can determine: how far each parameter and effect would move what was measured.

Every figure is a response difference of the model in the loop that made the log, in units
of the noise floor, which is taken as white; so errors are the least that can be expected.
What free parameters explain of a difference, inside their priors, does not count: an effect
that passes for another gain is not shown.
Source: Ljung, System Identification, 2nd ed., sec. 9.4 (asymptotic covariance), sec. 13
(informative experiments) and sec. 7.4 (a prior is one more row of the regression).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from servo_models.analysis.isolability import cause, experiment
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Array, Mask
from servo_models.core.workers import Workers
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.linear_inference import Axis, Information, information
from servo_models.identification.problem import Free, Problem, free_parameter

SHOWN = 0.5  # RMS difference [noise floors] below which a log shows nothing: no noise is white
SINGULAR = 1e-9  # eigenvalue over the largest of a unit Gram matrix up to which it is rounding
ALIKE_COSINE = 0.98  # cosine between two differences from which they cannot be told apart
EXPLAINED = 1e-6  # share of the square of a difference that may be rounding


@dataclass(frozen=True, eq=False)
class Detectability:
    """How far one cause would move what was measured.

    Attributes:
        name: parameter, or place of an effect.
        effect: whether it is an effect, on at its typical size (or off, if it was on).
        sizes: SI values of the parameters that were changed, by name; of a parameter the
            value around which it was changed.
        scale: size of the change [SI]: a parameter's prior standard deviation or its value;
            1 for an effect.
        output: the output that it moves most.
        moves: RMS of that movement in noise floors.
        remains: that movement after the free parameters have explained what they can.
        alone: expected standard error, in scales, if nothing else were free, without prior.
        together: that error with all free parameters free, and with the priors.
    """

    name: str
    effect: bool
    sizes: Mapping[str, float]
    scale: float
    output: str
    moves: float
    remains: float
    alone: float
    together: float

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
class Identifiability:
    """What logs can determine.

    Attributes:
        parameters: those free; without any all of the plant and of effects that are on.
        effects: all that the plant has a place for.
        groups: shown causes that look alike, the strongest first.
        together: parameters to be estimated that the logs show only together.
        refused: effects whose simulation leaves the finite numbers.
    """

    parameters: tuple[Detectability, ...]
    effects: tuple[Detectability, ...]
    groups: tuple[Group, ...]
    together: tuple[tuple[str, ...], ...]
    refused: tuple[str, ...]


def identifiability(
    model: Model,
    logs: Sequence[Log],
    floor: Mapping[str, float],
    free: Iterable[str] = (),
    priors: Mapping[str, float] | None = None,
    jobs: int | None = None,
) -> Identifiability:
    """Return what logs can determine of a model.

    Args:
        model: nominal values.
        logs: measured runs; samples held out do not count.
        floor: noise floor [SI] of each output, above 0.
        free: parameters that will be estimated.
        priors: standard deviations [SI] of nominal values; those parameters are free too.
        jobs: runs at once, by default the processors there are.

    Raises:
        UserError: every sample is held out, or the nominal model cannot be simulated.
    """
    given = dict(priors or {})
    asked = dict.fromkeys([*free, *given])
    judging = [log for log in logs if log.fitted.any()]
    if not judging:
        names = ", ".join(f"'{log.name}'" for log in logs)
        raise UserError(
            f"every sample of log {names} is held out: leave some to estimate from ('held_out')"
        )
    with Workers(jobs) as workers:
        problem = Problem(model, judging, [], sigma=dict(floor), workers=workers)
        return _excitation(model, problem, asked, given)


def _excitation(
    model: Model, problem: Problem, asked: Mapping[str, None], given: Mapping[str, float]
) -> Identifiability:
    nominal = _response(problem, {})
    if nominal is None:
        raise UserError("the nominal model leaves the finite numbers on these logs: correct it")
    told = _slopes(problem, model, _parameters(model, asked, given), together=bool(asked))
    switched = problem.workers.map(lambda it: _switched(problem, nominal, *it), _effects(model))
    every = [*told.causes, *switched]
    evidence = Comparison(
        [cause for cause in every if cause.difference is not None], asked, given, told.jitter
    )
    where = _outputs(problem)
    reaches = [_reach(i, evidence, where, told) for i in range(len(evidence.causes))]
    return Identifiability(
        parameters=tuple(reach for reach in reaches if not reach.effect),
        effects=tuple(reach for reach in reaches if reach.effect),
        groups=_groups(model.plant, reaches, evidence, asked),
        together=told.groups,
        refused=tuple(cause.name for cause in every if cause.difference is None),
    )


def _reach(
    i: int, evidence: Comparison, outputs: Mapping[str, Mask], told: Slopes
) -> Detectability:
    cause, difference = evidence.causes[i], evidence.differences[i]
    squares = difference**2 - evidence.rough[i]
    moved = {n: float(np.sqrt(max(np.mean(squares[at]), 0.0))) for n, at in outputs.items()}
    most = max(moved, key=lambda name: moved[name])
    whole = float(evidence.data[i, i])
    rest = max(float(evidence.rest(i)[0, 0]), 0.0)
    prior = float(evidence.gram[i, i]) - whole
    alone, together = (
        1.0 / np.sqrt(value) if value > EXPLAINED * whole else np.inf for value in (whole, rest)
    )
    if cause.name in told.steps and prior == 0.0:
        alone, together = (told.steps[cause.name](value) for value in (alone, together))
    return Detectability(
        name=cause.name,
        effect=cause.effect,
        sizes=cause.sizes,
        scale=cause.scale,
        output=most,
        moves=moved[most],
        remains=moved[most] * np.sqrt(max(rest - prior, 0.0) / whole) if whole else 0.0,
        alone=alone,
        together=together,
    )


def _groups(
    plant: Plant, reaches: Sequence[Detectability], evidence: Comparison, asked: Container[str]
) -> tuple[Group, ...]:
    """Groups in which every cause looks like every other: effects, and what is to be estimated.

    An effect whose parameters are to be estimated is left to them.
    """
    shown = [
        i
        for i, reach in enumerate(reaches)
        if (reach.shown if reach.effect else reach.moves >= SHOWN and reach.name in asked)
    ]
    spoken_for = {plant.parameters[reaches[i].name].owner for i in shown if not reaches[i].effect}
    groups: list[list[int]] = []
    for i in sorted(shown, key=lambda i: -reaches[i].moves):
        if reaches[i].effect and reaches[i].name in spoken_for:
            continue
        for group in groups:
            if all(evidence.alike(i, other) for other in group):
                group.append(i)
                break
        else:
            groups.append([i])
    names = [[reaches[i].name for i in group] for group in groups if len(group) > 1]
    return tuple(Group(tuple(group), _experiments(group, plant)) for group in names)


def _experiments(names: Sequence[str], plant: Plant) -> tuple[str, ...]:
    causes = [cause(name, plant) for name in names]
    texts = [experiment(a, b, plant) for i, a in enumerate(causes) for b in causes[:i]]
    return tuple(dict.fromkeys(filter(None, texts)))


# Responses to changes of parameters and effects, in noise floors


@dataclass(frozen=True, eq=False)
class Cause:
    """A change of the model and the difference that it makes.

    Attributes:
        name: parameter, or place of an effect.
        sizes: SI values of the parameters changed; of a parameter around which it changes.
        scale: size of the change [SI], 1 for an effect.
        owner: place of the effect that it belongs to, "" for a parameter of the plant.
        effect: whether it is the effect as a whole.
        difference: change of all outputs of all logs, shape (m,); None where a run leaves the
            finite numbers.
    """

    name: str
    sizes: Mapping[str, float]
    scale: float = 1.0
    owner: str = ""
    effect: bool = False
    difference: Array | None = None


def _response(problem: Problem, values: Mapping[str, float]) -> Array | None:
    """Return all outputs that a fit may see, in noise floors, or None if they are not finite."""
    try:
        outputs = [run.outputs(values)[run.log.fitted] for run in problem.runs]
    except UserError:
        return None
    weights = [np.array([problem.sigma[name] for name in log.outputs]) for log in problem.logs]
    return np.concatenate([(out / weight).T.ravel() for out, weight in zip(outputs, weights)])


def _outputs(problem: Problem) -> dict[str, Mask]:
    """Return where in a response each output stands, shape (m,) of bool."""
    names = [np.full(int(log.fitted.sum()), name) for log in problem.logs for name in log.outputs]
    every = np.concatenate(names)
    return {name: every == name for name in np.unique(every).tolist()}


def _parameters(model: Model, asked: Collection[str], priors: Mapping[str, float]) -> list[Free]:
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
    switches: dict[str, dict[str, float]] = {}
    for name, parameter in model.plant.parameters.items():
        if parameter.owner and parameter.param.switch:
            switches.setdefault(parameter.owner, {})[name] = model.values[name]
    return switches


def _typical(model: Model, sizes: Mapping[str, float]) -> dict[str, float]:
    return {name: model.plant.parameters[name].param.typical for name in sizes}


def _effects(model: Model) -> list[tuple[str, dict[str, float]]]:
    """Return settings that put each effect on at its typical size, or off if it is on."""
    return [
        (place, dict.fromkeys(sizes, 0.0) if any(sizes.values()) else _typical(model, sizes))
        for place, sizes in _switches(model).items()
        if not model.plant.main(place).effect.hints.learnt  # it has no size that is typical
    ]


def _switched(problem: Problem, nominal: Array, place: str, sizes: Mapping[str, float]) -> Cause:
    """Return what settings of an effect change against the nominal response."""
    response = _response(problem, sizes)
    moved = None if response is None else response - nominal
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


def _slopes(problem: Problem, model: Model, changes: Sequence[Free], together: bool) -> Slopes:
    """Return the slopes of parameters, those that are ``together`` free of one another as well.

    An effect that is off is on at its typical size meanwhile.
    """
    known, plant = _switches(model), model.plant
    causes: list[Cause] = []
    steps: dict[str, Callable[[float], float]] = {}
    jitters, groups = [np.zeros(problem.samples)], []
    for batch in [changes] if together and changes else [[change] for change in changes]:
        owners = [plant.parameters[change.name].owner for change in batch]
        off = [known[it] for it in owners if it in known and not any(known[it].values())]
        around = {name: value for sizes in off for name, value in _typical(model, sizes).items()}
        at = replace(model, values={**model.values, **around})
        local = Problem(at, problem.logs, batch, sigma=problem.sigma, workers=problem.workers)
        told = information(local, local.start)
        for i, (change, owner) in enumerate(zip(batch, owners)):
            moved = None if i in told.refused else told.slopes[: local.samples, i]
            sizes = {change.name: change.start}
            causes.append(Cause(change.name, sizes, change.scale, owner, False, moved))
            steps[change.name] = partial(_with_steps, local, i, told)
        groups += [tuple(batch[i].name for i in group) for group in told.groups]
        jitters += [told.jitter] if told.jitter.any() else []
    return Slopes(causes, steps, min(jitters[1:] or jitters, key=np.sum), tuple(groups))


def _with_steps(problem: Problem, i: int, told: Information, error: float) -> float:
    """A standard error [scales] to expect, with steps of the response in it."""
    along = Axis(problem, problem.start, i)
    if np.isfinite(error):
        return along.tread(error, float(np.linalg.norm(told.slopes[: problem.samples, i])))
    alone = told.open[i] and not any(i in group for group in told.groups)
    return along.needle(right=True) if alone else error


# Differences beside each other


class Comparison:
    """Inner products of all differences, and what remains of them beside free parameters."""

    def __init__(
        self,
        causes: Sequence[Cause],
        asked: Iterable[str],
        priors: Mapping[str, float],
        jitter: Array,
    ) -> None:
        """Roughness of the response counts as noise beside the floor; ``jitter`` is its variance
        [noise floors^2], shape (m,).  Slopes are without it, differences by effects are not."""
        self.causes = causes
        # two simulations differ by twice the variance of each
        self.noise = 1.0 + 2.0 * jitter
        self.differences = np.array([cause.difference for cause in causes]) / np.sqrt(self.noise)
        self.rough = np.array([c.effect for c in causes])[:, None] * (1.0 - 1.0 / self.noise)
        free = set(asked)
        self.free = [i for i, c in enumerate(causes) if c.name in free and not c.effect]
        data = self.differences @ self.differences.T
        powers = np.maximum(np.diag(data) - self.rough.sum(axis=1), 0.0)
        self.data = data - np.diag(np.diag(data) - powers)
        self.gram = self.data + np.diag([float(c.name in priors) for c in causes])

    def rest(self, *which: int) -> Array:
        """Inner products of what remains of causes beside the free parameters of no one of them.

        Shape (k, k) for k causes.
        """
        involved = {self.causes[i].name for i in which} | {
            self.causes[i].owner for i in which if self.causes[i].effect
        }
        others = [
            i
            for i in self.free
            if self.causes[i].name not in involved and self.causes[i].owner not in involved
        ]
        cross = self.gram[np.ix_(which, others)]
        unit = 1.0 / np.sqrt(np.maximum(self.gram[others, others], 1e-300))
        known = self.gram[np.ix_(others, others)] * np.outer(unit, unit)
        inverse = np.linalg.pinv(known, SINGULAR, hermitian=True) * np.outer(unit, unit)
        return np.asarray(self.gram[np.ix_(which, which)] - cross @ inverse @ cross.T)

    def alike(self, i: int, other: int) -> bool:
        """Return whether two causes look alike beside the other free parameters."""
        rest = self.rest(i, other)
        if (np.diag(rest) <= EXPLAINED * self.gram[[i, other], [i, other]]).any():
            return False
        return bool(abs(rest[0, 1]) > ALIKE_COSINE * np.sqrt(rest[0, 0] * rest[1, 1]))
