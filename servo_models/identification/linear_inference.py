"""What logs tell of parameters near a point: slopes, standard errors, and what bounds leave open.

*Slopes* hold over the width to which each parameter is to be known.  A quantiser, a hold, a rounded
clock or dry friction in a loop makes a response rough: a slope over a width w is the true one and
a random part of about roughness / w.  That part breaks exact degeneracies, since no two columns of
it are alike, and adds information that is not there: J'J has the random part's energy on its
diagonal.  So every slope is taken over several widths, whose random parts are independent: what
they agree on is the slope, what they do not agree on is subtracted from J'J, and a combination of
parameters of which nothing is left is unseen.

Combinations are probed along themselves, not put together from single parameters: the weaker one
is, the wider it is moved.  Positive parameters move by factors, so that groups which enter as a
product or a ratio stay exactly where they do nothing.

*Standard errors* follow from the slopes and the colour of the errors, and are never smaller than
what a half internal step would move the estimates by.

*Boxes*: what parameters would do about a change of the response asks for thousands of small
quadratic problems, solved together.  Without their bounds parameters would do wonders, and ten
deviations of a stiffness hide an offset.
Sources: Fuller, Measurement Error Models, 1987, secs. 1.2 and 2.2 (noise in regressors); More,
Wild, ACM TOMS 38 (2012) (derivatives of noisy simulations); Ljung, System Identification, 2nd ed.,
sec. 9.3 (coloured errors); Portugal, Judice, Vicente, Mathematics of Computation 63 (1994) 625
(block principal pivoting, one variable at a time where blocks take turns).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.statistics import autocovariance, inflation, rms, scatter
from servo_models.core.types import Array, Mask
from servo_models.errors import UserError
from servo_models.identification.problem import Problem

NARROW = 0.01  # least half width of a slope, relative to the value of what moves most
WIDE = 0.3  # largest half width
NEAR_ZERO = 0.1  # value in scales below which a change is in scales
PARTS = (1.0, 0.7)  # widths of a slope over the largest of them
MORE_PARTS = (1.0, 0.7, 0.85, 0.6, 0.92, 0.78)
"""Widths over the largest where two still disagree: noise falls with their number."""
ASIDE = 0.02  # largest relative move of the middle of a slope: else widths meet the same steps
ASIDE_OVER_WIDTH = 2.0  # largest of these parts over a narrow width
AGREED = 0.01  # share of a slope's energy in which two widths may disagree without being widened
NARROWER = (3e-4, 1e-5)  # half widths beside roughness: curvature falls with width, roughness grows
WIDER = 3.0  # factor on a width over which slopes do not agree
ROUNDS = 6  # times that weak combinations are probed, each along what the last one found
FAIR = 0.25  # energy of the random part of a slope over the disagreement: curvature passes for it
WEAK = 0.05  # share of noise in a combination from which it is probed along itself
KNOWN = 1.0 - 1e-8  # cosine between combinations from which probing both tells nothing new
UNSEEN = 0.3  # share of noise in a combination over the largest width, from which it is unseen
NOTHING = 1e-3  # root of squared errors that the largest width moves at most where it does nothing
LEAST = (NOTHING / WIDE) ** 2  # energy of a slope below which nothing moves
MEMBER = 0.1  # part of the largest move in a combination from which a parameter is a member


@dataclass(frozen=True, eq=False)
class Information:
    """What logs tell of the free parameters of a problem, at a vector.

    Attributes:
        slopes: slopes of all weighted errors and then of the priors, as widths agree, per scale,
            shape (m + priors, p); a column is 0 where nothing depends on the parameter.
        unseen: combinations of which the data show nothing, each a relative change of its members
            with a largest part of 1 (of a value near 0, in scales), shape (p, k).
        jitter: variance of each weighted error by roughness of the response, shape (m,), of the
            parameter that has the median of it.
        roughness: squared errors by which the response differs from itself where one parameter is
            a little another one, shape (p,), 0 where it has not been seen.
        refused: parameters that cannot be moved, since the model then leaves the finite numbers.
    """

    slopes: Array
    unseen: Array
    jitter: Array
    roughness: Array
    refused: tuple[int, ...] = ()

    @property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Parameters that the data show only together, by position, each group in order."""
        members = np.abs(self.unseen) >= MEMBER
        linked = np.linalg.matrix_power(members @ members.T, len(members))
        groups = dict.fromkeys(tuple(np.flatnonzero(row).tolist()) for row in linked)
        return tuple(group for group in groups if len(group) > 1)

    @property
    def open(self) -> NDArray[np.bool_]:
        """Which parameters take part in a combination of which the data show nothing."""
        return np.asarray(np.any(np.abs(self.unseen) >= MEMBER, axis=1))


def units(problem: Problem, vector: Array) -> Array:
    """Return what a relative change of 1 is [scales]: the value itself, unless it is near 0 or the
    problem says less."""
    size = np.where(np.abs(vector) >= NEAR_ZERO, np.abs(vector), 1.0)
    return np.minimum(size, problem.large_changes)


