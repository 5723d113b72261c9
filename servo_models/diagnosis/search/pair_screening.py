"""Pairs of effects by what both would leave together, before any is fitted.

What each is worth alone says little: it has then made up for what the other one does.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array
from servo_models.diagnosis.fitting.linearisation import Linearisation
from servo_models.diagnosis.search.screening import (
    LEAST,
    STRETCH,
    Screened,
    remains,
    scales,
    turned,
)

EACH = 3
"""Sizes of each effect that take part in pairs, but for counts of a ripple, which all do: alone it
takes one that imitates the other effect as well."""


class _Pair(NamedTuple):
    """Two results by their places, squared errors that both would leave, and at which shares."""

    left: float
    places: tuple[int, int]
    scales: tuple[Array, Array]


def pairs(results: Sequence[Screened], enough: float = np.inf) -> list[tuple[Screened, Screened]]:
    """Return pairs of different effects by what both would leave together, best first.

    Pairs that leave more than ``enough`` squared errors are none.
    """
    scored: list[_Pair] = []
    for seen in dict.fromkeys(result.seen for result in results):
        scored += _pairs(results, _taking_part(results, seen))
    best: dict[frozenset[str], tuple[Screened, Screened]] = {}
    for pair in sorted(scored, key=lambda it: it.left):
        if pair.left > enough:
            break
        one, other = (results[k] for k in pair.places)
        names = frozenset((one.candidate.name, other.candidate.name))
        if names not in best:
            best[names] = (_at(one, pair.scales[0]), _at(other, pair.scales[1]))
    return list(best.values())


def _at(result: Screened, share: Array) -> Screened:
    """A ripple at the amplitude and the phase that it has beside another effect."""
    return result if result.waves is None else turned(result, share, result.left)


def _taking_part(results: Sequence[Screened], seen: Linearisation) -> list[int]:
    """Which results from a linearisation take part in pairs: of each effect those that leave least
    alone, of a ripple all, and of a discontinuous one those that leave least beside a smooth one.
    """
    groups: dict[str, list[int]] = {}
    for i, result in enumerate(results):
        if result.seen is seen:
            groups.setdefault(result.candidate.name, []).append(i)
    best = [i for group in groups.values() for i in group[:EACH]]
    smooth = [results[i] for i in best if not results[i].candidate.discontinuous]
    for group in groups.values():
        if smooth and results[group[0]].candidate.discontinuous:
            left = residual_beside([results[i] for i in group], smooth)
            best += [group[k] for k in np.argsort(left)[:EACH]]
        elif results[group[0]].waves is not None:
            best += group
    return list(dict.fromkeys(best))


def residual_beside(results: Sequence[Screened], others: Sequence[Screened]) -> Array:
    """Return the squared errors that each of some results leaves beside the best of the others.

    All are from the same linearisation.  Shape (results,).
    """
    seen = results[0].seen
    rest = seen.without(np.column_stack([seen.errors + it.change for it in results]))
    columns = np.column_stack([it.difference for it in others])
    low, high = np.array([scales(it.candidate) for it in others]).T[..., None]
    power, along = np.sum(columns**2, axis=0)[:, None], columns.T @ rest
    share: Array = np.clip(-along / power, low, high)
    return np.asarray(
        np.sum(rest**2, axis=0) + np.min(share * (2.0 * along + share * power), axis=0)
    )


def _pairs(results: Sequence[Screened], own: Sequence[int]) -> list[_Pair]:
    """What pairs from one view would leave."""
    part = [results[k] for k in own]
    seen = part[0].seen
    widths = np.array([it.columns.shape[1] for it in part])
    columns = np.column_stack([seen.slopes, *(it.columns for it in part)])
    gram, towards, p = columns.T @ columns, columns.T @ seen.errors, seen.slopes.shape[1]
    begins = p + np.cumsum(widths) - widths
    found: list[_Pair] = []
    i, j = _different(part)
    for wide in product((1, 2), repeat=2):
        group = (widths[i] == wide[0]) & (widths[j] == wide[1])
        ends = list(zip((i[group], j[group]), wide))
        if not group.any():
            continue
        first = [np.tile(np.arange(p), (group.sum(), 1))]
        chosen = np.hstack([*first, *(begins[k][:, None] + np.arange(n) for k, n in ends)])
        low, high = (
            np.hstack([np.tile(room, (group.sum(), 1)), *(np.tile(end[k], n) for k, n in ends)])
            for room, end in zip(seen.room, _limits(part))
        )
        both = gram[chosen[:, :, None], chosen[:, None, :]]
        left, steps = remains(seen, both, towards[chosen], low, high)
        middle = p + wide[0]
        for rest, step, k, m in zip(left, steps, i[group], j[group]):
            found.append(_Pair(float(rest), (own[k], own[m]), (step[p:middle], step[middle:])))
    return found


def _different(part: Sequence[Screened]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Pairs of different effects that do not change the response alike, each of shape (k,)."""
    names = np.array([it.candidate.name for it in part])
    i, j = np.triu_indices(len(part), 1)
    apart = np.column_stack([it.difference for it in part])
    gram = apart.T @ apart
    a, b, c = gram[i, i], gram[j, j], gram[i, j]
    ripple = np.array([it.waves is not None for it in part])
    unlike = (a * b - c * c > 1e-6 * a * b) | ripple[i] | ripple[j]
    differ = (names[i] != names[j]) & unlike
    return i[differ], j[differ]


def _limits(part: Sequence[Screened]) -> tuple[Array, Array]:
    """Least and largest shares of each column of some results in pairs, shapes (k, 1)."""
    ends = [
        scales(it.candidate)
        if it.waves is not None
        else (LEAST if it.candidate.hints.inverse else 0.0, STRETCH)
        for it in part
    ]
    low, high = np.array(ends).T
    return low[:, None], high[:, None]
