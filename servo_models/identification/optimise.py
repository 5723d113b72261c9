"""Search for the best parameters: least squares from several starts, or CMA-ES and then that.

A least-squares search needs slopes; CMA-ES does not, and finds its way where an effect with
a threshold has none, or a rough surface too many.  Whatever ends a search, the best point seen so
far is its result.
Least squares are those of Levenberg and Marquardt on the normal equations, inside bounds.  Slopes
are not taken anew at every step: Broyden's rule corrects them by what the step has shown, and only
where they mispredict, or a step fails, are they simulated.  A diagnosis makes hundreds of such
fits, each of a few dozen simulations.
Where data show parameters only together, damped steps stop short of what priors say of each: that
valley bends, and slopes across it are millions of times those along it.  So a search ends with
whole steps by factors, along which products stay what they are, and steps back across the valley.
Sources: Marquardt, J. SIAM 11 (1963); Nocedal, Wright, Numerical Optimization, 2nd ed., secs. 10.3
and 16.7 (projection on a box); Broyden, Mathematics of Computation 19 (1965); Allgower, Georg,
Numerical Continuation Methods (1990) (predictor and corrector); Hansen, The CMA evolution strategy:
a tutorial (2016).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from servo_models.core.stop import Tell
from servo_models.core.types import Array
from servo_models.identification.linear_inference import (
    ROUNDING,
    information,
    moved,
    symmetries,
    units,
)
from servo_models.identification.problem import DIFFERENCE, Problem

LOCAL = "local"
GLOBAL = "global"
SEARCHES = (LOCAL, GLOBAL)
TOLERANCE = 1e-8  # relative decrease of the cost that ends a search
LIMIT = 60  # steps of one least-squares search
GENERATIONS = 60  # most generations of a run of CMA-ES
RUNS = 3  # runs of CMA-ES, each with twice the population (Auger, Hansen, IEEE CEC 2005)

SLOPE_STEPS = (1e-3, 1e-2, 3e-2, 1e-1, 3e-1)  # wider steps in scales where a response is rough
SLOPE_DISAGREEMENT = 0.5  # difference of two slopes over the wider step's from which they differ
POLISHES = 2  # runs of CMA-ES over the dents of a rough surface, each about the best point so far
POLISH_GENERATIONS = 30  # most generations of such a run
POLISH_WIDTH = 0.1  # standard deviation of a value, relative to it, where logs tell nothing of it
POLISH_REACH = 3.0  # first step of such a run [standard errors]
WORTHWHILE = 0.1  # decrease over the mean squared error below which a search ends: noise does that
VALLEY_STEPS = 12  # most steps along a valley
VALLEY_PARTS = (1.0, 0.5, 0.25, 0.1)  # parts of a whole step, the first that leaves less is taken
LARGEST_FACTOR_LOG = 0.7  # natural log of the factor by which such a step moves a value at most
STEEP_OVER_PRIOR = 30.0  # slopes of the data over those of the priors that lead across a valley
STEPS_BACK = 3  # steps back into the valley, with the slopes of where a step began
MISPREDICTED_SHARE = 0.4  # part of a change that slopes may miss and still be corrected
FIRST_DAMPING = 1e-3  # damping over the diagonal of the normal equations
LEAST_DAMPING = 1e-9  # smallest damping
MOST_DAMPING = 1e8  # damping with which a search gives up
DAMPING_AFTER_GOOD = 0.2  # factor on the damping after a good step
DAMPING_AFTER_FAILED = 5.0  # factor after a step that failed
POOR_DECREASE = 0.01  # decrease over the predicted one below which a step fails
GOOD_DECREASE = 0.5  # decrease over the predicted one above which damping falls
PROMISED_AT_MOST = 4.0  # what a search may still gain over what its next step promises
ROUNDS = 4  # most rounds of so many steps
ROUND_COST_RATIO = 0.8  # cost after a round over before up to which there is another
STEPS_PER_JACOBIAN = 3  # steps for which a search may afford slopes once


@dataclass(frozen=True)
class Optimum:
    """Where a search ended.

    Attributes:
        vector: best point, shape (p,), in scales.
        cost: half the sum of its squared residuals.
        converged: the last local search met its tolerance.
        interrupted: the user stopped it.
        costs: costs of every start, sorted.
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
    tell: Tell,
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
        low, high = problem.bounds
        margin = 1e-9 * np.maximum(1.0, np.abs(problem.start))  # off its bounds
        begin = np.clip(problem.start, low + margin, high - margin)
        widths = None if smooth else steps(problem, begin)
        if kind == GLOBAL:
            tell("global search (CMA-ES)")
            _explore(problem, seed, tell)
            ends.append(_local(problem, problem.memory.best[1], widths))
        for count, start in enumerate(_starts(problem, starts, seed)):
            tell(f"least squares, start {count + 1} of {starts}{_so_far(problem)}")
            ends.append(_local(problem, start, widths))
        if problem.memory.best[0] < min(cost for cost, _, _ in ends):
            ends.append(_local(problem, problem.memory.best[1], widths))
    except KeyboardInterrupt:
        stopped = True
    cost, vector = problem.memory.best
    met = any(ok for end, _, ok in ends if end <= cost * (1.0 + 1e-6))
    costs = tuple(sorted(end for end, _, _ in ends))
    return Optimum(vector, cost, met and not stopped, stopped, costs, widths)