def _independent(unseen: Array) -> Array:
    """The same space, by combinations with as few members as elimination gives."""
    rows = unseen.T.copy()
    for k in range(len(rows)):
        column = int(np.argmax(np.abs(rows[k])))
        rows[k] /= rows[k, column]
        for other in range(len(rows)):
            if other != k:
                rows[other] -= rows[other, column] * rows[k]
    return np.asarray((rows / np.abs(rows).max(axis=1, keepdims=True, initial=1e-300)).T)


@dataclass
class _Probes:
    """Combinations and what was seen of them.

    Attributes:
        along: combinations, relative to values, shape (p, k), each with a largest part of 1.
        slopes: mean slopes over widths, shape (m, k).
        noise: energy of their random part, shape (k,).
        widths: largest half width of each, shape (k,).
        jitter: variance of each error by roughness, shape (m, k).
        refused: whether each could not be moved, shape (k,).
    """

    along: Array
    slopes: Array
    noise: Array
    widths: Array
    jitter: Array
    refused: NDArray[np.bool_]

    def beside(self, other: _Probes) -> _Probes:
        """Return these and others."""
        pairs = zip(vars(self).values(), vars(other).values())
        return _Probes(*(np.concatenate(pair, axis=-1) for pair in pairs))

    def only(self, which: NDArray[np.bool_]) -> _Probes:
        """Return some of them."""
        return _Probes(*(values[..., which] for values in vars(self).values()))


