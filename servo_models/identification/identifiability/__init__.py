"""What logs can determine: how far each parameter and effect would move what was measured.

Every figure is a response difference of the model in the loop that made the log, in units
of the noise floor, which is taken as white; so errors are the least that can be expected.
What free parameters explain of a difference, inside their priors, does not count: an effect
that passes for another gain is not shown.
Source: Ljung, System Identification, 2nd ed., sec. 9.4 (asymptotic covariance), sec. 13
(informative experiments) and sec. 7.4 (a prior is one more row of the regression).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.analysis.isolability import cause, experiment
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model
from servo_models.core.types import Mask
from servo_models.core.workers import Workers
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.identifiability import responses
from servo_models.identification.identifiability.ambiguity import EXPLAINED, Comparison
from servo_models.identification.problem import Problem

SHOWN = 0.5
"""RMS difference in noise floors below which a log shows nothing: noise is never quite white,
and models are never quite right."""


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
        remains: the same after the free parameters have explained what they can.
        alone: expected standard error, in scales, if nothing else were free, without prior.
        together: the same with all free parameters free, and with the priors.
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
    nominal = responses.response(problem, {})
    if nominal is None:
        raise UserError("the nominal model leaves the finite numbers on these logs: correct it")
    changes = responses.parameters(model, asked, given)
    settings = responses.effects(model)
    told = responses.slopes(problem, model, changes, together=bool(asked))
    parameters = told.causes
    effects = list(
        problem.workers.map(lambda it: responses.difference(problem, nominal, *it), settings)
    )
    causes = [c for c in (*parameters, *effects) if c.difference is not None]
    evidence = Comparison(causes, asked, given, told.jitter)
    outputs = responses.outputs(problem)
    reaches = [_reach(i, evidence, outputs, told) for i in range(len(causes))]
    return Identifiability(
        parameters=tuple(reach for reach in reaches if not reach.effect),
        effects=tuple(reach for reach in reaches if reach.effect),
        groups=_groups(model.plant, reaches, evidence, asked),
        together=told.groups,
        refused=tuple(c.name for c in (*parameters, *effects) if c.difference is None),
    )


def _reach(
    i: int, evidence: Comparison, outputs: Mapping[str, Mask], told: responses.Slopes
) -> Detectability:
    found, difference = evidence.causes[i], evidence.differences[i]
    squares = difference**2 - evidence.rough[i]
    moved = {n: float(np.sqrt(max(np.mean(squares[at]), 0.0))) for n, at in outputs.items()}
    most = max(moved, key=lambda name: moved[name])
    whole = float(evidence.data[i, i])
    rest = max(float(evidence.rest(i)[0, 0]), 0.0)
    prior = float(evidence.gram[i, i]) - whole
    alone, together = (
        1.0 / np.sqrt(it) if it > EXPLAINED * whole else np.inf for it in (whole, rest)
    )
    if found.name in told.steps and prior == 0.0:
        alone, together = (told.steps[found.name](it) for it in (alone, together))
    return Detectability(
        name=found.name,
        effect=found.effect,
        sizes=found.sizes,
        scale=found.scale,
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
