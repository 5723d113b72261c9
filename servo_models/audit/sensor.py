"""What a column of readings tells about its sensor: steps, clipping, stale values, noise.

Every function takes the readings of one signal in the order of time, shape (n,), in one unit.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from itertools import pairwise

import numpy as np

from servo_models.recording import Array

ROUNDED = 1e-12
"""Readings closer than this share of the largest are equal but for rounding."""
NEAR = 100.0
"""Codes further apart than this many steps do not tell whether they are multiples of it."""
ON_STEP = 0.05
"""Distance from a multiple of the step, in steps, that still is on it."""
SOME = 0.01
"""Share of the readings that must occur more than once before steps are looked for."""
STILL = 0.01
"""Share of its range by which a reading at rest may move."""
REST_SAMPLES = 5
"""Samples for which a command must stand still so that its next move begins a repetition."""
ORDERS = (1, 2, 3)


def reading_step(values: Array) -> tuple[float, float]:
    """Return the smallest common step of the readings, and the share of them between steps.

    Only values that occur more than once count: those of a sensor without steps hardly ever
    do, and where a file was resampled they are the ones that the sensor gave.  The step is
    0 where the readings have none.
    Source: code histogram test, IEEE Std 1241; here the step is unknown, so it is the common
    divisor of the distances between neighbouring codes.
    """
    codes, counts = _codes(values)
    repeated = codes[counts > 1]
    if len(repeated) < 3 or counts[counts > 1].sum() < SOME * len(values):
        return 0.0, 0.0
    gaps = np.diff(repeated)
    step = gaps.min()
    for reach in (3.0, NEAR, NEAR):
        near = gaps[gaps < reach * step]
        step = near.sum() / np.round(near / step).sum()
    near = gaps[gaps < NEAR * step]
    if len(near) < 2 or np.mean(_off(near / step) < ON_STEP) < 0.95:
        return 0.0, 0.0
    phase = np.angle(np.sum(counts * np.exp(2j * np.pi * codes / step))) / (2.0 * np.pi)
    share = np.sum(counts[_off(codes / step - phase) > 2.0 * ON_STEP]) / len(values)
    return float(step), float(share)


def _codes(values: Array) -> tuple[Array, Array]:
    """Different values but for rounding, ascending, and how often each occurs."""
    ordered = np.sort(values)
    new = np.diff(ordered, prepend=-math.inf) > ROUNDED * np.abs(values).max()
    starts = np.flatnonzero(new)
    return ordered[starts], np.diff(starts, append=len(values))


def _off(multiples: Array) -> Array:
    return np.abs(multiples - np.round(multiples))


def difference_noise(values: Array) -> float:
    """Return the standard deviation of white noise on a signal that is smooth between samples.

    Differences of order k remove a smooth signal and scale white noise by the root of
    (2k choose k); the least of three orders is the one that the signal inflates least, and
    the median keeps transients out.
    Source: Hall, Kay, Titterington, Biometrika 77 (1990); median: Rousseeuw, Croux, JASA 88
    (1993).
    """
    estimates = [
        1.4826 * np.median(np.abs(np.diff(values, order))) / math.sqrt(math.comb(2 * order, order))
        for order in ORDERS
    ]
    return float(min(estimates))


def stale_share(values: Array, floor: float) -> float:
    """Return the share of the moving samples that repeat the one before exactly.

    A sample counts as moving where its neighbours differ by more than 8 noise floors.
    """
    if len(values) < 4:
        return 0.0
    moving = np.abs(values[3:] - values[:-3]) > 8.0 * floor
    same = (values[1:-2] == values[2:-1]) & moving
    return float(same.sum() / moving.sum()) if moving.any() else 0.0


def clipped_share(values: Array, command: Array, floor: float) -> float:
    """Return the share of samples at which a reading stays at an extreme that it ran into.

    It stays there for three samples or more, came with a speed of over 12 noise floors a
    sample that would have carried it past, and its command, shape (n, inputs), takes more than one
    value there; so a shaft that settles is not taken for one that is held.
    """
    held = np.zeros(len(values), dtype=bool)
    for sign in (1.0, -1.0):
        turned = sign * values
        top = turned.max()
        at = np.concatenate([[0], (turned >= top - ROUNDED * abs(top)).astype(int), [0]])
        starts, stops = np.flatnonzero(np.diff(at) == 1), np.flatnonzero(np.diff(at) == -1)
        there = np.zeros(len(values), dtype=bool)
        for start, stop in zip(starts, stops):
            speed = turned[start - 1] - turned[start - 2] if start > 1 else 0.0
            past = turned[start - 1] + speed > top and speed > 12.0 * floor
            there[start:stop] = stop - start > 2 and past
        if there.any() and np.ptp(command[there], axis=0).any():
            held |= there
    return float(held.mean())


def spread_of_repeats(values: Array, command: Array) -> float | None:
    """Return the standard deviation of the responses to identical commands, None without any.

    A repetition lasts from a move after rest of the command, shape (n, inputs), to the next
    such move, and begins from the same command with a reading at rest.
    Source: Draper, Smith, Applied Regression Analysis, 3rd ed., sec. 2.1 (pure error).
    """
    still = STILL * float(np.ptp(values))
    moved = np.concatenate([[False], np.any(command[1:] != command[:-1], axis=1)])
    at = np.flatnonzero(moved)
    onsets = at[np.diff(at, prepend=0) > REST_SAMPLES]
    resting = {int(i) for i in onsets if np.ptp(values[i - REST_SAMPLES : i]) <= still}
    squares, freedom = 0.0, 0
    for group in _same_commands(command, [*map(int, onsets), len(values)], resting):
        length = min(stop - start for start, stop in group)
        responses = np.array([values[start : start + length] for start, _ in group])
        squares += float(np.sum((responses - responses.mean(axis=0)) ** 2))
        freedom += (len(group) - 1) * length
    return float(np.sqrt(squares / freedom)) if freedom else None


def _same_commands(
    command: Array, edges: Sequence[int], wanted: Container[int]
) -> list[list[tuple[int, int]]]:
    """Stretches (start, stop) between edges, from wanted starts, grouped by equal commands."""
    groups: list[list[tuple[int, int]]] = []
    for start, stop in pairwise(edges):
        if start not in wanted:
            continue
        for group in groups:
            first, last = group[0]
            length = min(stop - start, last - first)
            alike = abs((stop - start) - (last - first)) <= 2 and length > REST_SAMPLES
            before = slice(start - 1, start + length), slice(first - 1, first + length)
            if alike and np.array_equal(command[before[0]], command[before[1]]):
                group.append((start, stop))
                break
        else:
            groups.append([(start, stop)])
    return [group for group in groups if len(group) > 1]
