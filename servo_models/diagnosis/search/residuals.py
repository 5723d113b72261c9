"""How much of the errors that a model leaves is its own, and how much is noise.

Noise has a memory, but a short one: it is taken as a first-order autoregression of any colour,
and the reading step adds white noise of known power.  What a model lacks moves with the
actuator, slowly against the sampling.  So the fast part of the spectrum tells the noise, which
is continued to low frequencies, and the structured part is the power above it.  That needs no
idea of what is missing: a law, a line or a burst are all power that noise does not have.  Only
the steps of a quantiser are as fast as noise, but with so much of it no codes would be seen.

The spectrum is the median over many short stretches, since bursts and steps disturb only few
of them.  Colour and power of the noise are averaged over the likelihood of that spectrum
(Whittle), so a short or strongly coloured record, of which the noise is not well known, gives
a wide interval.
Sources: Sykulski et al., Biometrika 106 (2019) 251 (Whittle's likelihood, window included);
Welch, IEEE Trans. Audio Electroacoust. 15 (1967) (stretches); Allen et al., Phys. Rev. D 85
(2012) 122006, app. B (median); Widrow, Kollar, Quantization Noise (2008), ch. 5 (reading
step).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from threading import Lock
from weakref import ref

import numpy as np
from cachetools import LRUCache, cached

from servo_models.analysis.statistics import hann, stretch_powers
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.sensor import reading_step
from servo_models.diagnosis.codes import loudest
from servo_models.diagnosis.search.crossval import CrossValidation
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.identification.problem import Problem

LONGEST_STRETCH = 48  # samples
SHORTEST_STRETCH = 16  # samples
LEAST_STRETCHES = 8  # stretches in a record
LEAST_SAMPLES = SHORTEST_STRETCH * LEAST_STRETCHES  # samples of a record: a shorter one is noise
NOISE_FREQUENCY_PER_SAMPLE = 0.08  # frequency of noise: motion that is sampled well is slower
NOISE_CORRELATIONS: Array = 1.0 - np.geomspace(1.0, 0.05, 40)  # trials for neighbouring samples
LOUDEST_NOISE_IN_FLOORS = 7.0  # loudest noise: differences of neighbours show a sixth of slow noise
NOISE_POWERS_IN_STANDARD_ERRORS: Array = np.linspace(-4.0, 4.0, 33)  # trials about the fast part's
ONE_SIDED_95 = 1.645  # standard errors to a bound that is passed in 5 % of the cases


@dataclass(frozen=True)
class Residuals:
    """What errors consist of, RMS in noise floors of the audit.

    Attributes:
        structured: systematic part, which is no noise.
        least: lower bound of that part with 95 % confidence.
        noise: the rest, at least the floor.
        total: both.
    """

    structured: float
    least: float
    noise: float
    total: float

    def without(self, known: float) -> Residuals:
        """Return the same, less a structured part [noise floors] of which the reason is known."""
        structured, least = (
            math.sqrt(max(part**2 - known**2, 0.0)) for part in (self.structured, self.least)
        )
        return replace(self, structured=structured, least=least)


def residuals_of(problem: Problem, evidence: CrossValidation) -> Residuals:
    """Return how much of the errors of a fit is structured, all records and outputs together.

    Readings with fewer than ``LEAST_SAMPLES`` count as noise, as far as that may be so loud.  An
    error within half a step of its reading has no structure: without noise on it, a reading that
    rests is off by the same all the time.
    """
    power = structured = variance = noise = 0.0
    for errors, step, most in _readings(problem, evidence):
        noise_power, spread = _noise(errors, step**2 / 12.0)
        allowed = min(1.0, most**2 / max(noise_power, 1e-30))
        noise_power, spread = allowed * noise_power, allowed * spread
        beyond = np.maximum(np.abs(errors) - 0.5 * step, 0.0)
        power += float(errors @ errors)
        noise += len(errors) * noise_power
        structured += min(
            float(errors @ errors) - len(errors) * noise_power, float(beyond @ beyond)
        )
        variance += (len(errors) * spread) ** 2
    n = max(problem.samples, 1)
    return Residuals(
        structured=math.sqrt(max(structured, 0.0) / n),
        least=math.sqrt(max(structured - ONE_SIDED_95 * math.sqrt(variance), 0.0) / n),
        noise=max(math.sqrt(noise / n), 1.0),
        total=math.sqrt(power / n),
    )


def unmodelled(left: Residuals, gap: float, effects: int = 1, settings: Settings = DEFAULT) -> bool:
    """Return whether a fitted model lacks something that matters.

    Its structured part is surely ``structured_over_noise`` against the noise, and at least
    ``missed_gap_share`` of what there was to explain, or ``structured_floors``: a small second
    cause, or laws that are not quite those of the actuator, do not make a fitted model by one or
    two effects wrong.

    Args:
        left: residuals of the fitted model.
        gap: RMS error [noise floors] after re-tuning alone, of a fit to everything.
        effects: number of effects in the fitted model.
        settings: those of the diagnosis.
    """
    if effects >= settings.many_effects:
        return sure(left, settings)
    before = math.sqrt(max(gap**2 - left.noise**2, left.structured**2))
    least = min(settings.missed_gap_share * before, settings.structured_floors)
    return sure(left, settings) and left.structured > least


def sure(left: Residuals, settings: Settings = DEFAULT) -> bool:
    """Return whether a part of the errors is surely no noise."""
    return left.least > settings.structured_over_noise * left.noise


def _readings(problem: Problem, evidence: CrossValidation) -> Iterator[tuple[Array, float, float]]:
    """Errors of each output of each log, its reading step, and how loud noise may be, all in noise
    floors."""
    for (k, name), rows in problem.records.items():
        errors = evidence.errors[rows]
        if len(errors):
            (step, most), floor = _codes(problem.logs[k], name), problem.sigma[name]
            # what is louder is in the simulation alone, such as a limit cycle
            yield errors, step / floor, min(most / floor, LOUDEST_NOISE_IN_FLOORS)


@cached(LRUCache(64), key=lambda log, name: (ref(log), name), lock=Lock())
def _codes(log: Log, name: str) -> tuple[float, float]:
    """Step of a reading [SI], and how loud noise may be for its codes to be as sharp as they are.

    Every fit of a diagnosis asks it of the same few records.
    """
    values = log.outputs[name][log.counted]
    step = reading_step(values).size
    return step, loudest(values, step)


def _noise(errors: Array, white: float) -> tuple[float, float]:
    """Power of the noise in the errors of a record, shape (n,), of which ``white`` is known, and
    the standard error of what is left without it."""
    n, power = len(errors), float(np.mean(errors**2))
    if n < LEAST_SAMPLES or power <= 0.0:
        return power, 0.0
    length = min(LONGEST_STRETCH, n // LEAST_STRETCHES) // 2 * 2
    frequency, window, shape = _autoregressions(length)
    mean, median = _spectrum(errors, window)
    fast = frequency >= NOISE_FREQUENCY_PER_SAMPLE
    measured = np.where(fast, median, mean)
    # each memory with powers about the one that meets the fast part best
    least = 1e-6 * power
    centre = np.mean(np.maximum(median - white, least)[fast] / shape[:, fast], axis=1)
    degrees = n * fast.mean()
    powers = centre[:, None] * np.exp(NOISE_POWERS_IN_STANDARD_ERRORS * math.sqrt(2.0 / degrees))
    density = powers[..., None] * shape[:, None, :] + white
    # slow errors are noise too, or they have more power than noise: both count as they fit
    more = np.where(fast, density, np.maximum(density, measured))
    worth = 0.5 * n / len(frequency) * np.where((frequency == 0.0) | (frequency == 0.5), 0.5, 1.0)
    fits = [np.sum(worth * (np.log(it) + measured / it), axis=-1) for it in (density, more)]
    chance = np.exp(np.min(fits) - fits[0]) + np.exp(np.min(fits) - fits[1])
    chance /= chance.sum()
    expected = float(np.sum(chance * powers))
    unsure = float(np.sum(chance * (powers - expected) ** 2))
    memory = float(np.sum(chance * NOISE_CORRELATIONS[:, None]))
    # the noise in this record is one draw of its kind
    drawn = 2.0 / n * (1.0 + memory**2) / (1.0 - memory**2) * expected**2
    return expected + white, math.sqrt(unsure + drawn)


def _spectrum(errors: Array, window: Array) -> tuple[Array, Array]:
    """Mean and median power of stretches that overlap by half.

    Both have the mean of white noise at its power; the median of few stretches is up to 5 % more,
    which is the safe side, and less at Nyquist's frequency, of which there is one.
    """
    power = stretch_powers(errors, window)
    return power.mean(axis=0), np.median(power, axis=0) / math.log(2.0)


@lru_cache
def _autoregressions(length: int) -> tuple[Array, Array, Array]:
    """Frequencies [1/sample] of stretches of so many samples, their window, and the mean power of
    windowed noise of power 1, shape (memories, frequencies).

    The window is no small matter where noise remembers for a good part of it.
    """
    window = hann(length)
    frequency: Array = np.fft.rfftfreq(length).astype(float)
    lags = np.arange(length)
    overlap = np.correlate(window, window, "full")[length - 1 :]
    twice = np.where(lags > 0, 2.0, 1.0)
    covariance = NOISE_CORRELATIONS[:, None] ** lags * overlap * twice
    return frequency, window, covariance @ np.cos(2.0 * np.pi * np.outer(lags, frequency))
