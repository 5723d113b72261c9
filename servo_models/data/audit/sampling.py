"""The clock of a log: its step, jitter, time stamps and gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servo_models.data.audit.steps import reading_step
from servo_models.data.recording import Log

NANOSECOND = 9
"""Decimals of a time stamp [s] below which its digits are rounding."""
GAP = 1.5
"""A step longer than this many usual ones has lost samples."""
STAMPS = 3
"""Different steps that time stamps need to show their digits, 0 among them: no clock rests."""


@dataclass(frozen=True)
class Gap:
    """Samples are missing after ``row`` of the file: nothing for ``length`` [s]."""

    row: int
    time: float
    length: float


@dataclass(frozen=True)
class Sampling:
    """The clock of a log, all in seconds.

    Attributes:
        samples: how many.
        duration: from the first to the last.
        step: mean of the steps that are no gaps.
        jitter: their standard deviation.
        stamp: smallest common step of the time stamps, 0 for none.
        gaps: steps longer than 1.5 usual ones.
    """

    samples: int
    duration: float
    step: float
    jitter: float
    stamp: float
    gaps: tuple[Gap, ...]


def sampling(log: Log) -> Sampling:
    """Return the clock of a log."""
    steps = np.diff(log.times)
    lost = np.flatnonzero(steps > GAP * np.median(steps))
    kept = np.delete(steps, lost)
    gaps = tuple(Gap(int(log.rows[i]), float(log.stamps[i]), float(steps[i])) for i in lost)
    return Sampling(
        samples=len(log.times),
        duration=log.duration,
        step=float(kept.mean()),
        jitter=float(kept.std()),
        stamp=reading_step(np.round([*steps, 0.0, 0.0], NANOSECOND), STAMPS).size,
        gaps=gaps,
    )
