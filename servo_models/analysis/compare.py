"""Compare a response with a reference, and measure the response to a step.

Every function takes times [s] of shape (n,), not decreasing, and values of shape (n,) in
one unit.  *Full scale* is the largest absolute value of the reference.
Source of the step measures: Ogata, Modern Control Engineering, 5th ed., sec. 5-3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from servo_models.core.types import Array
from servo_models.errors import UserError


def full_scale(reference: ArrayLike) -> float:
    """Return the largest absolute value of the reference, in its unit."""
    return float(np.max(np.abs(np.asarray(reference, dtype=float))))


def max_error(reference: ArrayLike, values: ArrayLike) -> float:
    """Return the largest absolute error over full scale [1].

    A reference of 0 throughout has no scale: the result is 0 where values equal it and
    infinite otherwise.
    """
    return _scaled(float(np.max(np.abs(_error(reference, values)))), reference)


def nrmse(reference: ArrayLike, values: ArrayLike) -> float:
    """Return the root of the mean squared error over full scale [1]; see ``max_error``."""
    return _scaled(float(np.sqrt(np.mean(_error(reference, values) ** 2))), reference)


@dataclass(frozen=True)
class Tube:
    """The region around a reference in which a response has to stay.

    Attributes:
        times, lower, upper: its bounds at the reference's times, shape (n,).
        inside: whether the response is inside at each of its own times, shape (m,).
    """

    times: Array
    lower: Array
    upper: Array
    inside: NDArray[np.bool_]

    @property
    def outside_share(self) -> float:
        """Share of the response's points that lie outside [1]."""
        return 1.0 - float(np.mean(self.inside))


def tube(
    times: ArrayLike,
    reference: ArrayLike,
    values: ArrayLike,
    time_width: float,
    amplitude: float,
    at: ArrayLike | None = None,
) -> Tube:
    """Return the tube of +/- ``time_width`` [s] and +/- ``amplitude`` around a reference.

    Its bounds at t are the extremes of the reference, linear between its points, over
    [t - time_width, t + time_width], widened by ``amplitude``.  ``at`` are the times of
    ``values`` where they are not the reference's.
    Source: the idea of Modelica's csv-compare and of pyfunnel, with a rectangle as tolerance.
    """
    grid, curve = _column(times), _column(reference)
    own_times = grid if at is None else _column(at)
    response = _column(values)
    _same_length(grid, curve)
    _same_length(own_times, response)
    lower, upper = _extremes(grid, curve, grid, time_width)
    low, high = _extremes(grid, curve, own_times, time_width)
    inside = (response >= low - amplitude) & (response <= high + amplitude)
    return Tube(grid, lower - amplitude, upper + amplitude, inside)


@dataclass(frozen=True)
class StepMetrics:
    """Measures of a step response; None where the response never gets there.

    Attributes:
        final: value that counts as 100 %, in the response's unit.
        delay: time from the step to 50 % [s].
        rise: time from 10 % to 90 % [s].
        overshoot: highest excess over ``final`` as a fraction of the step [1].
        settling_2, settling_5: time from the step until the response stays within 2 % and
            5 % of the step around ``final`` [s].
    """

    final: float
    delay: float | None
    rise: float | None
    overshoot: float | None
    settling_2: float | None
    settling_5: float | None


def step_metrics(
    times: ArrayLike, values: ArrayLike, at: float | None = None, final: float | None = None
) -> StepMetrics:
    """Return all measures of the response to a step at time ``at`` [s], default the first.

    ``final`` is the value that counts as 100 %, by default the last one.
    """
    target = float(_column(values)[-1]) if final is None else final
    return StepMetrics(
        final=target,
        delay=delay_time(times, values, at, target),
        rise=rise_time(times, values, at, target),
        overshoot=overshoot(times, values, at, target),
        settling_2=settling_time(times, values, 0.02, at, target),
        settling_5=settling_time(times, values, 0.05, at, target),
    )


