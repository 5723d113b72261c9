"""Angles that were written within one turn, made to go on beyond it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array
from servo_models.data.sensor import off_neighbours

TURN = 2.0 * np.pi  # rad
WITHIN = 1.01  # range over a turn up to which an angle may have been written within one
LARGEST_STEP = 0.25  # step over a turn, from one row to the next, that motion surely stays below


def unwrapped(angles: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return angles [rad] as they go on, and the rows in which they had come back by a turn.

    They are as they were where motion may be so fast, where they have more than one turn, and where
    single wild readings alone leap.
    """
    usual = angles - off_neighbours(angles)
    leaps = np.flatnonzero(np.abs(np.diff(usual)) > 0.5 * TURN)
    if not len(leaps) or np.ptp(angles) > WITHIN * TURN:
        return angles, leaps[:0]
    whole = np.unwrap(angles)
    if np.abs(np.diff(np.unwrap(usual))).max() > LARGEST_STEP * TURN:
        return angles, leaps[:0]
    return whole, np.flatnonzero(np.diff(np.round((whole - angles) / TURN))) + 1


def next_to(angles: Array, reading: Array) -> Array:
    """Return angles [rad] of a command, which may be written within a turn as well, in the turns
    of a reading."""
    if np.ptp(angles) > WITHIN * TURN:
        return angles
    both = (angles, np.unwrap(angles))
    tried = [it + TURN * np.round(np.median(reading - it) / TURN) for it in both]
    return min(tried, key=lambda it: float(np.sum((it - reading) ** 2)))
