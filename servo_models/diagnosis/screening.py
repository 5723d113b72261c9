"""Look at every effect, and every pair, without fitting any: a score test in the large.

Each effect is simulated at a few sizes.  What is left of the gap is regressed on such a
difference and on the slopes of the nominal parameters, held by their priors, so a look gives
the start of a fit as well.  Source: Rao, Proc. Cambridge Phil. Soc. 44 (1948) (score test); the
sizes replace its derivative, since many effects have none at 0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain
from math import atan2, hypot, pi

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.sizes import Settings
from servo_models.identification.problem import Problem, map_on

Array = NDArray[np.float64]

STRETCH = 1.6
"""A difference counts up to this much larger than simulated, since sizes are a grid."""
EACH = 3
"""Sizes of each effect that take part in pairs."""
CORRECTIONS, BESIDE, GROUP = 2, 1.05, 32
"""Times that other parameters are corrected before a staircase is judged, and sizes, relative to
each other, so near that once is enough; so many of them are looked at one after another."""
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

    def cost(self, values: Mapping[str, float]) -> float:
        """Return the squared errors, priors included, that are left with these values [SI]."""
        errors = self.problem.errors_with({**self.problem.values(self.vector), **values})
        return float(errors @ errors)


@dataclass(frozen=True, eq=False)
class Sight:
    """An effect at one size.

    Attributes:
        seen: from where.
        candidate: the effect.
        settings: its parameters [SI].
        share: of the difference, by which it explains most; 1 where it cannot be shared.
        whole: that share of the difference it makes, in noise floors, shape (m + priors,).
        difference: all of it, without what nominal parameters can imitate.
        left: squared errors that would remain.
    """

    seen: View
    candidate: Candidate
    settings: dict[str, float]
    share: float
    whole: Array
    difference: Array
    left: float

    def at(self, scale: float) -> dict[str, float]:
        """Return the settings with the size so many times as large, inside its bounds."""
        switches = {
            free.name: free
            for free in self.candidate.free
            if self.seen.problem.model.plant.parameters[free.name].param.switch
        }
        return {
            name: min(max(scale * value, switches[name].low), switches[name].high)
            if name in switches
            else value
            for name, value in self.settings.items()
        }


def view(
    problem: Problem, vector: Array, widths: Array | None = None, slopes: Array | None = None
) -> View:
    """Return the view from a fit; unknown slopes are taken over ``widths`` [scales], shape (p,)."""
    errors = problem.latest(vector)
    if slopes is None:
        slopes = problem.jacobian(vector, widths)
    return View(problem, vector, errors, slopes)


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
        tasks = [(one, sizes) for one in every for sizes in _neighbours(one)]
        simulate = partial(_differences, seen, base)
        found = map_on(problem.jobs, simulate, tasks)
        every_size = [(one, size) for one, sizes in tasks for size in sizes]
        for (one, size), columns in zip(every_size, chain.from_iterable(found)):
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
        return Sight(seen, one, settings, 1.0, columns, rest, _left(left, rest, 1.0))
    whole, rest = columns[:, 0], rest[:, 0]
    share = 1.0 if one.fine else _share(left, rest)
    return Sight(seen, one, settings, share, share * whole, rest, _left(left, rest, share))


def _neighbours(one: Candidate) -> list[list[Settings]]:
    """Sizes of an effect that are simulated one after another: those of a staircase that are
    near each other, since one tells where the other parameters are at the next."""
    if not one.fine:
        return [[size] for size in one.sizes]
    found: list[list[Settings]] = []
    for size in sorted(one.sizes, key=lambda it: max(it.values())):
        last = found[-1][-1] if found and len(found[-1]) < GROUP else None
        if last and max(size.values()) < BESIDE * max(last.values()):
            found[-1].append(size)
        else:
            found.append([size])
    return found


def _differences(
    seen: View, base: Settings, task: tuple[Candidate, Sequence[Settings]]
) -> list[Array]:
    """Changes of the weighted errors by an effect at sizes, each of shape (m + priors, 1 or 2)."""
    one, sizes = task
    if not one.fine:
        return [_simulated(seen, base, one, size) for size in sizes]
    whole = _difference(seen, {**base, **sizes[0]})
    for _ in range(CORRECTIONS - 1):
        whole = _corrected(seen, sizes[0], whole)
    found = []
    for size in sizes:
        whole = _corrected(seen, size, whole)
        found.append(whole[:, None])
    return found


def _simulated(seen: View, base: Settings, one: Candidate, size: Settings) -> Array:
    """The change by an effect; of a ripple, those by its sine and by its cosine."""
    phases = (0.0, pi / 2.0) if one.ripple else ()
    probes = [{**size, one.ripple[1]: at} for at in phases] if one.ripple else [size]
    return np.column_stack([_difference(seen, {**base, **probe}) for probe in probes])


def _corrected(seen: View, size: Settings, whole: Array) -> Array:
    """A change by an effect once more, from where it would take the other parameters."""
    start = seen.start(whole)
    again = _difference(seen, {**start, **size})
    vector = np.array(list(start.values())) / seen.problem.scales
    again -= seen.slopes @ (vector - seen.vector)
    again[seen.problem.samples :] = 0.0
    return again


def _difference(seen: View, values: dict[str, float]) -> Array:
    """Change of the weighted errors; the priors do not change."""
    problem = seen.problem
    changed = problem.errors_with(values) - seen.errors
    changed[problem.samples :] = 0.0
    return changed


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
