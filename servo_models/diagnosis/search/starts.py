"""From where a fit begins: of what looks suggest, what leaves least once it is simulated.

A look is straight: it takes a share of the difference that an effect makes at one size, and
moves the other parameters along their slopes.  The effect at that size, at the share of it, and
the other parameters there are simulated before a fit of dozens of simulations begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from servo_models.diagnosis.search.screening import Screened
from servo_models.identification.problem import Free


@dataclass(frozen=True, eq=False)
class Start:
    """Where a fit may begin.

    Attributes:
        results: of screening the effects that are fitted together.
        free: their parameters, with their starts.
        values: estimates [SI] of the other parameters.
        cost: squared errors that are left there, priors included.
    """

    results: tuple[Screened, ...]
    free: tuple[Free, ...]
    values: dict[str, float]
    cost: float


def best_start(results: Sequence[Screened], thorough: bool = True) -> Start:
    """Return the best start of effects that are fitted together, each seen at one size.

    Other parameters are tried where they make up for the whole effects only, unless ``thorough``.
    """
    options = [(1.0,) if it.share in (0.0, 1.0) else (1.0, it.share) for it in results]
    starts = (_start(results, scales, thorough) for scales in product(*options))
    return min(starts, key=lambda it: it.cost)


def _start(results: Sequence[Screened], scales: Sequence[float], thorough: bool) -> Start:
    """The start with the effects at so many times the sizes at which they were seen."""
    seen = results[0].seen
    free = tuple(one for it, scale in zip(results, scales) for one in it.candidate.at(it.at(scale)))
    own = {it.name: it.start for it in free}
    full = tuple(scale / it.share if it.share else 0.0 for it, scale in zip(results, scales))
    parts = dict.fromkeys((full, (1.0,) * len(results), (0.0,) * len(results)))
    wholes = [
        np.sum([share * it.whole for it, share in zip(results, shares)], axis=0)
        for shares in (parts if thorough else (full,))
    ]
    tried = [seen.start(whole) for whole in wholes]
    if thorough:
        stays = seen.problem.values(seen.vector)
        tried += [stays, *(seen.near_start(whole) for whole in wholes)]
    found = (Start(tuple(results), free, it, seen.cost({**it, **own})) for it in tried)
    return min(found, key=lambda it: it.cost)