def polished(problem: Problem, optimum: Optimum, seed: int, tell: Tell) -> Optimum:
    """Return a better point than a search on a rough surface has found, or the same.

    Least squares end in the first dent.  CMA-ES goes on over the dents, in the region in which
    slopes that several widths agree on say that the values may lie.
    """
    try:
        for run in range(POLISHES):
            _polish(problem, seed + run, tell)
    except KeyboardInterrupt:
        optimum = replace(optimum, converged=False, interrupted=True)
    cost, vector = problem.memory.best
    return replace(optimum, vector=vector, cost=cost)


def _polish(problem: Problem, seed: int, tell: Tell) -> None:
    """One run of CMA-ES about the best point, over the values off their bounds."""
    cost, vector = problem.memory.best
    inner = [i for i, side in enumerate(problem.sides(vector)) if not side]
    if not inner or cost == 0.0:
        return
    noise = 2.0 * cost / problem.samples
    slopes = information(problem, vector, inner).slopes[:, inner]
    widths = POLISH_WIDTH * units(problem, vector)[inner]
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


def _local(problem: Problem, start: Array, widths: Array | None) -> tuple[float, Array, bool]:
    """Cost, vector and success of one least-squares search."""
    vector, met, _ = descend(problem, start, TOLERANCE, LIMIT, widths)
    vector, ended, _ = along_valley(problem, vector, widths)
    vector = as_believed(problem, vector)
    errors = problem.latest(vector)
    return 0.5 * float(errors @ errors), vector, met or ended


@dataclass
class _Point:
    """A vector, its errors, and slopes that were simulated there (``fresh``) or carried on."""

    vector: Array
    errors: Array
    slopes: Array
    fresh: bool

    @property
    def cost(self) -> float:
        return 0.5 * float(self.errors @ self.errors)


def descend(
    problem: Problem,
    start: Array,
    tolerance: float,
    limit: int,
    widths: Array | None = None,
    known: Array | None = None,
    enough: float = np.inf,
) -> tuple[Array, bool, Array | None]:
    """Return the best vector [scales] near ``start``, and whether the search met its tolerance.

    The slopes there come third, where they were simulated there, shape (m, p).

    Args:
        problem: its ``residuals`` are made small.
        start: shape (p,); a value outside its bounds is moved onto them.
        tolerance: relative decrease of the cost that ends the search.
        limit: most steps in a round.
        widths: over which slopes are taken [scales], shape (p,); None for small ones.
        known: slopes near the start, shape (m, k), of the first k parameters.
        enough: squared errors; the search ends where it cannot leave so little.
    """
    vector = np.clip(start, *problem.bounds)
    errors = problem.residuals(vector)
    at = _Point(vector, errors, _slopes(problem, vector, widths, known), fresh=known is None)
    met = False
    for _ in range(ROUNDS):
        before = at.cost
        at, met = _round(problem, at, tolerance, limit, widths, enough)
        if met or at.cost > ROUND_COST_RATIO * before:
            break
    return at.vector, met, at.slopes if at.fresh else None


