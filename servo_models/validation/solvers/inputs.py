"""Piecewise constant inputs as edges: when which value begins."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array

Edges = list[tuple[float, float]]
"""(time [s], value that begins there), in order of time."""
Segment = tuple[float, float, tuple[float, ...]]
"""Begin [s], end [s], values of all signals between."""

SAME_TIME = 1e-9
"""Instants closer than this [s] are one: sums of communication steps are rounded."""


def changes(times: Array, values: Array, delay: float = 0.0, rest: float = 0.0) -> Edges:
    """Return the edges of a held column, ``delay`` [s] later and at ``rest`` before."""
    kept = [k for k in range(len(values)) if k == 0 or values[k] != values[k - 1]]
    edges = [(float(times[k]) + delay, float(values[k])) for k in kept]
    return edges if delay == 0.0 else [(float(times[0]), rest), *edges]


def sampled(edges: Edges, period: float, end: float) -> Edges:
    """Return the edges as seen by a sampler with ticks at k ``period`` [s] from time 0."""
    seen: Edges = []
    for k in range(math.floor(end / period + SAME_TIME) + 1):
        tick = k * period
        value = value_at(edges, tick)
        if not seen or value != seen[-1][1]:
            seen.append((tick, value))
    return seen


def segments(signals: Sequence[Edges], end: float) -> list[Segment]:
    """Return the spans up to ``end`` [s] in which no signal changes."""
    starts = sorted(time for edges in signals for time, _ in edges if time < end)
    cuts = [t for k, t in enumerate(starts) if k == 0 or t > starts[k - 1] + SAME_TIME]
    spans = zip(cuts, [*cuts[1:], end])
    return [
        (begin, stop, tuple(value_at(edges, begin) for edges in signals)) for begin, stop in spans
    ]


def rows_in(times: Array, begin: float, end: float, first: bool) -> NDArray[np.intp]:
    """Return the rows in (begin, end]; the first segment also has the row at its begin."""
    low = begin - SAME_TIME if first else begin + SAME_TIME
    return np.flatnonzero((times > low) & (times <= end + SAME_TIME))


def value_at(edges: Edges, time: float) -> float:
    """Return the value that holds from ``time`` [s] on."""
    return edges[bisect.bisect_right(edges, time + SAME_TIME, key=lambda edge: edge[0]) - 1][1]
