"""Linear systems under held inputs on any grid, exact between samples; the hot loop of the fit.

Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 4.3.3,
with the sensitivities as further states (Ljung, System Identification, 2nd ed., sec. 10.3).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array

TICKS = 1e9
"""Ticks in a median sampling step; instants within one tick are one instant."""


@dataclass(frozen=True, eq=False)
class Held:
    """A piecewise constant signal that is 0 before its first edge, and when it is asked for.

    Attributes:
        edges: ticks at which a new value begins, increasing, shape (m,).
        values: those values, shape (m,).
        samples: ticks at which outputs are wanted, the first one 0, shape (n,).
        tick: length of a tick [s].
    """

    edges: NDArray[np.int64]
    values: Array
    samples: NDArray[np.int64]
    tick: float

    @classmethod
    def of(cls, times: Array, values: Array) -> Held:
        """Make one of a sampled signal; each value is held from its time on."""
        tick = float(np.median(np.diff(times))) / TICKS
        samples = np.rint((times - times[0]) / tick).astype(np.int64)
        kept = np.flatnonzero(np.diff(values, prepend=0.0))
        return cls(samples[kept], values[kept], samples, tick)


def propagate(held: Held, a: Array, b: Array, delay: float = 0.0) -> tuple[Array, Array]:
    """Return states and delayed input at the samples, from x = 0 at the first one.

    Args:
        held: the input u.
        a, b: x' = a x + b u, shapes (n, n) and (n,), in 1/s.
        delay: of the input [s], not negative; any fraction of a sample.

    Returns:
        States of shape (samples, n), and u as it acts from each sample on, shape (samples,).
        Not finite where an unstable system leaves the floats.
    """
    from scipy.linalg import expm

    cut, recur = _compiled()
    edges = held.edges + int(np.rint(delay / held.tick))
    levels = np.concatenate([[0.0], held.values])
    spans, acting, row, at_sample = cut(held.samples, edges, levels)
    distinct = np.sort(spans)
    distinct = distinct[np.append(True, np.diff(distinct) > 0)]
    n = len(b)
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n], joint[:n, n] = a, b
    with np.errstate(all="ignore"):
        maps = expm(joint * (held.tick * distinct)[:, None, None])
    out = np.zeros((len(held.samples), n))
    which = np.searchsorted(distinct, spans)
    recur(np.ascontiguousarray(maps[:, :n, :]), which, acting, row, out)
    return out, at_sample


def _cut(samples: Any, edges: Any, levels: Array) -> tuple[Any, Array, Any, Array]:
    """Cut the time at samples and edges.

    Returns the length of each piece, the level that acts in it and the sample at its end
    or -1; then the level that acts from each sample on.
    """
    most = len(samples) + len(edges)
    spans, row = np.zeros(most, np.int64), np.full(most, -1)
    acting, at_sample = np.zeros(most), np.zeros(len(samples))
    count, edge, now = 0, 0, samples[0]
    for k in range(len(samples)):
        while edge < len(edges) and edges[edge] <= samples[k]:
            if edges[edge] > now:
                spans[count], acting[count] = edges[edge] - now, levels[edge]
                now = edges[edge]
                if now == samples[k]:
                    row[count] = k
                count += 1
            edge += 1
        if samples[k] > now:
            spans[count], acting[count], row[count] = samples[k] - now, levels[edge], k
            now = samples[k]
            count += 1
        at_sample[k] = levels[edge]
    return spans[:count], acting[:count], row[:count], at_sample


def _recursion(maps: Array, which: Any, acting: Array, row: Any, out: Array) -> None:
    """x <- maps[which[k]] (x, acting[k]); kept in ``out[row[k]]`` unless that is -1."""
    n = maps.shape[1]
    x, new = np.zeros(n), np.zeros(n)
    for k in range(len(which)):
        m = maps[which[k]]
        for i in range(n):
            total = m[i, n] * acting[k]
            for j in range(n):
                total += m[i, j] * x[j]
            new[i] = total
        for i in range(n):
            x[i] = new[i]
        if row[k] >= 0:
            for i in range(n):
                out[row[k], i] = x[i]


@functools.cache
def _compiled() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Cut and recursion through numba; as Python they would dominate the fit."""
    from numba import njit

    compiled = njit(cache=True, error_model="numpy")
    return compiled(_cut), compiled(_recursion)