def along_valley(
    problem: Problem, vector: Array, widths: Array | None = None
) -> tuple[Array, bool, Array]:
    """Return where whole steps lead along what the data hardly show, whether nothing is left to
    gain there, and the slopes there.

    Args:
        problem: with the priors that say what is best there.
        vector: where a search has ended [scales], shape (p,).
        widths: over which slopes are taken [scales], shape (p,); None for small ones.
    """
    slopes = problem.jacobian(vector, widths)
    for _ in range(VALLEY_STEPS):
        further, worth = _whole_step(problem, vector, slopes)
        if further is None:
            return vector, not worth, slopes
        vector, slopes = further, problem.jacobian(further, widths)
    return vector, False, slopes


def as_believed(problem: Problem, vector: Array) -> Array:
    """Return a vector moved by factors of which the data see nothing to where priors want it.

    It is for where a search has ended: one that is under way would end elsewhere.
    """
    along = symmetries(problem, vector)
    if not along.size:
        return vector
    (low, high), priors = problem.bounds, np.array([free.prior or np.inf for free in problem.free])
    weights, best = problem.scales / priors, vector

    def cost(point: Array) -> float:
        return float(np.sum((weights * (point - problem.nominal)) ** 2))

    for _ in range(VALLEY_STEPS):
        slopes = (weights * best)[:, None] * along
        step = (
            along @ np.linalg.lstsq(slopes, -weights * (best - problem.nominal), rcond=ROUNDING)[0]
        )
        with np.errstate(over="ignore"):  # what no number holds is out of bounds
            points = [best * np.exp(part * step) for part in VALLEY_PARTS]
        inside = (it for it in points if np.all((low < it) & (it < high) | (it == best)))
        further = next((it for it in inside if cost(it) < cost(best)), best)
        if cost(best) - cost(further) <= ROUNDING * cost(best):
            break
        best = further
    return best if problem.costs([best])[0] < problem.costs([vector])[0] else vector


def _whole_step(problem: Problem, vector: Array, slopes: Array) -> tuple[Array | None, bool]:
    """A vector after one undamped step, None where it leaves no less, and whether such a step
    promises more than it costs.

    Values on a bound stay there.
    """
    errors, n = problem.latest(vector), problem.samples
    inner = np.array([not side for side in problem.sides(vector)], dtype=bool)
    relative = np.where(inner, slopes * units(problem, vector), 0.0)
    step = np.linalg.lstsq(relative, -errors, rcond=ROUNDING)[0]
    squared = float(errors @ errors)
    promised = squared - float(np.sum((errors + relative @ step) ** 2))
    if promised <= WORTHWHILE * squared / max(n, 1):
        return None, False
    left, steepness, ways = np.linalg.svd(relative[:n], full_matrices=False)
    prior = np.linalg.norm(relative[n:] @ ways.T, axis=0)
    steep = steepness > np.maximum(STEEP_OVER_PRIOR * prior, ROUNDING * steepness.max(initial=0.0))
    across = (ways[steep].T / steepness[steep]) @ left[:, steep].T
    for part in VALLEY_PARTS:
        move = np.clip(part * step, -LARGEST_FACTOR_LOG, LARGEST_FACTOR_LOG)
        point = moved(problem, vector, move * units(problem, vector))
        for _ in range(STEPS_BACK):
            back = across @ problem.residuals(point)[:n]
            point = moved(problem, point, -back * units(problem, point))
        if 2.0 * problem.costs([point])[0] < squared:
            return point, True
    return None, True