def time_to(
    times: ArrayLike,
    values: ArrayLike,
    fraction: float,
    at: float | None = None,
    final: float | None = None,
) -> float | None:
    """Return the time [s] from the step until ``fraction`` of it is first reached, or None.

    Linear between points.
    """
    since, part = _normalised(times, values, at, final)
    reached = np.flatnonzero(part >= fraction)
    if not len(reached):
        return None
    return _crossing(since, part, int(reached[0]), fraction)


def delay_time(
    times: ArrayLike, values: ArrayLike, at: float | None = None, final: float | None = None
) -> float | None:
    """Return the time [s] from the step to 50 % of it, or None."""
    return time_to(times, values, 0.5, at, final)


def rise_time(
    times: ArrayLike, values: ArrayLike, at: float | None = None, final: float | None = None
) -> float | None:
    """Return the time [s] from 10 % to 90 % of the step, or None."""
    low = time_to(times, values, 0.1, at, final)
    high = time_to(times, values, 0.9, at, final)
    return None if low is None or high is None else high - low


def overshoot(
    times: ArrayLike, values: ArrayLike, at: float | None = None, final: float | None = None
) -> float | None:
    """Return the highest excess over the final value as a fraction of the step, at least 0 [1].

    None for a step of size 0.
    """
    _, part = _normalised(times, values, at, final)
    return float(max(np.max(part) - 1.0, 0.0)) if len(part) else None


def settling_time(
    times: ArrayLike,
    values: ArrayLike,
    band: float,
    at: float | None = None,
    final: float | None = None,
) -> float | None:
    """Return the time [s] from the step until the response stays within ``band`` of it.

    ``band`` is a fraction of the step, such as 0.02.  None if the last point is outside.
    """
    since, part = _normalised(times, values, at, final)
    away = np.flatnonzero(np.abs(part - 1.0) > band)
    if not len(part) or (len(away) and away[-1] == len(part) - 1):
        return None
    if not len(away):
        return 0.0
    last = int(away[-1])
    edge = 1.0 + band if part[last] > 1.0 else 1.0 - band
    return _crossing(since, part, last + 1, edge)


def _column(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=float)


def _same_length(times: Array, values: Array) -> None:
    if times.shape != values.shape:
        raise UserError(f"{len(values)} values for {len(times)} points: give one value per time")


def _error(reference: ArrayLike, values: ArrayLike) -> Array:
    _same_length(_column(reference), _column(values))
    return _column(values) - _column(reference)


def _scaled(error: float, reference: ArrayLike) -> float:
    scale = full_scale(reference)
    if scale > 0.0:
        return error / scale
    return 0.0 if error == 0.0 else float("inf")


def _extremes(grid: Array, curve: Array, at: Array, width: float) -> tuple[Array, Array]:
    """Least and largest value of the piecewise linear curve within ``width`` of each time."""
    left, right = np.interp(at - width, grid, curve), np.interp(at + width, grid, curve)
    low, high = np.minimum(left, right), np.maximum(left, right)
    first = np.searchsorted(grid, at - width, side="left")
    last = np.searchsorted(grid, at + width, side="right")
    for k in np.flatnonzero(last > first):
        inner = curve[first[k] : last[k]]
        low[k], high[k] = min(low[k], inner.min()), max(high[k], inner.max())
    return low, high


def _normalised(
    times: ArrayLike, values: ArrayLike, at: float | None, final: float | None
) -> tuple[Array, Array]:
    """Time since the step, and the part of the step done; empty for a step of size 0."""
    grid, curve = _column(times), _column(values)
    _same_length(grid, curve)
    begin = float(grid[0]) if at is None else at
    first = int(np.searchsorted(grid, begin, side="right")) - 1
    if first < 0:
        raise UserError(f"the step at {begin:g} s is before the first time {grid[0]:g} s")
    start, target = float(curve[first]), float(curve[-1]) if final is None else final
    if target == start:
        return grid[:0], curve[:0]
    return grid[first:] - begin, (curve[first:] - start) / (target - start)


def _crossing(since: Array, part: Array, k: int, level: float) -> float:
    """Time at which the line between points k - 1 and k has the value ``level``."""
    if k == 0 or part[k] == part[k - 1]:
        return float(since[k])
    share = (level - part[k - 1]) / (part[k] - part[k - 1])
    return float(since[k - 1] + share * (since[k] - since[k - 1]))
