"""Fit any parameters of any actuator, effects included, to any logs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from servo_models.core.plant import check_known
from servo_models.core.simulate import Model
from servo_models.core.stop import Tell, silent
from servo_models.core.types import Array
from servo_models.core.workers import Workers
from servo_models.data.audit import audits, noise_floors, show_motion
from servo_models.data.log import Log
from servo_models.data.outliers import without_outliers
from servo_models.data.sensor import FLAG
from servo_models.errors import UserError, did_you_mean
from servo_models.identification.doubts import about_errors, is_far, warnings
from servo_models.identification.linear_inference import spread
from servo_models.identification.optimise import (
    LOCAL,
    SEARCHES,
    Optimum,
    polished,
    search,
)
from servo_models.identification.problem import (
    WIDER_PRIOR,
    Free,
    Problem,
    free_names,
    free_parameter,
)
from servo_models.identification.resolution import with_unsure_inputs
from servo_models.identification.result import Doubt, Identification, conclude
from servo_models.identification.simulation import false_starts
from servo_models.identification.starts import with_starts

METHODS = {
    "local": "simulation error, least squares",
    "global": "simulation error, CMA-ES and least squares",
}
REWEIGHTINGS = 10  # most rounds of fits with new weights
SAME_WEIGHT = 0.02  # relative change of a weight up to which it stays
LEAST_WEIGHT = 1e-8  # weight over the scatter of a reading, below which the error is rounding


def fit(
    model: Model,
    logs: Sequence[Log],
    free: Sequence[str],
    priors: Mapping[str, float] | None = None,
    kind: str = LOCAL,
    starts: int = 1,
    seed: int = 0,
    jobs: int | None = None,
    progress: Tell = silent,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    where: object = None,
) -> Identification:
    """Estimate parameters by least squares of the simulation error over all logs.

    Args:
        model: nominal values; what is not free stays there.
        logs: measured runs; samples marked as held out are never fitted.
        free: parameters, or effects, which means all of their parameters.
        priors: standard deviations [SI] of nominal values, by parameter.
        kind: ``"local"`` or ``"global"``.
        starts: local searches from different starts.
        seed: of those starts.
        jobs: runs at once, by default the processors there are.
        progress: is told what goes on.
        bounds: least and largest value [SI], by parameter; by default those of the actuator.
        where: the description, for messages.

    Raises:
        UserError: no free parameter, an unknown one, one that every log states as a constant; see
            ``preconditions.checked_logs``.
    """
    names = free_names(model.plant, free)
    _check(logs, names, kind)
    logs = checked_logs(model, logs, len(names), where)
    parameters = model.plant.parameters
    given, limits = priors or {}, bounds or {}
    chosen = [
        free_parameter(parameters[n], model.values[n], given.get(n), limits.get(n)) for n in names
    ]
    with Workers(jobs) as workers:
        problem = Problem(model, logs, chosen, workers=workers)
        return _fitted(problem, kind, starts, seed, progress)


def _fitted(problem: Problem, kind: str, starts: int, seed: int, tell: Tell) -> Identification:
    # effects to be freed are still off
    nominal = Problem(problem.model, problem.logs, [], sigma=problem.sigma)
    before = nominal.responses(np.empty(0))
    problem, optimum = _reweighted_search(problem, search(problem, kind, starts, seed, tell), tell)
    while (free := _widened(problem, optimum.vector)) != problem.free and not optimum.interrupted:
        tell("widening the priors of parameters that moved far")
        problem = replace(problem, free=free, start=optimum.vector)
        again = search(problem, LOCAL, 1, 0, tell, smooth=optimum.widths is None)
        problem, optimum = _reweighted_search(problem, replace(again, costs=optimum.costs), tell)
    if optimum.widths is not None and not optimum.interrupted:
        optimum = polished(problem, optimum, seed, tell)
    return _concluded(problem, optimum, before, kind, starts, tell)


def _widened(problem: Problem, vector: Array) -> list[Free]:
    """Free parameters, those that moved far with a wider prior: with its own, one would stay
    between what is believed and what the logs show."""
    values = problem.values(vector)
    return [
        replace(free, prior=WIDER_PRIOR * free.prior, widened=WIDER_PRIOR)
        if free.prior and free.widened == 1.0 and is_far(free, values[free.name])
        else free
        for free in problem.free
    ]


def _reweighted_search(problem: Problem, optimum: Optimum, tell: Tell) -> tuple[Problem, Optimum]:
    """Search again while each output is weighted by its own error."""
    # one weight on everything moves no optimum
    moving = len(problem.sigma) > 1 or any(free.prior for free in problem.free)
    for _ in range(REWEIGHTINGS if not optimum.interrupted else 0):
        weights, problem = problem.sigma, _reweighted(problem, optimum.vector)
        if not moving or all(
            abs(sigma - weights[name]) <= SAME_WEIGHT * sigma
            for name, sigma in problem.sigma.items()
        ):
            break
        again = search(problem, LOCAL, 1, 0, tell, smooth=optimum.widths is None)
        optimum = replace(again, costs=optimum.costs)
        if optimum.interrupted:
            break
    return problem, optimum


def _concluded(
    problem: Problem,
    optimum: Optimum,
    before: list[dict[str, Array]],
    kind: str,
    starts: int,
    tell: Tell,
) -> Identification:
    """Standard errors of a fit, and what makes it doubtful."""
    tell("standard errors")
    optimum = replace(optimum, vector=_on_bounds(problem, optimum.vector))
    values = problem.values(optimum.vector)
    try:
        uncertainty = spread(problem, optimum.vector)
    except KeyboardInterrupt:  # the search is over: whoever stops now wants what it has found
        tell("finishing the standard errors; Ctrl-C again gives up")
        uncertainty = spread(problem, optimum.vector)
    odd = false_starts(problem.runs, values)
    beyond = [text for run in problem.runs for text in run.notices(values)]
    said = [*map(Doubt, odd), *beyond, *warnings(problem, optimum.vector, uncertainty)]
    said += _ending(optimum, kind, starts)
    fitted = replace(problem.model, values={**problem.model.values, **values})
    told = conclude(problem, optimum, uncertainty, fitted, before, METHODS[kind], said)
    return replace(told, warnings=(*about_errors(told), *said))


def _check(logs: Sequence[Log], names: Sequence[str], kind: str) -> None:
    if kind not in SEARCHES:
        raise UserError(f"unknown search '{kind}'; {did_you_mean(kind, SEARCHES)}")
    if not names:
        raise UserError("no parameter is free: name some with --free, or give an uncertainty")
    for name in fixed_by(logs, names):
        raise UserError(f"every log states '{name}', which is to be free: drop one of the two")


def fixed_by(logs: Sequence[Log], names: Iterable[str]) -> tuple[str, ...]:
    """Return those of some parameters that every log that is fitted states as a constant."""
    fitted = [log for log in logs if log.fitted.any()]
    return tuple(name for name in names if fitted and all(name in log.constants for log in fitted))


def _reweighted(problem: Problem, vector: Array) -> Problem:
    """The problem with each output weighted by its own error, which is maximum likelihood."""
    sigma = {}
    for name in problem.sigma:
        errors = [
            (response[name] - log.outputs[name])[log.fitted]
            for response, log in zip(problem.responses(vector), problem.logs)
            if name in log.outputs and log.fitted.any()
        ]
        if errors:
            with np.errstate(over="ignore"):  # an infinite one is refused in the end
                rms = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
            flag = problem.model.plant.wire[name].flag
            least = FLAG if flag else LEAST_WEIGHT * problem.scatter(name)
            sigma[name] = max(rms, least)
    return problem.weighted_by({**problem.sigma, **sigma}, vector)


def _on_bounds(problem: Problem, vector: Array) -> Array:
    """A search inside the bounds comes near them only: an effect that it wants off is off."""
    sides = np.array(problem.sides(vector))
    low, high = problem.bounds
    moved = np.where(sides == "low", low, np.where(sides == "high", high, vector))
    near, there = problem.costs([vector, moved])
    return moved if there <= near * (1.0 + 1e-6) else vector


def _ending(optimum: Optimum, kind: str, starts: int) -> list[str]:
    if optimum.interrupted:
        return [Doubt("stopped before it converged: these are the best values so far")]
    if not optimum.converged:
        return [Doubt("the search did not converge: give it more starts or fewer free parameters")]
    if optimum.widths is not None and kind == LOCAL and starts == 1:
        return [
            "the response is rough in these parameters, as with a quantiser or dry friction in"
            " a loop: there may be better values; try more starts or a global search"
        ]
    return []


# What no fit can do without: logs with samples to fit, and commands that move


def checked_logs(
    model: Model, logs: Sequence[Log], free: int = 0, where: object = None
) -> tuple[Log, ...]:
    """Return logs with how they begin and without single wild readings; refuse what nothing could
    be said of, before the work.  So many parameters are ``free``; ``where`` names the
    description.

    Raises:
        UserError: no logs; every sample held out; an output that the model has not; no more
            samples than free parameters; a log on which the nominal model cannot be simulated;
            inputs that never change, neither in a log nor from one to another, where nothing
            moves either.
    """
    told = "the description" if where is None else f"'{where}'"
    if not logs:
        raise UserError(f"{told} describes no log: add [[logs]]")
    fitted = [log for log in logs if log.fitted.any()]
    if not fitted:
        raise UserError(f"{told} holds out every sample: leave some to fit")
    for log in logs:
        check_known("output", log.outputs, model.plant.outputs)
    logs = [without_outliers(log, model.plant) for log in logs]
    samples = sum(int(log.fitted.sum()) for log in logs)
    if samples <= free:
        raise UserError(
            f"{samples} samples to fit for {free} free parameters: give a longer log, hold"
            " out less, or free fewer"
        )
    for log in logs:
        _check_simulated(model, log, told)
    begun = with_starts(model, logs)
    if not show_motion([log for log in begun if log.fitted.any()], model.plant):
        raise UserError(
            "no input ever changes, neither in a log nor from one to another, and nothing moves: a"
            " single standstill tells nothing of a motion; record a command that moves"
        )
    return with_unsure_inputs(model, begun, {}, noise_floors(audits(begun, model.plant)))


def _check_simulated(model: Model, log: Log, told: str) -> None:
    try:
        Problem(model, [log], []).responses(np.empty(0))
    except UserError as error:
        stated = ", or the constants of this log" if log.constants else ""
        cure = "" if model.actuator.inner else f"; correct its parameters{stated}"
        raise UserError(
            f"{told}: the nominal model cannot be simulated on log '{log.name}': {error}{cure}"
        ) from error
