"""What a code histogram tells of readings: steps under their noise, and how loud that can be.

The characteristic function of quantised values has peaks at multiples of 1 / step, and noise
that comes after lowers them by what it is itself.  So a peak tells the step, and it bounds the
noise whatever the motion was: nothing else could have made the codes that sharp.
Source: Widrow, Kollar, Quantization Noise (2008), ch. 4; of independent parts the
characteristic functions multiply.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from servo_models.core.types import Array
from servo_models.data.sensor import phase_of_codes

HISTOGRAM_BINS = 4096  # bins over the range of a reading
CODE_FREQUENCIES = 8  # frequencies of the characteristic function per code in the range
FEWEST_CODES = 1.5  # codes in the range of a reading from which a histogram shows them
MOST_CODES = 600  # codes in the range up to which it does
MULTIPLE_RELATIVE_ERROR = 0.03  # relative error up to which a frequency is a multiple of a peak's
HIGH_OVER_HIGHEST = 0.9  # height over the highest peak from which a peak is as high
SHARP_HEIGHT = 0.95  # height of a peak from which values lie on codes without noise
MOST_STEPS = 4  # steps taken from a histogram: rounding and places of rest make some more
MOST_COUNTS = 20  # times that codes are counted, along the line through those before
NOISE_MEMORY_SAMPLES = 5.0  # noise samples per independent one, half of what a diagnosis allows
LOG_RARITY = 4.0  # natural log of 1 / probability of such a peak by chance, at any frequency
FAINT_HEIGHT = 0.05  # height below which a peak tells nothing of the noise


class Step(NamedTuple):
    """The step of a quantiser [SI], its standard error, and whether its peak is no chance."""

    size: float
    error: float
    sure: bool


def steps_under_noise(records: Sequence[Array]) -> list[Step]:
    """Return the likeliest steps of a quantiser whose codes carry a little noise, best first.

    ``records`` are of one signal, each of shape (n,), and so on the same codes; no step is a
    whole fraction of a better one.
    """
    values = np.concatenate(list(records))
    if float(np.ptp(values)) == 0.0:
        return []
    rates, heights = _peaks(values)
    by_chance = _by_chance(len(values), MOST_CODES - FEWEST_CODES)
    steps: list[Step] = []
    while len(rates) and len(steps) < MOST_STEPS:
        # a noise-free quantiser has all multiples as high: the slowest is the step's own
        first = int(np.flatnonzero(heights > HIGH_OVER_HIGHEST * heights.max())[0])
        rate = float(rates[first])
        size, error = _line_through_codes(values, 1.0 / rate)
        steps.append(Step(size, error, bool(heights[first] > by_chance)))
        numbers = np.maximum(np.round(rates / rate), 1.0)
        apart = np.abs(rates / rate - numbers) > MULTIPLE_RELATIVE_ERROR * numbers
        if heights[first] > SHARP_HEIGHT:
            apart &= rates < 0.5 * rate  # beyond, all that is below comes again
        else:
            # the noise that lowers the first multiple lowers the next more (normal law)
            apart |= heights > np.maximum(heights[first] ** numbers**2, by_chance)
        rates, heights = rates[apart], heights[apart]
    return steps


def loudest(values: Array, step: float) -> float:
    """Return the standard deviation [SI] that noise on quantised readings has at most.

    It is infinite where the histogram shows no codes.

    Args:
        values: readings of one record, shape (n,).
        step: to which the readings themselves were rounded, after the noise; 0 for none.
    """
    reach = float(np.ptp(values))
    if reach == 0.0:
        return math.inf
    rates, heights = _characteristic(values)
    # codes of the readings themselves are as sharp whatever the noise
    slowest = FEWEST_CODES / reach
    fastest = min(MOST_CODES / reach, 0.5 / step if step else math.inf)
    inside = (rates >= slowest) & (rates <= fastest)
    rates, heights = rates[inside], heights[inside]
    drawn = 0.5 * NOISE_MEMORY_SAMPLES / len(values) * np.maximum(1.0 - heights**2, 0.0)
    surely = heights - 2.0 * np.sqrt(drawn)
    told = heights > _by_chance(len(values), len(rates) / CODE_FREQUENCIES)
    told &= surely > FAINT_HEIGHT
    bounds = np.sqrt(-0.5 * np.log(surely[told])) / (math.pi * rates[told])
    return float(np.min(bounds, initial=math.inf))


def _by_chance(samples: int, frequencies: float) -> float:
    """Height that noise alone hardly reaches at any of so many frequencies (Rayleigh)."""
    return math.sqrt(
        NOISE_MEMORY_SAMPLES / samples * (math.log(max(frequencies, 1.0)) + LOG_RARITY)
    )


def _characteristic(values: Array) -> tuple[Array, Array]:
    """Frequencies [1/SI] and magnitude there of the characteristic function of values."""
    counts, _ = np.histogram(values, HISTOGRAM_BINS)
    magnitude = np.abs(np.fft.rfft(counts, CODE_FREQUENCIES * HISTOGRAM_BINS)) / len(values)
    return np.arange(len(magnitude)) / (CODE_FREQUENCIES * np.ptp(values)), magnitude


def _peaks(values: Array) -> tuple[Array, Array]:
    """Frequencies and heights of the peaks of that function."""
    rates, magnitude = _characteristic(values)
    low, high = (int(CODE_FREQUENCIES * codes) for codes in (FEWEST_CODES, MOST_CODES))
    inner = magnitude[low : min(high, len(magnitude) - 1)]
    peaks = 1 + np.flatnonzero((inner[1:-1] > inner[:-2]) & (inner[1:-1] >= inner[2:]))
    return rates[low + peaks], inner[peaks]


def _line_through_codes(values: Array, step: float) -> tuple[float, float]:
    """The step by which values rise from code to code, counted with one that is about right, and
    its standard error."""
    codes, spread, error = np.zeros(len(values)), 0.0, math.inf
    for _ in range(MOST_COUNTS):
        before, codes = codes, np.round(values / step - phase_of_codes(values / step))
        spread = float(np.var(codes))
        if spread == 0.0 or np.array_equal(codes, before):
            break
        about = codes - codes.mean()
        step = float(about @ values) / (len(values) * spread)
        rest = values - values.mean() - step * about
        error = math.sqrt(float(np.mean(rest**2)) * NOISE_MEMORY_SAMPLES / (len(values) * spread))
    return step, error