def _round(
    problem: Problem,
    at: _Point,
    tolerance: float,
    limit: int,
    widths: Array | None,
    enough: float,
) -> tuple[_Point, bool]:
    """Steps until the tolerance is met or half ``enough`` is out of reach, or until what a round
    may cost is spent."""
    low, high = problem.bounds
    damping = FIRST_DAMPING
    spent = problem.memory.evaluations + limit * (len(at.vector) + 1) // STEPS_PER_JACOBIAN
    for _ in range(limit):
        if problem.memory.evaluations > spent:
            break
        step, promised = _step(at, low, high, damping)
        hopeless = at.cost - PROMISED_AT_MOST * promised > 0.5 * enough
        if promised <= 0.1 * tolerance * at.cost or hopeless:
            if at.fresh:
                return at, True
            at = _Point(at.vector, at.errors, problem.jacobian(at.vector, widths), fresh=True)
            continue
        errors = problem.residuals(at.vector + step)
        saved = at.cost - 0.5 * float(errors @ errors)
        if saved > POOR_DECREASE * promised:
            settled = saved < tolerance * at.cost and saved < 2.0 * promised
            at = _moved(problem, at, step, errors, widths)
            if settled:
                return at, True
            if saved > GOOD_DECREASE * promised:
                damping = max(damping * DAMPING_AFTER_GOOD, LEAST_DAMPING)
        elif not at.fresh:
            at = _Point(at.vector, at.errors, problem.jacobian(at.vector, widths), fresh=True)
        elif damping > MOST_DAMPING:
            return at, True
        else:
            damping *= DAMPING_AFTER_FAILED
    return at, False


def _slopes(problem: Problem, vector: Array, widths: Array | None, known: Array | None) -> Array:
    if known is None:
        return problem.jacobian(vector, widths)
    others = range(known.shape[1], len(vector))
    if not others:
        return known
    return np.column_stack([known, problem.jacobian(vector, widths, others)])


def _step(at: _Point, low: Array, high: Array, damping: float) -> tuple[Array, float]:
    """The damped step inside the box, and by how much it promises to lower the cost.

    It goes towards the least of the quadratic up to the first bound, and on along that: every
    part of the way leads down.
    """
    gradient, curvature = at.slopes.T @ at.errors, at.slopes.T @ at.slopes
    weights = np.diag(curvature) + 1e-12 * max(float(np.trace(curvature)), 1e-30)
    damped = curvature + np.diag(damping * weights)
    below, above = low - at.vector, high - at.vector
    step = np.zeros(len(gradient))
    inside = ~(((below >= 0.0) & (gradient > 0.0)) | ((above <= 0.0) & (gradient < 0.0)))
    while inside.any():
        towards = (gradient + damped @ step)[inside]
        move = np.zeros(len(step))
        move[inside] = -np.linalg.lstsq(damped[np.ix_(inside, inside)], towards, rcond=None)[0]
        ahead = step + move
        outside = ((move < 0.0) & (ahead < below)) | ((move > 0.0) & (ahead > above))
        if not outside.any():
            step = ahead
            break
        ends = np.where(move < 0.0, below, above)
        parts = np.divide(ends - step, move, out=np.full(len(step), np.inf), where=outside)
        step = step + max(float(parts.min()), 0.0) * move
        hit = outside & (parts == parts.min())
        step[hit] = ends[hit]
        inside &= ~hit
    return step, -float(step @ gradient + 0.5 * step @ curvature @ step)


def _moved(
    problem: Problem, at: _Point, step: Array, errors: Array, widths: Array | None
) -> _Point:
    """The point after a step, its slopes corrected by Broyden's rule where that is enough."""
    change = errors - at.errors
    missed = change - at.slopes @ step
    vector = at.vector + step
    if np.linalg.norm(missed) > MISPREDICTED_SHARE * np.linalg.norm(change):
        return _Point(vector, errors, problem.jacobian(vector, widths), fresh=True)
    slopes = at.slopes + np.outer(missed, step / float(step @ step))
    return _Point(vector, errors, slopes, fresh=False)


def _explore(problem: Problem, seed: int, tell: Tell) -> None:
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
    tell: Tell,
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