def information(problem: Problem, vector: Array, which: Sequence[int] | None = None) -> Information:
    """Return what the logs of a problem tell at ``vector`` [scales], shape (p,).

    ``which`` names by position the parameters that may move, by default all; the slopes of others
    are 0.
    """
    p = len(vector)
    chosen = np.arange(p) if which is None else np.array(which, dtype=int)
    axes = _probed(problem, vector, np.eye(p)[:, chosen], np.full(len(chosen), NARROW))
    refused = tuple(chosen[axes.refused].tolist())
    moving = ~axes.refused & (np.sum(axes.slopes**2, axis=0) > LEAST)
    data, unseen = np.zeros((problem.samples, p)), np.empty((p, 0))
    jitter, roughness = np.zeros(problem.samples), np.zeros(p)
    if moving.any():
        here, axes = chosen[moving], axes.only(moving)
        slopes, combinations = _agreed(problem, vector, here, axes)
        data[:, here] = slopes / units(problem, vector)[here]
        unseen = np.zeros((p, combinations.shape[1]))
        unseen[here] = combinations
        roughness[here] = axes.jitter.sum(axis=0)
        order = np.argsort(roughness[here])
        jitter = axes.jitter[:, order[len(order) // 2]]
    held = [free.prior is not None for free in problem.free]
    rows = np.diag([free.scale / (free.prior or 1.0) for free in problem.free])[held]
    return Information(np.vstack([data, rows]), unseen, jitter, roughness, refused)


def _agreed(
    problem: Problem, vector: Array, here: NDArray[np.int64], axes: _Probes
) -> tuple[Array, Array]:
    """Slopes of single parameters without their random part, and combinations that are unseen."""
    errors = problem.latest(vector)[: problem.samples]
    scale = rms(errors) or 1.0
    known, smooth = axes, np.flatnonzero(axes.widths <= NARROW)
    exact = symmetries(problem, vector) * (np.abs(vector) / units(problem, vector))[:, None]
    exact = exact[:, ~np.delete(exact, here, axis=0).any(axis=0)]
    k = exact.shape[1]
    nothing = np.zeros((problem.samples, k))
    zeros = np.zeros(k)
    known = known.beside(_Probes(exact, nothing, zeros, zeros + WIDE, nothing, zeros > 0.0))
    for width in NARROWER:
        seen = 2.0 * known.jitter.mean(axis=0).max() <= scale**2
        if not len(smooth) or (seen and np.all(_principal(known, here)[2] <= WEAK)):
            break
        before, known.widths[smooth] = known.noise.copy(), width
        _tried(problem, vector, known, smooth.tolist(), PARTS)
        smooth = smooth[known.noise[smooth] < before[smooth]]
    for _ in range(ROUNDS):
        _, along, noise = _principal(known, here)
        size = np.abs(along).max(axis=0)
        along = along / size
        near = np.abs(along.T @ known.along[here]) / np.linalg.norm(along, axis=0)[:, None]
        near /= np.linalg.norm(known.along[here], axis=0)
        weak = (noise > WEAK) & ~np.any(near > KNOWN, axis=1)
        if not weak.any():
            break
        whole = np.zeros((len(vector), int(weak.sum())))
        whole[here] = along[:, weak]
        # a unit of a principal combination moves the errors by 1
        again = _probed(problem, vector, whole, scale * size[weak])
        again = again.only(~again.refused)
        _jumped(known, again, along, here)
        known = known.beside(again)
    slopes, along, noise = _principal(known, here)
    noise = noise * FAIR
    size = np.abs(along).max(axis=0)
    lost = (noise > UNSEEN) | (size * NOTHING > WIDE)
    lost[np.argsort(size)[len(size) - k :]] = True
    kept = np.where(lost, 0.0, 1.0 - np.minimum(noise, 1.0))
    along = along / size
    data = (slopes @ along * np.sqrt(kept)) @ np.linalg.inv(along)
    unseen = _independent(along[:, lost])
    norms = _norms(data)
    # noise that is left in a combination would let its members imitate what is none of them
    faint = np.abs(unseen) * norms[:, None] <= np.linalg.norm(slopes @ unseen, axis=0)
    unseen[faint & (np.abs(unseen) < MEMBER)] = 0.0
    basis = np.linalg.qr(unseen * norms[:, None])[0]
    return data - (data / norms) @ basis @ (basis.T * norms), unseen


def _jumped(known: _Probes, again: _Probes, whole: Array, here: NDArray[np.int64]) -> None:
    """Correct slopes of single parameters by what combinations move over wide changes.

    Where a response jumps, as on the edge of a dead zone, small moves meet no jump: their slopes
    agree with each other, but not with those over the width to which a combination is known.
    What the third order of an exponential of the move would make is curvature, no jump.

    Args:
        whole: all combinations, shape (p, p); others than those seen ``again`` stay as they are.
    """
    axes = slice(0, len(here))
    along = again.along[here]
    energy = np.sum(known.slopes[:, axes] ** 2, axis=0)
    missed = again.slopes - known.slopes[:, axes] @ along
    curved = (along**2 * energy[:, None]) * ((again.widths * along) ** 2 / 6.0) ** 2
    jumps = np.sum(missed**2, axis=0) > again.noise + np.sum(curved, axis=0)
    parts = np.linalg.inv(whole)  # a row for each combination
    combination = np.argmax(np.abs(parts @ along), axis=0)
    known.slopes[:, axes] += missed[:, jumps] @ parts[combination[jumps]]


def _principal(known: _Probes, here: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Slopes of single parameters, combinations with orthonormal slopes, their share of noise.

    The slopes are those that all probes together make likeliest, and have one covariance for every
    error; with it, J'J and the energy of its random part are both diagonal in the combinations.
    Shapes (m, p), (p, p), (p,).
    """
    along = known.along[here]
    noise = np.maximum(known.noise, LEAST / FAIR)
    unit = np.sqrt(np.sum(known.slopes[:, : len(here)] ** 2, axis=0))  # of the axes
    told = along * unit[:, None] / np.sqrt(noise)
    left, singular, right = np.linalg.svd(told, full_matrices=False)
    mean = (known.slopes / np.sqrt(noise)) @ (right.T / singular) @ left.T
    spread = (left / singular**2) @ left.T
    # of J'J and 1e-15 of its trace, which rounding can outweigh where J'J is formed
    ridge = math.sqrt(1e-15) * np.linalg.norm(mean) * np.eye(len(here))
    lower = np.linalg.qr(np.vstack([mean, ridge]))[1].T
    inverse = np.linalg.inv(lower)
    shares, axes = np.linalg.eigh(inverse @ spread @ inverse.T)
    return mean * unit, (inverse.T @ axes) / unit[:, None], shares


def _probed(problem: Problem, vector: Array, along: Array, widths: Array) -> _Probes:
    """Slopes along combinations, each over the least width, from ``widths`` on, that agrees."""
    k = along.shape[1]
    probes = _Probes(
        along=along,
        slopes=np.zeros((problem.samples, k)),
        noise=np.zeros(k),
        widths=np.clip(widths, NARROW, WIDE),
        jitter=np.zeros((problem.samples, k)),
        refused=np.ones(k, dtype=bool),
    )
    left, widest = list(range(k)), []
    while left:
        left = _tried(problem, vector, probes, left, PARTS)
        widest += [i for i in left if probes.widths[i] >= WIDE]
        left = [i for i in left if probes.widths[i] < WIDE]
        probes.widths[left] = np.minimum(WIDER * probes.widths[left], WIDE)
    _tried(problem, vector, probes, [i for i in widest if probes.slopes[:, i].any()], MORE_PARTS)
    return probes


def _tried(
    problem: Problem, vector: Array, probes: _Probes, which: Sequence[int], parts: Sequence[float]
) -> list[int]:
    """Take slopes along some combinations; return those that do not agree over their widths.

    What narrower widths have told stays where the model leaves the finite numbers; a slope is 0
    where bounds leave no room.
    """
    weights, size, each = np.square(parts), units(problem, vector), 2 * len(parts)
    points: list[Array] = []
    spans = []
    for i in which:
        step = probes.widths[i] * probes.along[:, i] * size
        signs = [sign * part for part in parts for sign in (1.0, -1.0)]
        ends = [sign * _room(problem, vector, np.sign(sign) * step) for sign in signs]
        middles = _middles(problem, vector, len(parts), probes.widths[i])
        points += [moved(problem, middles[k // 2], end * step) for k, end in enumerate(ends)]
        spans.append(np.subtract(ends[::2], ends[1::2]))
    problem.memory.evaluations += len(points)
    every = list(problem.workers.map(lambda point: _errors(problem, point), points))
    again = []
    for k, (i, span) in enumerate(zip(which, spans)):
        errors = [one for one in every[k * each : (k + 1) * each] if one is not None]
        if len(errors) < each:
            continue
        changes = np.subtract(errors[::2], errors[1::2]).T
        secants = changes / (probes.widths[i] * np.where(span == 0.0, 1.0, span))
        mean = secants @ weights / weights.sum()
        apart = (secants - mean[:, None]) ** 2 @ weights / (len(parts) - 1)
        noise = apart.sum() / (weights.sum() * FAIR)
        missed = float(np.sum((mean - probes.slopes[:, i]) ** 2))
        if probes.widths[i] >= NARROW or max(noise, missed) < probes.noise[i]:
            probes.slopes[:, i], probes.noise[i] = mean, noise
            # a secant over +-w has the variance jitter / (2 w^2)
            probes.jitter[:, i] = 2.0 * probes.widths[i] ** 2 * apart
            probes.refused[i] = False
        if FAIR * noise > AGREED * float(mean @ mean) or not mean.any():
            again.append(i)
    return again


def _middles(problem: Problem, vector: Array, count: int, width: float) -> list[Array]:
    """Points beside a vector, in pairs of opposite ones, so that curvature cancels on average.

    They are the same whatever was simulated before.
    """
    random = np.random.default_rng(count)
    size = min(ASIDE, ASIDE_OVER_WIDTH * width) * np.minimum(np.abs(vector), problem.large_changes)
    aside = [size * random.uniform(-1.0, 1.0, len(vector)) for _ in range(count)]
    return [moved(problem, vector, (-1.0) ** k * aside[k // 2]) for k in range(count)]


def _errors(problem: Problem, point: Array) -> Array | None:
    try:
        return problem.errors_with(problem.values(point), strict=True)[: problem.samples]
    except UserError:
        return None


def moved(problem: Problem, vector: Array, step: Array) -> Array:
    """Return a vector moved by a small step: values that cannot change their sign by a factor."""
    low, high = problem.bounds
    factor = ((low >= 0.0) | (high <= 0.0)) & (np.abs(step) < np.abs(vector))
    share = np.divide(step, vector, out=np.zeros_like(step), where=factor)
    point = np.where(factor, vector * np.exp(share), vector + step)
    return np.asarray(np.clip(point, low, high))


def _room(problem: Problem, vector: Array, step: Array) -> float:
    """How much of a step the bounds leave, at most 1."""
    low, high = problem.bounds
    ends = np.where(step > 0.0, high, low)
    way = np.abs(ends - vector)
    factor = ((low >= 0.0) | (high <= 0.0)) & (np.abs(step) < np.abs(vector))
    ratio = np.divide(ends, vector, out=np.ones_like(step), where=factor)
    # a value that moves by a factor reaches a bound of 0 nowhere
    logs = np.abs(vector) * np.abs(np.log(np.maximum(ratio, 1e-300)))
    way = np.where(factor, logs, way)
    moving = step != 0.0
    return float(np.min(way[moving] / np.abs(step[moving]), initial=1.0))


EXPONENT = 0.5  # of which exponents of a symmetry are multiples
FACTOR = 0.01  # logarithm of the factors by which a symmetry is looked for
MIXED = 3  # directions in which symmetries may be hidden, beyond those that are known
SAME = 1e-6  # change of a weighted error up to which it is rounding


def symmetries(problem: Problem, vector: Array) -> Array:
    """Return exponents with which factors on the values leave all data as they are, shape (p, k).

    The equations have them, as units do: twice the inertia, friction and current are the same
    motion.  Slopes of the smooth twin show them nearly, and the problem itself says which hold.
    """
    inner = np.array([not side for side in problem.sides(vector)]) & (vector != 0.0)
    slopes = problem.smooth.jacobian(vector, FACTOR * np.abs(vector))[: problem.samples]
    here = np.flatnonzero(inner & slopes.any(axis=0))
    ways = np.linalg.svd(slopes[:, here] * vector[here], full_matrices=False)[2]
    found, tried = np.empty((len(vector), 0)), set()
    for k in range(1, len(here) + 1):
        if k > found.shape[1] + MIXED:
            break
        for row in _independent(ways[-k:].T).T:
            exponents = np.zeros(len(vector))
            exponents[here] = EXPONENT * np.round(row / EXPONENT)
            both = np.column_stack([found, exponents])
            alone = np.count_nonzero(exponents) < 2  # nothing depends on it, or it is on a tread
            if alone or tuple(exponents) in tried or np.linalg.matrix_rank(both) < both.shape[1]:
                continue
            tried.add(tuple(exponents))
            found = both if _unchanged(problem, vector, exponents) else found
    return found


def _unchanged(problem: Problem, vector: Array, exponents: Array) -> bool:
    """Whether the data do not see factors with these exponents, as far as bounds leave room."""
    points = [vector * np.exp(by * exponents) for by in (FACTOR, -FACTOR)]
    inside = [it for it in points if np.array_equal(it, np.clip(it, *problem.bounds))]
    errors, here = [_errors(problem, it) for it in inside], problem.latest(vector)
    changes = [np.inf if it is None else np.max(np.abs(it - here[: len(it)])) for it in errors]
    return max(changes, default=np.inf) < SAME


SINGULAR = 1e-11  # singular value over the largest, with unit columns, up to which it is rounding


@dataclass(frozen=True, eq=False)
class Factors:
    """Slopes J of full rank but for rounding, taken apart.

    Attributes:
        basis: orthonormal, of what parameters can do, shape (m, r).
        half: ``half @ half.T`` is the pseudo-inverse of J'J, ``half @ basis.T`` that of J,
            shape (p, r).
        lost: directions in which nothing happens, shape (k, p).
    """

    basis: Array
    half: Array
    lost: Array

    def without(self, values: Array) -> Array:
        """Return weighted errors, shape (m,) or (m, k), without what the parameters imitate."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))


def factors(slopes: Array) -> Factors:
    """Take slopes apart, shape (m, p)."""
    norms = _norms(slopes)
    left, singular, right = np.linalg.svd(slopes / norms, full_matrices=False)
    kept = singular > SINGULAR * np.max(singular, initial=0.0)
    half = (right[kept] / norms).T / singular[kept]
    return Factors(left[:, kept], half, right[~kept] / norms)


# How sure estimates are

LEAST_SINGULAR = 1e-7  # least singular value over the largest one that counts in correlations
ROUNDING = 1e-12  # slope over the largest one up to which it is rounding of none
STANDSTILL = 0.01  # squared change of errors over what slopes promise, up to which it is a tread
SMALLEST = 1e-9  # least standard error in scales: below it is rounding of a simulation
TREAD = 4.0  # factor by which the end of a tread is sought
LONGEST = 12  # times that it is sought farther: from the smallest error to about 1 % of the scale
TREAD_SHARE = 1.0 / np.sqrt(12.0)  # standard deviation of any value on a tread, over its length
NEEDLE = 0.1  # distance in scales within which squared errors rise, for a value that no slope tells
DENT = 4.0  # rise of the squared errors over the depth of a dent from which it is a needle's
REACHES = np.geomspace(1e-5, 0.3, 10)  # distances in scales at which that is looked at


PROFILED_ERRORS = 2.0  # standard errors to each side at which a profile is compared with slopes
FLAT = 0.5  # rise of the squared errors over that by slopes, from which an interval stays
MOST_WIDER = 256.0  # factor up to which an interval is widened


@dataclass(frozen=True)
class Spread:
    """Uncertainty at the best point, in SI.

    Attributes:
        standard_errors: one for each free parameter, NaN on a bound.
        correlations: of the estimates in white noise, shape (p, p), NaN where one is on a
            bound.
        condition: of the slopes with unit columns, over parameters off their bounds and without
            a prior, beside those that have one.
        on_bound: ``"low"``, ``"high"`` or ``""`` for each.
        slopes: effect of one scale of each parameter on the weighted errors, root of the
            sum of squares, without what is roughness.
        groups: parameters, by position, that the data show only together.
        profiles: of the estimates whose squared errors were looked at on both sides.
    """

    standard_errors: Array
    correlations: Array
    condition: float
    on_bound: tuple[str, ...]
    slopes: Array
    groups: tuple[tuple[int, ...], ...] = ()
    profiles: tuple[Profile, ...] = ()


class Profile(NamedTuple):
    """The squared errors along one estimate, while the others follow along their slopes.

    Attributes:
        name: of the parameter.
        points: distances [standard errors] from the estimate that were simulated, and the rise
            there over all squared errors, each pair of them.
        following, held: the same rise by slopes at a standard error, the others following or held.
    """

    name: str
    points: tuple[tuple[float, float], ...]
    following: float
    held: float


def spread(problem: Problem, vector: Array) -> Spread:
    """Return the uncertainty of an estimate; ``vector`` in scales, shape (p,)."""
    inner = [i for i, side in enumerate(problem.sides(vector)) if not side]
    told = information(problem, vector, inner)
    by_slopes = spread_of(problem, vector, told, _by_half_a_step(problem, vector))
    errors = by_slopes.standard_errors / problem.scales
    grouped = {i for group in told.groups for i in group}
    for i in inner:
        if problem.free[i].prior is None and i not in grouped:
            along = Axis(problem, vector, i)
            if np.isfinite(errors[i]):
                errors[i] = along.tread(errors[i], by_slopes.slopes[i])
            else:
                # how rough the response is in the others
                others = np.delete(told.roughness, i)
                errors[i] = along.needle(dent=float(np.median(others)) if others.size else 0.0)
    profiles = []
    for i in inner:
        if 0.0 < errors[i] < np.inf:
            wider, profile = _profiled(problem, vector, told.slopes, i, errors[i])
            errors[i] *= wider
            profiles += [profile] if profile.points else []
    standard_errors = errors * problem.scales
    return replace(by_slopes, standard_errors=standard_errors, profiles=tuple(profiles))


def _profiled(
    problem: Problem, vector: Array, slopes: Array, which: int, error: float
) -> tuple[float, Profile]:
    """Return how much wider the interval of an estimate is than its standard error by slopes
    [scales] says, and the profile that tells it: others follow along their slopes.

    A limit that is met for moments, and a jump, are told from one side only.
    """
    others, (low, high) = factors(np.delete(slopes, which, axis=1)), problem.bounds
    end = PROFILED_ERRORS * error

    def left(errors: Array) -> float:
        return float(np.sum(others.without(errors) ** 2))

    name, latest = problem.free[which].name, problem.latest(vector)
    met: list[tuple[float, float]] = []
    base, whole = left(latest), float(latest @ latest) or 1.0
    wanted, widest = left(end * slopes[:, which]), 1.0
    if not wanted:  # where no slope tells it, another way has
        return widest, Profile(name, (), 0.0, 0.0)
    for side in (-1.0, 1.0):
        room = (high if side > 0.0 else low)[which] - vector[which]
        by, before, least = 1.0, (0.0, 0.0), FLAT * wanted
        while by < min(MOST_WIDER, abs(room) / end):
            point = vector.copy()
            point[which] += side * by * end
            risen = left(problem.errors_with(problem.values(point))) - base
            met.append((side * by, risen))
            if risen >= least:
                by = before[0] + (by - before[0]) * (least - before[1]) / (risen - before[1])
                break
            by, before, least = 2.0 * by, (by, risen), wanted
        widest = max(widest, min(by, abs(room) / end))
    points = tuple((by * PROFILED_ERRORS / widest, risen / whole) for by, risen in sorted(met))
    unit = (widest / PROFILED_ERRORS) ** 2 / whole
    held = float(np.sum((end * slopes[:, which]) ** 2))
    return widest, Profile(name, points, unit * wanted, unit * held)


def _by_half_a_step(problem: Problem, vector: Array) -> Array:
    """By what half the model's internal step changes the weighted errors, shape (m,).

    No step is longer than an interval of the log.
    """
    step, values = problem.model.values["internal_step"], problem.values(vector)
    longest = min([step, *(log.interval for log in problem.logs)])
    half, whole = (
        problem.errors_with({**values, "internal_step": it}) for it in (0.5 * longest, step)
    )
    return half - whole


def _by_assumed(problem: Problem, vector: Array) -> Array:
    """By what each constant that an effect assumes, twice as large, changes the weighted errors of
    data and priors, shape (m, constants)."""
    values, here = problem.values(vector), problem.latest(vector)
    changes = [problem.errors_with({**values, k: it}) - here for k, it in problem.assumed.items()]
    return np.array(changes).reshape(len(changes), len(here)).T


def spread_of(
    problem: Problem, vector: Array, told: Information, doubtful: Array | None = None
) -> Spread:
    """Return the uncertainty of an estimate as slopes tell it, without steps of the response.

    ``doubtful`` is a change of the weighted errors, shape (m,), that may be the model's own error.
    """
    at = problem.sides(vector)
    inner = np.array([not side for side in at], dtype=bool)
    jacobian, residuals = told.slopes, problem.latest(vector)
    p, condition = len(vector), 1.0
    errors, correlations = np.full(p, np.nan), np.full((p, p), np.nan)
    slopes = np.linalg.norm(jacobian[: problem.samples], axis=0)
    slopes[slopes <= ROUNDING * np.max(slopes, initial=0.0)] = 0.0
    moving = inner & (np.any(jacobian[problem.samples :], axis=0) | (slopes > 0.0))
    if moving.any():
        columns = jacobian[:, moving]
        apart = factors(columns)
        condition = _condition(problem, columns, moving)
        correlations[np.ix_(moving, moving)] = _correlations(columns)
        free = np.abs(apart.lost) / units(problem, vector)[moving]
        lost = np.any(free > MEMBER * free.max(axis=1, keepdims=True), axis=0)
        more = _roughness(problem, told, residuals)
        variance = np.diag(covariance(problem, columns, residuals, more))
        # a rough surface stops a search where it has a dent, short of what slopes promise
        changes = [residuals] if doubtful is None else [residuals, doubtful]
        short = [np.abs(apart.half @ (apart.basis.T @ change)) for change in changes]
        error = np.max([np.sqrt(np.maximum(variance, 0.0)), *short], axis=0)
        # a constant that an effect assumes is no known one
        moved_by = apart.half @ (apart.basis.T @ _by_assumed(problem, vector))
        error = np.hypot(error, np.linalg.norm(moved_by, axis=1))
        errors[moving] = np.where(lost, np.inf, error)
    errors[inner & ~moving] = np.inf
    moves = np.where(told.open, np.maximum(slopes, ROUNDING), slopes)
    return Spread(errors * problem.scales, correlations, condition, at, moves, told.groups)


def _condition(problem: Problem, slopes: Array, moving: Mask) -> float:
    """Condition of slopes with unit columns, of what no prior holds beside what one does."""
    held = np.array([free.prior is not None for free in problem.free])[moving]
    rest = factors(slopes[:, held]).without(slopes[:, ~held] / _norms(slopes[:, ~held]))
    singular = np.linalg.svd(rest, compute_uv=False) if rest.size else np.ones(1)
    return float(min(singular[0] / max(singular[-1], 1e-300), 1.0 / ROUNDING))


def _norms(slopes: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(slopes, axis=0), 1e-300))


def _roughness(problem: Problem, told: Information, residuals: Array) -> float:
    """Factor on the variance of errors that are less than the roughness of the response.

    Such a fit has met the very steps of the log, as it may where the model itself made it.
    """
    power = float(np.mean(residuals[: problem.samples] ** 2))
    return max(1.0, 2.0 * float(np.mean(told.jitter)) / max(power, 1e-300))


class Axis:
    """What happens along one parameter, where slopes do not tell it."""

    def __init__(self, problem: Problem, vector: Array, which: int) -> None:
        self.problem, self.vector, self.which = problem, vector, which
        self.errors = problem.latest(vector)[: problem.samples]

    def _sides(self, by: float) -> list[Array]:
        """Weighted errors on both sides, inside the bounds."""
        step = by * np.eye(len(self.vector))[self.which]
        points = [np.clip(self.vector + it, *self.problem.bounds) for it in (step, -step)]
        errors = [self.problem.errors_with(self.problem.values(point)) for point in points]
        return [one[: self.problem.samples] for one in errors]

    def tread(self, error: float, slope: float) -> float:
        """Return a standard error [scales], at least that of a value anywhere on a step's tread;
        ``error`` as slopes tell it, ``slope`` the root of the sum of squares per scale.

        A delay beside a hold is known to the tick, however many samples there are.
        """
        if error > WIDE:
            return error
        half = error = max(error, SMALLEST)
        for _ in range(LONGEST):
            change = min(float(np.sum((one - self.errors) ** 2)) for one in self._sides(half))
            if change > STANDSTILL * (slope * error) ** 2:
                break
            half *= TREAD
        return error if half == error else max(error, TREAD_SHARE * half)

    def needle(self, right: bool = False, dent: float = 0.0) -> float:
        """Return how far a value may go before the errors tell it [scales], infinity for ever.

        The response to the period of a hold is another one from step to step: only at the right
        one the errors are small.

        Args:
            right: the model is taken for right, and its errors are white with a deviation of 1;
                else they are those of a fit.
            dent: squared errors by which the response differs from itself where other parameters
                are a little other ones: a fit to a rough surface lies in a dent of that depth.
        """
        base = float(self.errors @ self.errors)
        noise = 1.0 if right else base / len(self.errors) * inflation(self.errors)
        inside = float(REACHES[0])
        for by in REACHES.tolist():
            changed = [one - self.errors if right else one for one in self._sides(by)]
            rise = min(float(one @ one) for one in changed) - (0.0 if right else base)
            inside = by if rise <= max(noise, DENT * dent) else inside
        return np.inf if inside > NEEDLE else inside


def _correlations(slopes: Array) -> Array:
    """Correlations of the estimates in white noise, which belong to the experiment alone."""
    _, singular, axes = np.linalg.svd(slopes / _norms(slopes), full_matrices=False)
    half = axes / np.maximum(singular, LEAST_SINGULAR * singular[0])[:, None]
    return np.asarray(half.T @ half / np.outer(*2 * [np.linalg.norm(half, axis=0)]))


def covariance(problem: Problem, jacobian: Array, residuals: Array, more: float = 1.0) -> Array:
    """Covariance of the estimates in scales, shape (p, p).

    The white-noise covariance would be far too small: here it is J+ R J+', with the covariance
    R of the errors from an autoregressive model of each record's residuals.

    Priors are scores of their own with the variance that they claim; that of the errors counts
    ``more`` times.
    """
    half = factors(jacobian).half
    inverse = half @ half.T
    count = problem.samples
    prior = jacobian[count:]
    middle = prior.T @ prior
    for rows in problem.records.values():
        if len(residuals[rows]):
            middle = middle + more * scatter(jacobian[rows], autocovariance(residuals[rows]))
    freedom = count / max(count - jacobian.shape[1], 1)
    return np.asarray(freedom * inverse @ middle @ inverse)


# What parameters would do about a change of the response

BLOCK_EXCHANGES = 8  # exchanges of all variables on the wrong side of a bound at once
SINGLE_EXCHANGES = 40  # exchanges of one variable at a time, after them
COORDINATE_SWEEPS = 3  # sweeps over single variables, at last
RELATIVE_RIDGE = 1e-10  # ridge on a diagonal of 1: variables that do the same share what is to do


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A fitted problem, linear about its estimates.

    Attributes:
        problem, vector: the fit.
        errors, slopes: there, priors included, shapes (m,) and (m, p).
    """

    problem: Problem
    vector: Array
    errors: Array
    slopes: Array

    @cached_property
    def factors(self) -> Factors:
        """Its slopes, taken apart."""
        return factors(self.slopes)

    @cached_property
    def gram(self) -> Array:
        """Products of the slopes with each other, shape (p, p)."""
        return np.asarray(self.slopes.T @ self.slopes)

    @cached_property
    def room(self) -> tuple[Array, Array]:
        """How far the parameters may move down and up, each of shape (p,)."""
        low, high = self.problem.bounds
        return np.minimum(low - self.vector, 0.0), np.maximum(high - self.vector, 0.0)

    @cached_property
    def left(self) -> float:
        """Squared errors that nominal parameters cannot take away."""
        towards = self.slopes.T @ self.errors
        step = self._step(towards)
        change = value_at(self.gram[None], towards[None], step[None])[0]
        return float(self.errors @ self.errors + change)

    def without(self, values: Array) -> Array:
        """Return weighted errors, shape (m,) or (m, k), without what the parameters imitate."""
        return self.factors.without(values)

    def start(self, whole: Array) -> dict[str, float]:
        """Return the estimates [SI] of the fit's parameters beside an effect's difference."""
        step = self._step(self.slopes.T @ (self.errors + whole))
        return self.problem.values(self.vector + step)

    def near_start(self, whole: Array) -> dict[str, float]:
        """Return the same where it costs an error of its own to move a parameter by its scale.

        Near-collinear slopes leave the linear range.
        """
        ridge = np.mean(self.errors**2) * np.eye(len(self.vector))
        towards = self.slopes.T @ (self.errors + whole)
        step = solve_box_qp((self.gram + ridge)[None], towards[None], *self.room)[0]
        return self.problem.values(self.vector + step)

    def _step(self, towards: Array) -> Array:
        """The step inside the bounds that leaves least, for slopes times errors."""
        half, (low, high) = self.factors.half, self.room
        step = -half @ (half.T @ towards)
        if np.all((low <= step) & (step <= high)):
            return np.asarray(step)
        return np.asarray(solve_box_qp(self.gram[None], towards[None], low, high)[0])

    def cost(self, values: Mapping[str, float]) -> float:
        """Return the squared errors, priors included, that are left with these values [SI]."""
        errors = self.problem.errors_with({**self.problem.values(self.vector), **values})
        return float(errors @ errors)


def linearised(
    problem: Problem, vector: Array, widths: Array | None = None, slopes: Array | None = None
) -> Linearisation:
    """Return a fit, linearised; unknown slopes are taken over ``widths`` [scales], shape (p,)."""
    errors = problem.latest(vector)
    if slopes is None:
        slopes = problem.jacobian(vector, widths)
    return Linearisation(problem, vector, errors, slopes)


def solve_box_qp(gram: Array, gradient: Array, low: Array, high: Array) -> Array:
    """Return z that makes z G z / 2 + g z least between bounds, shape (k, n).

    Args:
        gram: G of each problem, positive semidefinite, shape (k, n, n).
        gradient: g, shape (k, n).
        low, high: bounds, shape (n,) or (k, n), the lower one not above the other.
    """
    size = np.sqrt(np.einsum("kii->ki", gram))
    size = np.where(size > 0.0, size, 1.0)
    gram = gram / (size[:, :, None] * size[:, None, :])
    gradient, low, high = gradient / size, low * size, high * size
    low, high = np.broadcast_to(low, gradient.shape), np.broadcast_to(high, gradient.shape)
    side = np.where(high > low, 0, -1).astype(np.int8)
    z, left = np.zeros_like(gradient), np.arange(len(gradient))
    for k in range(BLOCK_EXCHANGES + SINGLE_EXCHANGES):
        box, single = (low[left], high[left], side[left]), k >= BLOCK_EXCHANGES
        z[left], side[left], wrong = _exchanged(gram[left], gradient[left], *box, single)
        left = left[wrong]
        if not len(left):
            break
    z = np.clip(z, low, high)
    if len(left):
        z[left] = _swept(gram[left], gradient[left], low[left], high[left], z[left])
    return np.asarray(z / size)


def _swept(gram: Array, gradient: Array, low: Array, high: Array, z: Array) -> Array:
    """Points moved to the least along one variable after the other, inside the bounds."""
    curvature = np.maximum(np.einsum("kii->ki", gram), RELATIVE_RIDGE)
    for i in list(range(z.shape[1])) * COORDINATE_SWEEPS:
        slope_i = gradient[:, i] + np.einsum("kj,kj->k", gram[:, i], z)
        z[:, i] = np.clip(z[:, i] - slope_i / curvature[:, i], low[:, i], high[:, i])
    return z


def _exchanged(
    gram: Array,
    gradient: Array,
    low: Array,
    high: Array,
    side: NDArray[np.int8],
    single: bool,
) -> tuple[Array, NDArray[np.int8], NDArray[np.bool_]]:
    """The least with some variables on a side, the sides they should be on, and where they differ.

    Of those that are on the wrong side, only the last changes it where a ``single`` one may.
    """
    free = side == 0
    fixed = np.where(side < 0, low, np.where(side > 0, high, 0.0))
    z = fixed + _unbounded(gram, gradient + _times(gram, fixed), free)
    slope = gradient + _times(gram, z)
    below, above = free & (z < low), free & (z > high)
    back = (high > low) & (((side < 0) & (slope < 0.0)) | ((side > 0) & (slope > 0.0)))
    wrong = below | above | back
    changed = wrong
    if single:
        last = wrong.shape[1] - 1 - np.argmax(wrong[:, ::-1], axis=1)
        changed = wrong & (np.arange(wrong.shape[1]) == last[:, None])
    right = np.where(below, -1, np.where(above, 1, np.where(back, 0, side)))
    return z, np.where(changed, right, side).astype(np.int8), wrong.any(axis=1)


def value_at(gram: Array, gradient: Array, z: Array) -> Array:
    """Return z G z + 2 g z of each problem: the change of a sum of squares, shape (k,)."""
    return np.asarray(np.einsum("ki,ki->k", _times(gram, z) + 2.0 * gradient, z))


def _unbounded(gram: Array, gradient: Array, free: NDArray[np.bool_]) -> Array:
    """The least of each problem over its free variables, the others 0."""
    both = free[:, :, None] & free[:, None, :]
    matrix = np.where(both, gram, 0.0)
    diagonal = np.arange(gram.shape[1])
    matrix[:, diagonal, diagonal] += np.where(free, RELATIVE_RIDGE, 1.0)
    return np.asarray(np.linalg.solve(matrix, np.where(free, -gradient, 0.0)[..., None])[..., 0])


def _times(gram: Array, z: Array) -> Array:
    return np.asarray((gram @ z[..., None])[..., 0])
