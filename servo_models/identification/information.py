"""What logs tell of parameters: slopes that hold over the width to which each is to be known.

A quantiser, a hold, a rounded clock or dry friction in a loop makes a response rough: a slope over
a width w is the true one and a random part of about roughness / w.  That part breaks exact
degeneracies, since no two columns of it are alike, and adds information that is not there: J'J
has the random part's energy on its diagonal.  So every slope is taken over several widths, whose
random parts are independent: what they agree on is the slope, what they do not agree on is
subtracted from J'J, and a combination of parameters of which nothing is left is unseen.

Combinations are probed along themselves, not put together from single parameters: the weaker one
is, the wider it is moved.  Positive parameters move by factors, so that groups which enter as a
product or a ratio stay exactly where they do nothing.
Sources: Fuller, Measurement Error Models, 1987, sec. 1.2 and 2.2 (noise in regressors); More, Wild,
ACM TOMS 38 (2012) (derivatives of noisy simulations).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.problem import Problem

NARROW, WIDE = 0.01, 0.3
"""Least and largest half width of a slope, relative to the value of what moves most."""
NEAR_ZERO = 0.1
"""Value in scales below which a change is told in scales."""
PARTS = (1.0, 0.7)
"""Widths over which a slope is taken, over the largest of them."""
MORE_PARTS = (1.0, 0.7, 0.85, 0.6, 0.92, 0.78)
"""The same where two still disagree over the largest width: noise falls with their number."""
ASIDE = 0.02
"""Largest part of a value by which the middle of a slope is moved aside, to one side for one width
and to the other for the next: small moves across a step would meet the same samples of it."""
ASIDE_OVER_WIDTH = 2.0
AGREED = 0.01
"""Share of the energy of a slope in which two widths may disagree without being widened."""
NARROWER = (3e-4, 1e-5)
"""Half widths that are tried where combinations are weak: where disagreement was curvature, it
falls with the width, and where it was roughness it grows."""
WIDER = 3.0
"""Factor on a width over which slopes do not agree."""
ROUNDS = 6
"""Times that weak combinations are probed: each time along what the last one found."""
FAIR = 0.25
"""Energy of the random part of a slope over the disagreement that counts as it until the end,
which curvature may pass for."""
WEAK = 0.05
"""Share of noise in a combination from which it is probed along itself."""
KNOWN = 1.0 - 1e-8
"""Cosine of a combination to one that has been probed, from which probing it tells nothing new."""
UNSEEN = 0.3
"""Share of noise in a combination over the largest width, from which logs show nothing of it."""
NOTHING = 1e-3
"""Weighted errors, root of the sum of squares, that a move by the largest width makes at most
where it does nothing: the standard error would be some hundred times the scale."""
LEAST = (NOTHING / WIDE) ** 2
"""Energy of a slope below which nothing moves."""
MEMBER = 0.1
"""Part of the largest move in a combination from which a parameter is one of its members."""


@dataclass(frozen=True, eq=False)
class Information:
    """What logs tell of the free parameters of a problem, at a vector.

    Attributes:
        slopes: on which widths agree, of all weighted errors and then of the priors, per scale,
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
        p = len(self.unseen)
        if not self.unseen.size:
            return ()
        members = (np.abs(self.unseen) >= MEMBER).astype(float)
        together = members @ members.T > 0.0
        groups, left = [], {i for i in range(p) if together[i, i]}
        while left:
            group, new = set(), {min(left)}
            while new:
                group |= new
                new = {j for i in new for j in left if together[i, j]} - group
            left -= group
            if len(group) > 1:
                groups.append(tuple(sorted(group)))
        return tuple(groups)

    @property
    def open(self) -> NDArray[np.bool_]:
        """Which parameters take part in a combination of which the data show nothing."""
        return np.asarray(np.any(np.abs(self.unseen) >= MEMBER, axis=1))


