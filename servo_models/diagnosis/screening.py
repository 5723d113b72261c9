"""Look at every effect, and every pair, without fitting any: a score test in the large.

Each effect is simulated at a few sizes.  What is left of the gap is regressed on such a
difference and on the slopes of the nominal parameters, held by their priors, so a look gives
the start of a fit as well.  Source: Rao, Proc. Cambridge Phil. Soc. 44 (1948) (score test); the
sizes replace its derivative, since many effects have none at 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import atan2, hypot, pi

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.candidates import Candidate
from servo_models.errors import UserError
from servo_models.identification.problem import Problem, map_on

Array = NDArray[np.float64]

STRETCH = 1.6
"""A difference counts up to this much larger than simulated, since sizes are a grid."""
EACH = 3
"""Sizes of each effect that take part in pairs."""
CORRECTIONS = 2
"""Times that other parameters are corrected before a staircase is judged."""
LARGEST = 10.0
"""The same for a ripple, of which one size is looked at."""


@dataclass(frozen=True, eq=False)
class View:
    """Where one looks from: a fitted problem, linear about its estimates.

    Attributes:
        problem, vector: the fit.
        errors, slopes: there, priors included, shapes (m,) and (m, p).
    """

    problem: Problem
    vector: Array
    errors: Array
    slopes: Array

    @cached_property
    def basis(self) -> Array:
        """Orthonormal, of what parameters can do."""
        return _orthonormal(self.slopes)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self.slopes, rcond=1e-9))

    @property
    def left(self) -> Array:
        """Errors that nominal parameters cannot take away."""
        return self.without(self.errors)

    def without(self, values: Array) -> Array:
        """Return weighted errors, shape (m,) or (m, k), without what the parameters imitate."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def start(self, whole: Array) -> dict[str, float]:
        """Return the estimates [SI] of the fit's parameters beside an effect's difference."""
        if self.slopes.shape[1] == 0:
            return {}
        step = -self._inverse @ (self.errors + whole)
        return self.problem.values(np.clip(self.vector + step, *self.problem.bounds))


@dataclass(frozen=True, eq=False)
class Sight:
    """An effect at one size.

    Attributes:
        seen: from where.
        candidate: the effect.
        settings: its parameters [SI].
        whole: difference that it makes, in noise floors, shape (m + priors,).
        difference: the same without what nominal parameters can imitate.
        left: squared errors that would remain.
    """

    seen: View
    candidate: Candidate
    settings: dict[str, float]
    whole: Array
    difference: Array
    left: float

    @property
    def start(self) -> dict[str, float]:
        """Estimates [SI] of the other parameters beside the effect."""
        return self.seen.start(self.whole)


def view(problem: Problem, vector: Array, widths: Array | None = None) -> View:
    """Return the view from a fit; slopes are taken over ``widths`` [scales], shape (p,)."""
    errors = problem.latest(vector)
    return View(problem, vector, errors, problem.jacobian(vector, widths))


def look(views: Sequence[View], every: Sequence[Candidate]) -> tuple[list[Sight], dict[str, float]]:
    """Return each effect at each size from each view, best first, and the reach of each effect.

    That is how far it moves the outputs at most: RMS in noise floors of what nominal
    parameters cannot imitate.  Other parameters are corrected before a staircase is judged:
    one of the wrong step looks as good while they are still at values that made up for it.
    """
    sights: list[Sight] = []
    reach = {one.name: 0.0 for one in every}
    for seen in views:
        problem, left = seen.problem, seen.left
        base = problem.values(seen.vector)
        tasks = [(one, size) for one in every for size in one.sizes]
        simulate = partial(_differences, seen, base)
        found = map_on(problem.jobs, simulate, tasks)
        for (one, size), columns in zip(tasks, found):
            if columns is None:
                continue
            sight = _sight(seen, left, one, size, columns)
            moved = float(np.sqrt(np.sum(sight.difference**2) / max(problem.samples, 1)))
            reach[one.name] = max(reach[one.name], moved)
            if moved > 0.0:
                sights.append(sight)
    return sorted(sights, key=lambda sight: sight.left), reach


def pairs(sights: Sequence[Sight], enough: float = np.inf) -> list[tuple[Sight, Sight]]:
    """Return pairs of different effects by what both would leave together, best first.

    Each effect takes part with the sizes that leave least alone; pairs that leave more than
    ``enough`` squared errors are none.
    """
    scored: list[tuple[float, int, int]] = []
    for seen in dict.fromkeys(sight.seen for sight in sights):
        taken: dict[str, list[int]] = {}
        for i, sight in enumerate(sights):
            if sight.seen is seen:
                taken.setdefault(sight.candidate.name, []).append(i)
        own = [i for group in taken.values() for i in group[:EACH]]
        scored += _pairs(sights, own)
    best: dict[frozenset[str], tuple[Sight, Sight]] = {}
    for left, i, j in sorted(scored):
        if left > enough:
            break
        names = frozenset((sights[i].candidate.name, sights[j].candidate.name))
        best.setdefault(names, (sights[i], sights[j]))
    return list(best.values())


