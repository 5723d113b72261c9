"""First estimates from which the output-error fit starts.

The refined instrumental variable method for continuous-time models, with a grid of filters
and of delays: linear regressions, filtered by the last estimate of the denominator, with
the noise-free output of the last model as instrument.
Source: Young, Recursive Estimation and Time-Series Analysis, 2nd ed., ch. 8; on frequency
responses the same steps are those of Sanathanan and Koerner, IEEE Trans. AC 8 (1963).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import comb

import numpy as np

from servo_models.identification.transfer.evidence import Evidence, Point, Record, Sweep
from servo_models.identification.transfer.functions import Structure, TransferFunction

ROUNDS = 4
FILTERS = 6
DELAYS = 7
KEPT = 2
"""Starts that go on to the fit, besides those grown from smaller structures."""
FASTER = 5.0
"""An added pole is this much faster than the fastest before it."""


def band(evidence: Sequence[Evidence]) -> tuple[float, float]:
    """Return the lowest and highest frequency [rad/s] that the data speak of."""
    low, high = np.inf, 0.0
    for one in evidence:
        if isinstance(one, Record):
            ends = 3.0 / float(one.times[-1] - one.times[0]), 1.0 / (3.0 * one.step)
        else:
            assert isinstance(one, Sweep)
            ends = float(one.frequencies.min()), float(one.frequencies.max())
        low, high = min(low, ends[0]), max(high, ends[1])
    return low, high


def cost(point: Point, evidence: Sequence[Evidence], noise: Sequence[float]) -> float:
    """Return the weighted sum of squares over the rows to be fitted; infinite if unstable."""
    total = 0.0
    with np.errstate(all="ignore"):
        for one, size in zip(evidence, noise):
            error, _ = one.errors(point, False)
            total += float(np.sum((error[~one.rows_held_out] / size) ** 2))
    return total if np.isfinite(total) else np.inf


def starts(
    structure: Structure,
    evidence: Sequence[Evidence],
    noise: Sequence[float],
    smaller: Sequence[TransferFunction],
) -> list[Point]:
    """Return starting points, the most promising first.

    ``smaller`` are fitted functions of structures that this one contains.
    """
    low, high = band(evidence)
    undelayed = [_grow(f, replace(structure, delay=False)) for f in smaller if not f.delay]
    ranked = _ranked(undelayed, evidence, noise)
    if not (structure.delay and ranked):
        filters = [_poles_at(rate, structure.poles) for rate in np.geomspace(low, high, FILTERS)]
        found = [_refine(f, structure.zeros, evidence, noise) for f in filters]
        ranked = _ranked(found, evidence, noise)
    if structure.delay and ranked:
        base = ranked[0]
        longest = min(_lag(base), 1.0 / low)
        delays = longest * np.linspace(0.0, 1.0, DELAYS + 2)[1:-1]
        moved = (Point(base.b, base.a, base.scale, float(delay)) for delay in delays)
        found = [_refine(_settled(p, high), structure.zeros, evidence, noise) for p in moved]
        ranked = _ranked(found, evidence, noise)
    grown = [_grow(function, structure) for function in smaller]
    return _ranked([*ranked[:KEPT], *grown], evidence, noise)


def _ranked(
    points: Sequence[Point | None], evidence: Sequence[Evidence], noise: Sequence[float]
) -> list[Point]:
    costs = [(cost(p, evidence, noise), k, p) for k, p in enumerate(points) if p is not None]
    return [p for c, _, p in sorted(costs, key=lambda item: item[:2]) if np.isfinite(c)]


def _refine(
    filter_: Point, zeros: int, evidence: Sequence[Evidence], noise: Sequence[float]
) -> Point | None:
    """Iterate from a filter, whose delay stays, to the best point seen."""
    _, high = band(evidence)
    best, least = None, np.inf
    model: Point | None = None
    for _ in range(ROUNDS):
        left = np.zeros((filter_.a.size + zeros + 1,))
        matrix = np.zeros((len(left), len(left)))
        for one, size in zip(evidence, noise):
            rows = ~one.rows_held_out
            y, phi, z = one.regression(filter_, model, zeros)
            matrix += z[rows].T @ phi[rows] / size**2
            left += z[rows].T @ y[rows] / size**2
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(left))):
            break
        theta = np.linalg.lstsq(matrix, left, rcond=None)[0]
        b, a = np.split(theta, [zeros + 1])
        found = Point(np.asarray(b, float), np.asarray(a, float), filter_.scale, filter_.delay)
        reached = cost(found, evidence, noise)
        if reached < least:
            best, least = found, reached
        filter_ = _settled(found, high)
        model = filter_
    return best


def _poles_at(rate: float, order: int) -> Point:
    """(s + rate)^order."""
    a = np.array([float(comb(order, i)) for i in range(order)])
    return Point(np.array([1.0]), a, rate)


def _settled(point: Point, high: float) -> Point:
    """The same point with its poles made stable and not much faster than the data."""
    poles = np.roots([1.0, *point.a[::-1]])
    size = np.clip(np.abs(poles), 1e-6, 10.0 * high / point.scale)
    angle = np.angle(-np.abs(poles.real) + 1j * poles.imag)
    limit = np.pi - np.arccos(0.02)
    angle = np.where(np.abs(angle) < limit, np.sign(angle) * limit, angle)
    monic = np.real(np.poly(size * np.exp(1j * angle)))
    return Point.of(Point(point.b, monic[:0:-1], point.scale, point.delay).function())


def _lag(point: Point) -> float:
    """Delay [s] of slow signals, -G'(0) / G(0); infinite where it is not a positive one."""
    a, b = (np.append(c, 1.0 if c is point.a else 0.0) for c in (point.a, point.b))
    with np.errstate(all="ignore"):
        lag = float((a[1] / a[0] - b[1] / b[0]) / point.scale)
    return lag if np.isfinite(lag) and lag > 0.0 else np.inf


def _grow(function: TransferFunction, structure: Structure) -> Point:
    """The same function in a larger structure."""
    top, bottom = np.array(function.numerator), np.array(function.denominator)
    for _ in range(structure.poles - function.structure.poles):
        pole = FASTER * float(np.max(np.abs(np.roots(bottom))))
        bottom, top = np.polymul(bottom, [1.0, pole]), pole * top
    top = np.append(np.zeros(structure.zeros - function.structure.zeros), top)
    delay = function.delay
    if structure.delay and not delay:
        delay = 1e-3 / float(np.max(np.abs(np.roots(bottom))))
    return Point.of(TransferFunction.of(top, bottom, delay))
