"""Shares of the squared error by bands of frequency.

Source: Parseval's theorem; Oppenheim, Schafer, Discrete-Time Signal Processing, 3rd ed.,
sec. 8.6.  No window, so that the shares make 1.
"""

from __future__ import annotations

import numpy as np

from servo_models.core.types import Array
from servo_models.data.clock import GAP
from servo_models.diagnosis.localisation.breakdown import (
    SURE,
    WORSE,
    Breakdown,
    Rows,
    Sums,
    plain,
    tabulate,
)
from servo_models.diagnosis.localisation.samples import Samples

OCTAVES = 1.5  # width of a band [octaves]
BANDS = 8  # most bands; the lowest holds the two lowest frequencies of the longest log


def by_frequency(samples: Samples) -> Breakdown | None:
    """Shares of bands up to the highest frequency that sampling shows; the lowest has offsets.

    None without neighbouring samples.
    """
    several = [one.times for one in samples.stretches if len(one.times) > 1]
    if not several:
        return None
    step = min(float(np.median(np.diff(times))) for times in several)
    longest = max(float(np.ptp(one.times)) for one in samples.stretches)
    count = int(np.clip(1 + np.log2(longest / (4.0 * step)) / OCTAVES, 1, BANDS))
    tops = 0.5 / step * np.exp2(-OCTAVES * np.arange(count - 1.0, -1.0, -1.0))
    powers = np.zeros((3, count))
    for stretch in samples.stretches:
        for piece in _pieces(stretch.times):
            rows, measured = stretch.rows[piece], stretch.measured[piece]
            signals = np.vstack(
                [samples.before[rows], samples.after[rows], measured - measured.mean()]
            )
            powers += _power(stretch.times[piece], signals, tops)
    before, after, amplitude = powers
    bottoms = np.array([0.0, *tops[:-1]])
    edges = [
        (f"below {plain(top)} Hz" if not low else f"{plain(low)} to {plain(top)} Hz", low, top)
        for low, top in zip(bottoms.tolist(), tops.tolist())
    ]
    weight = np.full(count, float(len(samples.before)))
    white = weight * (tops - bottoms) / tops[-1]
    scatter = np.sqrt(2.0 / white) * np.hypot(before, after)
    worse = (after > WORSE**2 * np.maximum(before, white)) & (after - before > SURE * scatter)
    sums = Sums(before, after, amplitude, weight, worse)
    return tabulate("frequency", "Hz", edges, sums, "at ", samples=False)


def _pieces(times: Array) -> list[Rows]:
    """Indices of samples that follow each other without a gap."""
    if len(times) < 2:
        return []
    steps = np.diff(times)
    cuts = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    return [piece for piece in np.split(np.arange(len(times)), cuts) if len(piece) > 1]


def _power(times: Array, signals: Array, tops: Array) -> Array:
    """Sums of squares of signals of shape (s, n) in bands up to ``tops``, shape (s, bands).

    Samples that are not evenly spaced are taken on an even grid between them.
    """
    n = len(times)
    even = np.linspace(times[0], times[-1], n)
    signals = np.vstack([np.interp(even, times, signal) for signal in signals])
    power = np.abs(np.fft.rfft(signals)) ** 2 / n
    power[:, 1 : (n + 1) // 2] *= 2.0
    frequencies = np.arange(power.shape[1]) * (n - 1) / (n * (times[-1] - times[0]))
    at = np.minimum(np.searchsorted(tops, frequencies), len(tops) - 1)
    return np.vstack([np.bincount(at, row, len(tops)).astype(float) for row in power])