def _pairs(sights: Sequence[Sight], own: Sequence[int]) -> list[tuple[float, int, int]]:
    """Squared errors that pairs from one view would leave, and which they are."""
    left = sights[own[0]].seen.left
    matrix = np.column_stack([sights[i].difference for i in own])
    gram, towards = matrix.T @ matrix, -(matrix.T @ left)
    i, j = np.triu_indices(len(own), 1)
    names = np.array([sights[k].candidate.name for k in own])
    a, b, c = gram[i, i], gram[j, j], gram[i, j]
    apart = (names[i] != names[j]) & (a * b - c * c > 1e-6 * a * b)
    i, j, a, b, c = (it[apart] for it in (i, j, a, b, c))
    determinant = a * b - c * c
    first = np.clip((b * towards[i] - c * towards[j]) / determinant, 0.0, STRETCH)
    second = np.clip((a * towards[j] - c * towards[i]) / determinant, 0.0, STRETCH)
    gain = 2.0 * (first * towards[i] + second * towards[j])
    gain -= a * first**2 + b * second**2 + 2.0 * c * first * second
    remains = float(left @ left) - gain
    return [(float(left), own[k], own[m]) for left, k, m in zip(remains, i, j)]


def _sight(
    seen: View, left: Array, one: Candidate, settings: dict[str, float], columns: Array
) -> Sight:
    """The best share of a difference; of a sine and a cosine, the best amplitude and phase."""
    rest = seen.without(columns)
    if one.ripple:
        switch, phase = one.ripple
        sine, cosine = np.linalg.lstsq(rest, -left, rcond=1e-9)[0]
        size = settings[switch] * min(hypot(sine, cosine), LARGEST)
        settings = {**settings, switch: size, phase: atan2(cosine, sine)}
        columns, rest = (part @ [sine, cosine] for part in (columns, rest))
        return Sight(seen, one, settings, columns, rest, _left(left, rest, 1.0))
    whole, rest = columns[:, 0], rest[:, 0]
    share = 1.0 if one.fine else _share(left, rest)
    return Sight(seen, one, settings, share * whole, rest, _left(left, rest, share))


def _differences(
    seen: View, base: dict[str, float], task: tuple[Candidate, dict[str, float]]
) -> Array | None:
    """Changes of the weighted errors by an effect at a size, shape (m + priors, 1 or 2)."""
    one, size = task
    phases = (0.0, pi / 2.0) if one.ripple else ()
    probes = [{**size, one.ripple[1]: at} for at in phases] if one.ripple else [size]
    found = [_difference(seen, {**base, **probe}) for probe in probes]
    for _ in range(CORRECTIONS if one.fine else 0):
        found = [_corrected(seen, size, it) for it in found]
    known = [it for it in found if it is not None]
    return np.column_stack(known) if len(known) == len(found) else None


def _corrected(seen: View, size: dict[str, float], whole: Array | None) -> Array | None:
    """A change by an effect once more, from where it would take the other parameters."""
    if whole is None:
        return None
    start = seen.start(whole)
    again = _difference(seen, {**start, **size})
    if again is None:
        return None
    vector = np.array(list(start.values())) / seen.problem.scales
    again -= seen.slopes @ (vector - seen.vector)
    again[seen.problem.samples :] = 0.0
    return again


def _difference(seen: View, values: dict[str, float]) -> Array | None:
    """Change of the weighted errors; the priors do not change."""
    problem = seen.problem
    try:
        parts = [
            problem.errors(run, values)[run.fitted].T.ravel()
            for run in problem.runs
            if run.fitted.any()
        ]
    except UserError:
        return None
    changed = np.concatenate(parts)
    if not np.isfinite(changed).all():
        return None
    priors = np.zeros(len(seen.errors) - len(changed))
    return np.concatenate([changed - seen.errors[: len(changed)], priors])


def _orthonormal(slopes: Array) -> Array:
    if slopes.shape[1] == 0:
        return slopes
    left, singular, _ = np.linalg.svd(slopes, full_matrices=False)
    return left[:, singular > 1e-9 * singular[0]]


def _share(left: Array, rest: Array) -> float:
    """Share of a difference that explains most."""
    size = float(rest @ rest)
    return float(np.clip(-(rest @ left) / size, 0.0, STRETCH)) if size > 0.0 else 0.0


def _left(left: Array, rest: Array, share: float) -> float:
    """Squared errors that a share of a difference leaves."""
    remains = left + share * rest
    return float(remains @ remains)
