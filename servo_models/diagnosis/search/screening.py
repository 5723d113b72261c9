"""Look at every effect, and every pair, without fitting any: a score test in the large.

Each effect is simulated at a few sizes.  What is left of the gap is regressed on such a
difference and on the slopes of the nominal parameters, held by their priors and inside their
bounds, so a look gives the start of a fit as well.  Source: Rao, Proc. Cambridge Phil. Soc. 44
(1948) (score test); the sizes replace its derivative, since many effects have none at 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import atan2, hypot

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.candidates import Candidate
from servo_models.diagnosis.fitting.box import least_in_box, value_at
from servo_models.diagnosis.fitting.linearisation import Linearisation
from servo_models.diagnosis.search.changes import changes, corrected_changes, neighbours
from servo_models.diagnosis.trial_values import Settings

STRETCH, LEAST = 1.6, 0.5
"""A difference counts up to this much larger than simulated, since sizes are a grid, and that of a
limit on a rate at least this part: a small part of what a tight one does is what none does."""
LARGEST = 10.0
"""The same for a ripple, of which one size is looked at."""


@dataclass(frozen=True, eq=False)
class Screened:
    """An effect at one size.

    Attributes:
        seen: from where.
        candidate: the effect.
        settings: its parameters [SI].
        share: of the change, by which it explains most; 1 where it cannot be shared.
        change: that it makes, in noise floors, shape (m + priors,).
        difference: the same without what nominal parameters can imitate.
        left: squared errors that would remain.
        waves: of a ripple, its changes by a sine and by a cosine, shape (m + priors, 2).
    """

    seen: Linearisation
    candidate: Candidate
    settings: dict[str, float]
    share: float
    change: Array
    difference: Array
    left: float
    waves: Array | None = None

    @property
    def columns(self) -> Array:
        """Changes that take part with a share of their own each, shape (m + priors, 1 or 2)."""
        return self.change[:, None] if self.waves is None else self.waves

    @property
    def whole(self) -> Array:
        """The share of the change that explains most, shape (m + priors,)."""
        return self.share * self.change

    def at(self, scale: float) -> dict[str, float]:
        """Return the settings with so many times the effect, its size inside its bounds."""
        scale = 1.0 / scale if self.candidate.hints.inverse else scale
        one = self.candidate
        switches = {free.name: free for free in one.free if free.name in one.switches}
        return {
            name: min(max(scale * value, switches[name].low), switches[name].high)
            if name in switches
            else value
            for name, value in self.settings.items()
        }


def screen(
    views: Sequence[Linearisation], every: Sequence[Candidate], corrected: bool = True
) -> list[Screened]:
    """Return each effect at each size from each view, best first, without those that do nothing.

    Other parameters are ``corrected`` before a staircase is judged: one of the wrong step looks
    as good while they are still at values that made up for it.
    """
    return promising(screening_results(views, every, corrected))


def promising(results: Iterable[Screened]) -> list[Screened]:
    """Return those that move the outputs beyond what parameters can imitate, best first."""
    return sorted((it for it in results if it.difference.any()), key=lambda it: it.left)


def screening_results(
    views: Sequence[Linearisation], every: Sequence[Candidate], corrected: bool = True
) -> list[Screened]:
    """Return each effect at each size from each view, whatever it does."""
    results: list[Screened] = []
    for seen in views:
        problem = seen.problem
        base = problem.values(seen.vector)
        tasks = [(one, sizes) for one in every for sizes in neighbours(one)]
        simulate = partial(corrected_changes if corrected else changes, seen, base)
        found = problem.workers.map(simulate, tasks)
        every_size = [(one, size) for one, sizes in tasks for size in sizes]
        results += _results(seen, every_size, list(chain.from_iterable(found)))
    return results


def _results(
    seen: Linearisation, every: Sequence[tuple[Candidate, Settings]], changes: Sequence[Array]
) -> list[Screened]:
    left, share = best_scales(seen, [one for one, _ in every], changes)
    return [
        _screened(seen, one, settings, columns, own, float(rest))
        for (one, settings), columns, rest, own in zip(every, changes, left, share)
    ]


def best_scales(
    seen: Linearisation, every: Sequence[Candidate], changes: Sequence[Array]
) -> tuple[Array, Array]:
    """Return what effects leave that change errors so, shape (k,), and at which share of it.

    Args:
        seen: from where, so that its parameters follow inside their bounds.
        every: the effect of each change.
        changes: of shape (m + priors, 1), or of a sine and a cosine, which have a share each.
            Shares have shape (k, 2), the second unused where there is one.
    """
    p, (down, up) = seen.slopes.shape[1], seen.room
    gram, towards = np.zeros((len(every), p + 2, p + 2)), np.zeros((len(every), p + 2))
    low, high = np.zeros_like(towards), np.zeros_like(towards)
    gram[:, :p, :p], towards[:, :p] = seen.gram, seen.slopes.T @ seen.errors
    low[:, :p], high[:, :p] = down, up
    for k, (one, columns) in enumerate(zip(every, changes)):
        own = slice(p, p + columns.shape[1])
        gram[k, :p, own] = seen.slopes.T @ columns
        gram[k, own, :p] = gram[k, :p, own].T
        gram[k, own, own] = columns.T @ columns
        towards[k, own] = columns.T @ seen.errors
        low[k, own], high[k, own] = scales(one)
    left, steps = remains(seen, gram, towards, low, high)
    return left, steps[:, p:]


def scales(one: Candidate) -> tuple[float, float]:
    """Between which shares of a change the best is sought."""
    if one.ripple:
        return -LARGEST, LARGEST
    if one.hints.inverse:
        return LEAST, STRETCH
    return (1.0, 1.0) if one.discontinuous else (0.0, STRETCH)


def _screened(
    seen: Linearisation,
    one: Candidate,
    settings: Settings,
    columns: Array,
    share: Array,
    left: float,
) -> Screened:
    if not one.ripple:
        change = columns[:, 0]
        return Screened(seen, one, settings, float(share[0]), change, seen.without(change), left)
    at_once = {**settings, one.ripple[1]: 0.0}
    plain = Screened(seen, one, at_once, 1.0, columns[:, 0], columns[:, 0], left, columns)
    return turned(plain, share, left)


def turned(ripple: Screened, share: Array, left: float) -> Screened:
    """Return a ripple with these shares of its sine and its cosine, shape (2,)."""
    assert ripple.candidate.ripple
    assert ripple.waves is not None
    switch, phase = ripple.candidate.ripple
    size = ripple.candidate.trial_values[0][switch] * min(hypot(*share), LARGEST)
    shown = {**ripple.settings, switch: size, phase: atan2(share[1], share[0])}
    change = ripple.waves @ share
    without = ripple.seen.without(change)
    return replace(ripple, settings=shown, change=change, difference=without, left=left)


def remains(
    seen: Linearisation, gram: Array, towards: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return the squared errors that are left at the best steps inside a box, and these steps."""
    best = least_in_box(gram, towards, low, high)
    return float(seen.errors @ seen.errors) + value_at(gram, towards, best), best
