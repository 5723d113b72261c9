"""Look at every effect, and every pair, without fitting any: a score test in the large.

Each effect is simulated at a few sizes.  What is left of the gap is regressed on such a
difference and on the slopes of the nominal parameters, held by their priors.
Source: Rao, Proc. Cambridge Phil. Soc. 44 (1948) (score test); the sizes replace its
derivative, since many effects have none at 0.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.candidates import Candidate
from servo_models.errors import UserError
from servo_models.identification.problem import Problem, workers

Array = NDArray[np.float64]

STRETCH = 1.6
"""A difference counts up to this much larger than simulated, since sizes are a grid."""


@dataclass(frozen=True, eq=False)
class Sight:
    """An effect at one size.

    Attributes:
        candidate: the effect.
        settings: its switches [SI].
        difference: that it makes, in noise floors, without what nominal parameters can
            imitate, shape (m + priors,).
        gain: of squared errors that it would explain.
    """

    candidate: Candidate
    settings: dict[str, float]
    difference: Array
    gain: float


def look(
    problem: Problem, vector: Array, every: Sequence[Candidate]
) -> tuple[list[Sight], dict[str, float]]:
    """Return each effect at each size, best first, and how far each moves the outputs at most.

    The movement is the RMS in noise floors of what nominal parameters cannot imitate.
    """
    errors, slopes = problem.residuals(vector), problem.jacobian(vector)
    basis = _orthonormal(slopes)
    left = _without(basis, errors)
    base = problem.values(vector)
    tasks = [(one, size) for one in every for size in one.sizes]
    threads = workers(problem.jobs)
    found = threads.map(lambda task: _difference(problem, base, errors, task[1]), tasks)
    sights, reach = [], {one.name: 0.0 for one in every}
    for (one, size), difference in zip(tasks, found):
        if difference is None:
            continue
        rest = _without(basis, difference)
        moved = float(np.sqrt(np.sum(rest**2) / max(problem.samples, 1)))
        reach[one.name] = max(reach[one.name], moved)
        if moved > 0.0:
            sights.append(Sight(one, size, rest, _gain(left, rest)))
    return sorted(sights, key=lambda sight: -sight.gain), reach


def pairs(problem: Problem, vector: Array, sights: Sequence[Sight]) -> list[tuple[Sight, Sight]]:
    """Return pairs of different effects by what both would explain together, best first."""
    errors, slopes = problem.residuals(vector), problem.jacobian(vector)
    left = _without(_orthonormal(slopes), errors)
    matrix = np.column_stack([sight.difference for sight in sights])
    products, towards = matrix.T @ matrix, -(matrix.T @ left)
    scored = []
    for i, j in itertools.combinations(range(len(sights)), 2):
        if sights[i].candidate.name == sights[j].candidate.name:
            continue
        gram = products[np.ix_([i, j], [i, j])]
        if np.linalg.det(gram) < 1e-6 * gram[0, 0] * gram[1, 1]:
            continue
        shares = np.clip(np.linalg.solve(gram, towards[[i, j]]), 0.0, STRETCH)
        gain = float(2.0 * shares @ towards[[i, j]] - shares @ gram @ shares)
        scored.append((gain, i, j))
    best: dict[frozenset[str], tuple[Sight, Sight]] = {}
    for _, i, j in sorted(scored, reverse=True):
        names = frozenset((sights[i].candidate.name, sights[j].candidate.name))
        best.setdefault(names, (sights[i], sights[j]))
    return list(best.values())


def _difference(
    problem: Problem, base: dict[str, float], errors: Array, settings: dict[str, float]
) -> Array | None:
    """Change of the weighted errors that an effect makes; the priors do not change."""
    try:
        parts = [
            problem.errors(run, {**base, **settings})[run.log.fitted].T.ravel()
            for run in problem.runs
            if run.log.fitted.any()
        ]
    except UserError:
        return None
    changed = np.concatenate(parts)
    if not np.isfinite(changed).all():
        return None
    priors = np.zeros(len(errors) - len(changed))
    return np.concatenate([changed - errors[: len(changed)], priors])


def _orthonormal(slopes: Array) -> Array:
    if slopes.shape[1] == 0:
        return slopes
    left, singular, _ = np.linalg.svd(slopes, full_matrices=False)
    return left[:, singular > 1e-9 * singular[0]]


def _without(basis: Array, values: Array) -> Array:
    return np.asarray(values - basis @ (basis.T @ values))


def _gain(left: Array, rest: Array) -> float:
    """Squared errors explained by the best share of a difference."""
    size = float(rest @ rest)
    share = float(np.clip(-(rest @ left) / size, 0.0, STRETCH))
    return -2.0 * share * float(rest @ left) - share**2 * size
