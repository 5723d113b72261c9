"""Frequency response of logs, without a model, where the excitation allows it.

Averaged cross spectra of half-overlapping Hann windows, pooled over the logs.
Source: Bendat, Piersol, Random Data, 4th ed., sec. 6.1, 11.5; Welch, IEEE Trans. Audio
Electroacoust. 15 (1967).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Complex

COHERENT = 0.8  # least share of the output's power that goes with the input
WINDOWS = 9  # fewest windows: incoherent noise reaches ``COHERENT`` in 1 of 1000 cases
FEWEST = 64  # samples of a window
BANDS = 40  # bands of equal width on the logarithmic axis; each shows its best excited frequency


@dataclass(frozen=True)
class Record:
    """Times [s] and, SI, an input and outputs at them; all of shape (n,)."""

    times: Array
    input: Array
    measured: Array
    simulated: Array


@dataclass(frozen=True)
class Empirical:
    """Responses at frequencies [Hz], of measured and simulated output; SI, shape (m,)."""

    hertz: Array
    measured: Complex
    simulated: Complex


def empirical(records: Sequence[Record], step: float) -> Empirical | None:
    """Return the response of output to input where both are coherent, None if nowhere.

    The records are brought to one sampling step [s], the slowest of theirs.  The simulated
    output goes through the same estimate, so that windows and leakage do the same to both.
    """
    from scipy.signal import csd

    even = [_resampled(record, step) for record in records]
    window = 2 * max(len(record.times) for record in even) // (WINDOWS + 1)
    long = [record for record in even if len(record.times) >= window]
    if window < FEWEST:
        return None

    def pooled(first: str, second: str) -> Complex:
        """Cross spectrum over all records, each with the weight of its length."""
        spectra = [
            csd(getattr(r, first), getattr(r, second), 1.0 / step, nperseg=window)[1] * len(r.times)
            for r in long
        ]
        return np.asarray(np.sum(spectra, axis=0), dtype=complex)

    power, reply = pooled("input", "input").real, pooled("measured", "measured").real
    across = pooled("input", "measured")
    with np.errstate(invalid="ignore", divide="ignore"):  # 0 / 0 where nothing moves
        coherence = np.abs(across) ** 2 / (power * reply)
        measured, simulated = across / power, pooled("input", "simulated") / power
    hertz = np.fft.rfftfreq(window, step).astype(float)
    kept = _best_excited(hertz, np.where(coherence >= COHERENT, power, 0.0))
    if not len(kept):
        return None
    return Empirical(hertz[kept], measured[kept], simulated[kept])


def _resampled(record: Record, step: float) -> Record:
    """A record on a regular grid: outputs by straight lines, the input held."""
    grid = np.arange(0.0, record.times[-1] + 0.5 * step, step)
    held = np.searchsorted(record.times, grid + 1e-6 * step, side="right") - 1
    outputs = (np.interp(grid, record.times, y) for y in (record.measured, record.simulated))
    return Record(grid, record.input[held], *outputs)


def _best_excited(hertz: Array, power: Array) -> NDArray[np.int64]:
    """The strongest frequency of each logarithmic band, without those of no power."""
    bands = np.floor(BANDS * np.log(hertz[1:] / hertz[1]) / np.log(hertz[-1] / hertz[1]))
    places = []
    for band in np.unique(bands):
        members = 1 + np.flatnonzero(bands == band)
        best = members[np.argmax(power[members])]
        if power[best] > 0.0:
            places.append(best)
    return np.array(places, dtype=np.int64)
