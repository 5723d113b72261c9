"""Look at every effect, and every pair, without fitting any: a score test in the large.

Each effect is simulated at a few sizes.  What is left of the gap is regressed on such a
difference and on the slopes of the nominal parameters, held by their priors and inside their
bounds, so a look gives the start of a fit as well.  Source: Rao, Proc. Cambridge Phil. Soc. 44
(1948) (score test); the sizes replace its derivative, since many effects have none at 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from math import atan2, hypot, pi

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.box import least_in_box, value_at
from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.sizes import Settings
from servo_models.diagnosis.stepwise import delays_of
from servo_models.diagnosis.view import View
from servo_models.identification.problem import map_on

Array = NDArray[np.float64]

STRETCH = 1.6
"""A difference counts up to this much larger than simulated, since sizes are a grid."""
EACH = 3
"""Sizes of each effect that take part in pairs."""
CORRECTIONS, BESIDE, GROUP = 2, 1.05, 32
"""Times that other parameters are corrected before a staircase is judged, and sizes, relative to
each other, so near that once is enough; so many of them are looked at one after another."""
SOONER = (0.25, 0.5, 0.75)
"""Parts of a hold's period by which a delay is less beside it, of which the best is taken."""
LARGEST = 10.0
"""The same for a ripple, of which one size is looked at."""


@dataclass(frozen=True, eq=False)
class Sight:
    """An effect at one size.

    Attributes:
        seen: from where.
        candidate: the effect.
        settings: its parameters [SI].
        share: of the change, by which it explains most; 1 where it cannot be shared.
        change: that it makes, in noise floors, shape (m + priors,).
        difference: the same without what nominal parameters can imitate.
        left: squared errors that would remain.
    """

    seen: View
    candidate: Candidate
    settings: dict[str, float]
    share: float
    change: Array
    difference: Array
    left: float

    @property
    def whole(self) -> Array:
        """The share of the change that explains most, shape (m + priors,)."""
        return self.share * self.change

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


def look(
    views: Sequence[View], every: Sequence[Candidate], corrected: bool = True
) -> tuple[list[Sight], dict[str, float]]:
    """Return each effect at each size from each view, best first, and the reach of each effect.

    That is how far it moves the outputs at most: RMS in noise floors of what nominal
    parameters cannot imitate.  Other parameters are ``corrected`` before a staircase is judged:
    one of the wrong step looks as good while they are still at values that made up for it.
    """
    sights: list[Sight] = []
    reach = {one.name: 0.0 for one in every}
    for seen in views:
        problem = seen.problem
        base = problem.values(seen.vector)
        tasks = [(one, sizes) for one in every for sizes in _neighbours(one)]
        simulate = partial(_differences if corrected else _plain, seen, base)
        found = map_on(problem.jobs, simulate, tasks)
        every_size = [(one, size) for one, sizes in tasks for size in sizes]
        for sight in _sights(seen, every_size, list(chain.from_iterable(found))):
            moved = float(np.sqrt(np.sum(sight.difference**2) / max(problem.samples, 1)))
            reach[sight.candidate.name] = max(reach[sight.candidate.name], moved)
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
    seen = sights[own[0]].seen
    names = np.array([sights[k].candidate.name for k in own])
    i, j = np.triu_indices(len(own), 1)
    apart = np.column_stack([sights[k].difference for k in own])
    gram = apart.T @ apart
    a, b, c = gram[i, i], gram[j, j], gram[i, j]
    differ = (names[i] != names[j]) & (a * b - c * c > 1e-6 * a * b)
    i, j = i[differ], j[differ]
    columns = np.column_stack([seen.slopes, *(sights[k].change for k in own)])
    gram, towards, p = columns.T @ columns, columns.T @ seen.errors, seen.slopes.shape[1]
    chosen = np.column_stack([np.tile(np.arange(p), (len(i), 1)), p + i, p + j])
    low, high = (np.append(it, [end, end]) for it, end in zip(seen.room, (0.0, STRETCH)))
    both = gram[chosen[:, :, None], chosen[:, None, :]]
    remains, _ = _remains(seen, both, towards[chosen], low, high)
    return [(float(left), own[k], own[m]) for left, k, m in zip(remains, i, j)]


def _sights(
    seen: View, every: Sequence[tuple[Candidate, Settings]], changes: Sequence[Array]
) -> list[Sight]:
    """The best share of each change; of a sine and a cosine, the best amplitude and phase."""
    p, (down, up) = seen.slopes.shape[1], seen.room
    gram, towards = np.zeros((len(every), p + 2, p + 2)), np.zeros((len(every), p + 2))
    low, high = np.zeros_like(towards), np.zeros_like(towards)
    gram[:, :p, :p], towards[:, :p] = seen.gram, seen.slopes.T @ seen.errors
    low[:, :p], high[:, :p] = down, up
    for k, ((one, _), columns) in enumerate(zip(every, changes)):
        own = slice(p, p + columns.shape[1])
        gram[k, :p, own] = seen.slopes.T @ columns
        gram[k, own, :p] = gram[k, :p, own].T
        gram[k, own, own] = columns.T @ columns
        towards[k, own] = columns.T @ seen.errors
        low[k, own], high[k, own] = _shares(one)
    left, steps = _remains(seen, gram, towards, low, high)
    return [
        _sight(seen, one, settings, columns, share, float(remains))
        for (one, settings), columns, remains, share in zip(every, changes, left, steps[:, p:])
    ]


