"""Search for the best parameters: least squares from several starts, or CMA-ES and then that.

A least-squares search needs slopes; CMA-ES does not, and finds its way where an effect with
a threshold has none, or a rough surface too many.  Whatever ends a search, the best point seen so
far is its result.
Sources: Branch, Coleman, Li, SIAM J. Sci. Comput. 21 (1999), trust region reflective;
Hansen, The CMA evolution strategy: a tutorial (2016).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.identification.information import information, moved, units
from servo_models.identification.problem import DIFFERENCE, Problem

Progress = Callable[[str], None]

LOCAL = "local"
GLOBAL = "global"
SEARCHES = (LOCAL, GLOBAL)
TOLERANCE = 1e-8
LIMIT = 60
"""Steps of one least-squares search."""
GENERATIONS = 60
RUNS = 3
"""Runs of CMA-ES, each with twice the population (Auger, Hansen, IEEE CEC 2005)."""

SLOPE_STEPS = (1e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # of the scale of a parameter
"""Wider steps that are tried in turn where the response is rough."""
SLOPE_DISAGREEMENT = 0.5  # of the slope over the wider step
"""From which two slopes differ."""
POLISHES = 2
"""Runs of CMA-ES over the dents of a rough surface, each about the best point so far."""
POLISH_GENERATIONS = 30
POLISH_WIDTH = 0.1
"""Standard deviation of a value, relative to it, where logs tell nothing of it."""
POLISH_REACH = 3.0
"""First step of such a run, in standard errors."""
WORTHWHILE = 0.1
"""Decrease of the squared errors, in their mean, below which a polish ends: less is within the
noise."""


@dataclass(frozen=True)
class Optimum:
    """Where a search ended.

    Attributes:
        vector: best point, shape (p,), in scales.
        cost: half the sum of its squared residuals.
        converged: the last local search met its tolerance.
        interrupted: the user stopped it.
        costs: of every start, sorted.
        widths: steps of slopes where the response is rough, shape (p,), see ``steps``.
    """

    vector: Array
    cost: float
    converged: bool
    interrupted: bool
    costs: tuple[float, ...]
    widths: Array | None = None


def search(
    problem: Problem,
    kind: str,
    starts: int,
    seed: int,
    tell: Progress,
    smooth: bool = False,
) -> Optimum:
    """Minimise the problem's squared residuals.

    Args:
        problem: it remembers the best point seen.
        kind: ``"local"`` or ``"global"``.
        starts: local searches, the first from the nominal values.
        seed: of the other starts and of CMA-ES.
        tell: is told a sentence about each stage.
        smooth: the response is known to have slopes, so that nobody has to look.
    """
    ends: list[tuple[float, Array, bool]] = []
    stopped = False
    widths: Array | None = None
    try:
        problem.residuals(problem.nominal)  # a result is never worse
        widths = None if smooth else steps(problem, _inside(problem, problem.start))
        if kind == GLOBAL:
            tell("global search (CMA-ES)")
            _explore(problem, seed, tell)
            ends.append(descend(problem, problem.memory.best[1], widths=widths))
        for count, start in enumerate(_starts(problem, starts, seed)):
            tell(f"least squares, start {count + 1} of {starts}{_so_far(problem)}")
            ends.append(descend(problem, start, widths=widths))
        if problem.memory.best[0] < min(cost for cost, _, _ in ends):
            ends.append(descend(problem, problem.memory.best[1], widths=widths))
    except KeyboardInterrupt:
        stopped = True
    cost, vector = problem.memory.best
    met = any(ok for end, _, ok in ends if end <= cost * (1.0 + 1e-6))
    costs = tuple(sorted(end for end, _, _ in ends))
    return Optimum(vector, cost, met and not stopped, stopped, costs, widths)


def polished(problem: Problem, found: Optimum, seed: int, tell: Progress) -> Optimum:
    """Return a better point than a search on a rough surface has found, or the same.

    Least squares end in the first dent.  CMA-ES goes on over the dents, in the region in which
    slopes that several widths agree on say that the values may lie.
    """
    try:
        for run in range(POLISHES):
            _polish(problem, seed + run, tell)
    except KeyboardInterrupt:
        found = replace(found, converged=False, interrupted=True)
    cost, vector = problem.memory.best
    return replace(found, vector=vector, cost=cost)


def _polish(problem: Problem, seed: int, tell: Progress) -> None:
    """One run of CMA-ES about the best point, over the values off their bounds."""
    cost, vector = problem.memory.best
    inner = [i for i, side in enumerate(problem.sides(vector)) if not side]
    if not inner or cost == 0.0:
        return
    noise = 2.0 * cost / problem.samples
    slopes = information(problem, vector, inner).slopes[:, inner]
    widths = POLISH_WIDTH * units(vector)[inner]
    precision = slopes.T @ slopes / noise + np.diag(widths**-2.0)
    axes = np.zeros((len(vector), len(inner)))
    axes[inner] = np.linalg.cholesky(np.linalg.inv(precision))

    def point(way: Array) -> Array:
        return moved(problem, vector, axes @ way)

    options = {"maxiter": POLISH_GENERATIONS, "tolfun": WORTHWHILE * noise, "seed": seed + 1}
    _evolve(problem, point, np.zeros(len(inner)), POLISH_REACH, options, tell)


def _so_far(problem: Problem) -> str:
    cost = problem.memory.best[0]
    if not np.isfinite(cost):
        return ""
    return f", best so far {np.sqrt(2.0 * cost / max(problem.samples, 1)):.4g} sigma"


def _starts(problem: Problem, count: int, seed: int) -> Iterator[Array]:
    """Nominal values first, then draws: from the prior, or from a third to three times."""
    random = np.random.default_rng(seed)
    low, high = problem.bounds
    yield np.clip(problem.start, low, high)
    for _ in range(count - 1):
        draw = [
            free.nominal + free.prior * random.standard_normal()
            if free.prior is not None
            else (free.start or free.scale) * 3.0 ** random.uniform(-1.0, 1.0)
            for free in problem.free
        ]
        yield np.clip(np.array(draw) / problem.scales, low, high)


def descend(
    problem: Problem,
    start: Array,
    tolerance: float = TOLERANCE,
    limit: int = LIMIT,
    widths: Array | None = None,
) -> tuple[float, Array, bool]:
    """Return cost, vector and success of one least-squares search of at most ``limit`` steps.

    Slopes are taken over ``widths`` [scales], shape (p,); None for small differences.
    """
    from scipy.optimize import least_squares

    done = least_squares(
        problem.residuals,
        _inside(problem, start),
        jac=lambda vector: problem.jacobian(vector, widths),
        bounds=problem.bounds,
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=limit,
    )
    return float(done.cost), done.x, bool(done.status > 0)


def _inside(problem: Problem, vector: Array) -> Array:
    """A vector moved a little off its bounds, where a search may begin."""
    low, high = problem.bounds
    margin = 1e-9 * np.maximum(1.0, np.abs(vector))
    return np.clip(vector, low + margin, high - margin)


def _explore(problem: Problem, seed: int, tell: Progress) -> None:
    """CMA-ES over the box of plausible values, again with twice the population from elsewhere."""
    low, high = _box(problem)
    p = len(problem.free)
    random = np.random.default_rng(seed)
    middle = np.clip((problem.start - low) / (high - low), 0.05, 0.95)
    for run in range(RUNS):
        options = {
            "bounds": [0.0, 1.0],
            "seed": seed + run + 1,
            "popsize": _population(p) * 2**run,
            "maxiter": GENERATIONS,
            "tolfun": 1e-6,
        }
        _evolve(problem, lambda way: low + (high - low) * way, middle, 0.25, options, tell)
        middle = random.uniform(0.05, 0.95, p)


def _population(p: int) -> int:
    return 8 + int(3.0 * np.log(p))


def _evolve(
    problem: Problem,
    vector_of: Callable[[Array], Array],
    middle: Array,
    reach: float,
    options: dict[str, Any],
    tell: Progress,
) -> None:
    """One run of CMA-ES; the problem remembers the best point.

    Args:
        problem: whose costs count.
        vector_of: maps a point of the search, shape (p,), to a vector [scales].
        middle: where it begins, shape (p,).
        reach: standard deviation of the first points.
        options: of ``cma``.
        tell: is told each generation.
    """
    import cma

    p = len(middle)
    begin = np.resize(middle, max(p, 2))  # cma wants two dimensions; a second one may be idle
    every = {"popsize": _population(p), "verbose": -9, **options}
    strategy = cma.CMAEvolutionStrategy(begin, reach, every)
    while not strategy.stop():
        points = strategy.ask()
        strategy.tell(points, problem.costs([vector_of(np.asarray(one)[:p]) for one in points]))
        tell(f"CMA-ES, generation {strategy.countiter}{_so_far(problem)}")


def _box(problem: Problem) -> tuple[Array, Array]:
    """Where a global search looks: four prior deviations, or up to ten times the start."""
    low, high = problem.bounds
    for i, free in enumerate(problem.free):
        if free.prior is not None:
            around = free.nominal - 4.0 * free.prior, free.nominal + 4.0 * free.prior
        else:
            reach = 10.0 * max(abs(free.start), free.scale)
            around = -reach, reach
        low[i] = max(low[i], around[0] / free.scale)
        high[i] = min(high[i], around[1] / free.scale)
    return low, high


def steps(problem: Problem, vector: Array) -> Array | None:
    """Return for each parameter the least step whose slope the next wider step confirms.

    A quantiser, dry friction or a sampler inside a loop makes the response a staircase of its
    parameters, or throws a limit cycle to and fro: small differences are then 0, or noise that
    grows as the step shrinks.
    Source: More, Wild, Estimating derivatives of noisy simulations, ACM TOMS 38 (2012).

    They are in scales, shape (p,); None where the smallest step will do for all.
    """
    widths = np.full(len(vector), DIFFERENCE)
    rough = np.ones(len(vector), dtype=bool)
    finer = problem.jacobian(vector)[: problem.samples]
    for step in SLOPE_STEPS:
        wider = problem.jacobian(vector, np.full(len(vector), step))[: problem.samples]
        size = np.linalg.norm(wider, axis=0)
        rough &= np.linalg.norm(finer - wider, axis=0) > SLOPE_DISAGREEMENT * size
        if not rough.any():
            break
        widths[rough] = step
        finer = wider
    return widths if np.any(widths > DIFFERENCE) else None