def units(problem: Problem, vector: Array) -> Array:
    """Return what a relative change of 1 is [scales]: the value itself, unless it is near 0 or the
    problem says less."""
    own = np.where(np.abs(vector) >= NEAR_ZERO, np.abs(vector), 1.0)
    return np.minimum(own, problem.large_changes)


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
        slopes: on average over widths, shape (m, k).
        noise: energy of their random part, shape (k,).
        widths: largest half width of each, shape (k,).
        jitter: variance of each error by roughness, shape (m, k).
        refused: which could not be moved, shape (k,).
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
    data, unseen, jitter = np.zeros((problem.samples, p)), np.empty((p, 0)), np.zeros(0)
    roughness = np.zeros(p)
    if moving.any():
        here, axes = chosen[moving], axes.only(moving)
        own, combinations = _agreed(problem, vector, here, axes)
        data[:, here] = own / units(problem, vector)[here]
        unseen = np.zeros((p, combinations.shape[1]))
        unseen[here] = combinations
        roughness[here] = axes.jitter.sum(axis=0)
        order = np.argsort(roughness[here])
        jitter = axes.jitter[:, order[len(order) // 2]]
    priors = [i for i, free in enumerate(problem.free) if free.prior is not None]
    rows = np.zeros((len(priors), p))
    for row, i in zip(rows, priors):
        row[i] = problem.free[i].scale / (problem.free[i].prior or 1.0)
    jitter = jitter if jitter.size else np.zeros(problem.samples)
    return Information(np.vstack([data, rows]), unseen, jitter, roughness, refused)


def _agreed(
    problem: Problem, vector: Array, here: NDArray[np.int64], axes: _Probes
) -> tuple[Array, Array]:
    """Slopes of single parameters without their random part, and combinations that are unseen."""
    errors = problem.latest(vector)[: problem.samples]
    scale = float(np.sqrt(np.mean(errors**2))) or 1.0
    known, smooth = axes, np.flatnonzero(axes.widths <= NARROW)
    for width in NARROWER:
        if not len(smooth) or np.all(_principal(known, here)[2] <= WEAK):
            break
        before, known.widths[smooth] = known.noise.copy(), width
        _tried(problem, vector, known, smooth, PARTS)
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
        known = known.beside(again.only(~again.refused))
    slopes, along, noise = _principal(known, here)
    noise = noise * FAIR
    size = np.abs(along).max(axis=0)
    lost = (noise > UNSEEN) | (size * NOTHING > WIDE)
    kept = np.where(lost, 0.0, 1.0 - np.minimum(noise, 1.0))
    along = along / size
    data = (slopes @ along * np.sqrt(kept)) @ np.linalg.inv(along)
    unseen = _independent(along[:, lost])
    norms = np.maximum(np.linalg.norm(data, axis=0), 1e-300)
    # noise that is left in a combination would let its members imitate what is none of them
    faint = np.abs(unseen) * norms[:, None] <= np.linalg.norm(slopes @ unseen, axis=0)
    unseen[faint & (np.abs(unseen) < MEMBER)] = 0.0
    basis = np.linalg.qr(unseen * norms[:, None])[0]
    return data - (data / norms) @ basis @ (basis.T * norms), unseen


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
    found = _Probes(
        along=along,
        slopes=np.zeros((problem.samples, k)),
        noise=np.zeros(k),
        widths=np.clip(widths, NARROW, WIDE),
        jitter=np.zeros((problem.samples, k)),
        refused=np.ones(k, dtype=bool),
    )
    left, widest = list(range(k)), []
    while left:
        left = _tried(problem, vector, found, left, PARTS)
        widest += [i for i in left if found.widths[i] >= WIDE]
        left = [i for i in left if found.widths[i] < WIDE]
        found.widths[left] = np.minimum(WIDER * found.widths[left], WIDE)
    _tried(problem, vector, found, [i for i in widest if found.slopes[:, i].any()], MORE_PARTS)
    return found


def _tried(
    problem: Problem, vector: Array, found: _Probes, which: Sequence[int], parts: Sequence[float]
) -> list[int]:
    """Take slopes along some combinations; return those that do not agree over their widths."""
    weights, again = np.square(parts), []
    size = units(problem, vector)
    steps = [found.widths[i] * found.along[:, i] * size for i in which]
    aside = [min(ASIDE, ASIDE_OVER_WIDTH * found.widths[i]) for i in which]
    for i, changes in zip(which, _secants(problem, vector, steps, aside, parts)):
        if changes is None:  # what narrower widths have told stays
            continue
        secants = changes / found.widths[i]
        mean = secants @ weights / weights.sum()
        apart = (secants - mean[:, None]) ** 2 @ weights / (len(parts) - 1)
        noise = apart.sum() / (weights.sum() * FAIR)
        moved_on = float(np.sum((mean - found.slopes[:, i]) ** 2))
        if found.widths[i] >= NARROW or (noise < found.noise[i] and moved_on < found.noise[i]):
            found.slopes[:, i], found.noise[i] = mean, noise
            # a secant over +-w has the variance jitter / (2 w^2)
            found.jitter[:, i] = 2.0 * found.widths[i] ** 2 * apart
            found.refused[i] = False
        if FAIR * found.noise[i] > AGREED * float(mean @ mean) or not mean.any():
            again.append(i)
    return again


def _secants(
    problem: Problem,
    vector: Array,
    steps: Sequence[Array],
    aside: Sequence[float],
    parts: Sequence[float],
) -> list[Array | None]:
    """Changes of the weighted errors per step, over parts of it to both sides, shape (m, parts).

    None where the model leaves the finite numbers; 0 where bounds leave no room.
    """
    ends = [
        sign * part * _room(problem, vector, sign * step)
        for step in steps
        for part in parts
        for sign in (1.0, -1.0)
    ]
    each = 2 * len(parts)
    points = []
    for k, step in enumerate(steps):
        own = ends[k * each : (k + 1) * each]
        middles = _middles(problem, vector, len(parts), aside[k])
        points += [moved(problem, middles[i // 2], end * step) for i, end in enumerate(own)]
        problem.memory.evaluations += each
    every = list(problem.workers.map(lambda point: _errors(problem, point), points))
    found: list[Array | None] = []
    for first in range(0, len(points), each):
        errors = [one for one in every[first : first + each] if one is not None]
        if len(errors) < each:
            found.append(None)
            continue
        far = ends[first : first + each]
        pairs = range(0, each, 2)
        slopes = [(errors[i] - errors[i + 1]) / (far[i] - far[i + 1] or 1.0) for i in pairs]
        found.append(np.column_stack(slopes))
    return found


def _middles(problem: Problem, vector: Array, count: int, part: float) -> list[Array]:
    """Points beside a vector, in pairs of opposite ones, so that curvature cancels on average.

    They are the same whatever was simulated before.
    """
    random = np.random.default_rng(count)
    size = np.minimum(np.abs(vector), problem.large_changes)
    aside = [part * size * random.uniform(-1.0, 1.0, len(vector)) for _ in range(count)]
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