def _shares(one: Candidate) -> tuple[float, float]:
    """Between which shares of a change the best is sought."""
    if one.ripple:
        return -LARGEST, LARGEST
    return (1.0, 1.0) if one.fine else (0.0, STRETCH)


def _sight(
    seen: View, one: Candidate, settings: Settings, columns: Array, share: Array, left: float
) -> Sight:
    if not one.ripple:
        change = columns[:, 0]
        return Sight(seen, one, settings, float(share[0]), change, seen.without(change), left)
    switch, phase = one.ripple
    change = columns @ share
    size = settings[switch] * min(hypot(*share), LARGEST)
    shown = {**settings, switch: size, phase: atan2(share[1], share[0])}
    return Sight(seen, one, shown, 1.0, change, seen.without(change), left)


def _remains(
    seen: View, gram: Array, towards: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Squared errors that are left at the best steps inside a box, and these steps."""
    best = least_in_box(gram, towards, low, high)
    return float(seen.errors @ seen.errors) + value_at(gram, towards, best), best


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


def _plain(seen: View, base: Settings, task: tuple[Candidate, Sequence[Settings]]) -> list[Array]:
    """Changes of the weighted errors by an effect at sizes, each of shape (m + priors, 1 or 2)."""
    one, sizes = task
    delay = _delay(seen) if one.late else ""
    if delay:
        return [_timed(seen, base, delay, size)[:, None] for size in sizes]
    return [_simulated(seen, base, one, size) for size in sizes]


def _differences(
    seen: View, base: Settings, task: tuple[Candidate, Sequence[Settings]]
) -> list[Array]:
    """The same, other parameters corrected beside a staircase."""
    one, sizes = task
    if not one.fine or (one.late and _delay(seen)):
        return _plain(seen, base, task)
    whole = _difference(seen, {**base, **sizes[0]})
    for _ in range(CORRECTIONS - 1):
        whole = _corrected(seen, sizes[0], whole)
    found = []
    for size in sizes:
        whole = _corrected(seen, size, whole)
        if _left(seen, whole) > seen.left:  # slopes may have led astray
            whole = min(whole, _difference(seen, {**base, **size}), key=partial(_left, seen))
        found.append(whole[:, None])
    return found


def _simulated(seen: View, base: Settings, one: Candidate, size: Settings) -> Array:
    """The change by an effect; of a ripple, those by its sine and by its cosine."""
    phases = (0.0, pi / 2.0) if one.ripple else ()
    probes = [{**size, one.ripple[1]: at} for at in phases] if one.ripple else [size]
    return np.column_stack([_difference(seen, {**base, **probe}) for probe in probes])


def _corrected(seen: View, size: Settings, whole: Array) -> Array:
    """A change by an effect once more, from where it would take the other parameters."""
    return _change(seen, seen.start(whole), size)


def _timed(seen: View, base: Settings, delay: str, size: Settings) -> Array:
    """A change by a hold, with the delay less by the part of its period that leaves least.

    A hold is late by half its period on average, and by how much at an edge of the command no
    slope tells: the clock may tick just after it.
    """
    (period,) = size.values()
    least = next(free.low for free in seen.problem.free if free.name == delay)
    sooner = [max(base[delay] - part * period, least) for part in SOONER]
    found = [_change(seen, {**base, delay: time}, size) for time in dict.fromkeys(sooner)]
    return min(found, key=partial(_left, seen))


def _left(seen: View, change: Array) -> float:
    """Squared errors beside a change, without what parameters imitate."""
    return float(np.sum(seen.without(seen.errors + change) ** 2))


def _delay(seen: View) -> str:
    """The free delay of a problem, empty where there is none."""
    delays = delays_of(seen.problem)
    return seen.problem.free[delays[0]].name if delays else ""


def _change(seen: View, values: Settings, size: Settings) -> Array:
    """A change by an effect with other parameters at ``values``, less what their slopes do."""
    change = _difference(seen, {**values, **size})
    vector = np.array(list(values.values())) / seen.problem.scales
    change -= seen.slopes @ (vector - seen.vector)
    change[seen.problem.samples :] = 0.0
    return change


def _difference(seen: View, values: dict[str, float]) -> Array:
    """Change of the weighted errors; the priors do not change."""
    problem = seen.problem
    changed = problem.errors_with(values) - seen.errors
    changed[problem.samples :] = 0.0
    return changed
