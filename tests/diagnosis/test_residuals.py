"""What is noise and what is not, on errors of which both parts are known."""

from __future__ import annotations

import gc
import math
import weakref
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.sensor import difference_noise
from servo_models.diagnosis.search.crossval import CrossValidation
from servo_models.diagnosis.search.residuals import (
    LOUDEST_NOISE_IN_FLOORS,
    Residuals,
    residuals_of,
    sure,
    unmodelled,
)
from servo_models.identification.problem import Problem
from tests.support.diagnoses import made
from tests.support.logs import log_of

DRAWS = 60


def split(
    errors: Array, floor: float = 1.0, step: float = 0.0, reading: Array | None = None
) -> Residuals:
    """Split errors [noise floors] of a reading with a floor and a reading step [SI]."""
    n = len(errors)
    if reading is None:
        reading = np.random.default_rng(0).normal(size=n) * 20.0 * floor
    if step:
        reading = step * np.round(reading / step)
    times = np.linspace(0.0, 1e-3 * n, n)
    log = log_of(times, {"voltage": np.zeros(n)}, {"angle": reading})
    problem = Problem(model("torque_motor"), [log], [], {"angle": floor})
    return residuals_of(
        problem, CrossValidation(np.empty(0), errors, errors, np.zeros(n, dtype=np.int64))
    )


def coloured(seed: int, count: int, memory: float, size: float = 1.0) -> Array:
    """Autoregressive noise of this RMS, long after its beginning."""
    fresh = np.random.default_rng(seed).normal(size=count + 500)
    noise = lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], fresh)
    return np.asarray(size * noise[500:])


def motion(count: int) -> Array:
    """Speed of something that is moved by a sine that grows faster."""
    turns = 6.0 * (np.arange(count) / count) ** 2
    return np.asarray(np.cos(2.0 * np.pi * turns))


def burst(count: int) -> Array:
    """Something that comes once and goes."""
    inside = np.abs(np.arange(count) - 0.6 * count) < 0.06 * count
    return np.where(inside, 1.0, 0.0)


def of_size(part: Array, size: float) -> Array:
    return np.asarray(part * size / math.sqrt(np.mean(part**2)))


PARTS: dict[str, Callable[[int], Array]] = {
    "dry friction left out": lambda n: np.sign(motion(n)),
    "a square law left out": lambda n: motion(n) * np.abs(motion(n)),
    "a burst": burst,
    "a line": lambda n: np.sin(2.0 * np.pi * 0.02 * np.arange(n)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("memory", [0.0, 0.9])
@pytest.mark.parametrize(("count", "size"), [(100, 20.0), (300, 12.0), (1500, 12.0), (1500, 20.0)])
def test_errors_louder_than_the_audit_allows_are_no_noise(
    memory: float, count: int, size: float
) -> None:
    """A quantiser in a loop, left out: the simulated response hunts, the measured one does not."""
    found = [split(coloured(k, count, memory, size)) for k in range(DRAWS)]
    assert sum(unmodelled(one, one.total) for one in found) > 0.9 * DRAWS
    assert np.median([one.structured for one in found]) > 0.75 * size


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_steps_of_a_quantiser_left_out_are_no_noise(memory: float) -> None:
    """They are as fast as noise, but codes stay sharp.  The same errors without codes are noise."""
    smooth, step, loud = 60.0 * motion(1500), 12.0, 1.0
    for seed in range(10):
        heard = loud * coloured(seed, 1500, memory)
        stairs = step * np.round(smooth / step) - smooth
        errors = heard + stairs
        found = split(errors, reading=smooth + errors)
        assert found.structured == pytest.approx(math.sqrt(np.mean(stairs**2)), rel=0.15)
        assert unmodelled(found, found.total)
        as_loud = coloured(seed, 1500, 0.0, 3.0)
        plain = split(as_loud, reading=smooth + as_loud)
        assert not unmodelled(plain, plain.total)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9, 0.95])
def test_audited_floor_is_a_seventh_of_noise_or_more(memory: float) -> None:
    """What bounds the noise is what the audit sees of it beside a motion."""
    for seed in range(DRAWS):
        reading = coloured(seed, 400, memory) + 20.0 * motion(400)
        assert difference_noise(reading) > 1.0 / LOUDEST_NOISE_IN_FLOORS


@pytest.mark.thorough
@pytest.mark.parametrize(("memory", "share"), [(0.0, 0.05), (0.5, 0.05), (0.7, 0.05), (0.9, 0.1)])
@pytest.mark.parametrize("count", [300, 1500])
def test_noise_of_any_colour_is_not_structured(memory: float, share: float, count: int) -> None:
    """Noise that remembers for ten samples is hard to tell from motion in a single record."""
    found = [split(coloured(k, count, memory, 3.0)) for k in range(DRAWS)]
    assert sum(unmodelled(one, one.total) for one in found) <= share * DRAWS


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_noise_is_estimated_without_bias_beside_what_is_structured(memory: float) -> None:
    part = of_size(PARTS["a square law left out"](1500), 4.0)
    found = [split(part + coloured(k, 1500, memory, 2.0)) for k in range(DRAWS)]
    assert np.median([one.noise for one in found]) == pytest.approx(2.0, rel=0.08)
    assert np.median([one.structured for one in found]) == pytest.approx(4.0, rel=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize("name", list(PARTS))
@pytest.mark.parametrize(("memory", "size"), [(0.0, 0.7), (0.6, 1.2)])
def test_what_a_model_lacks_is_found(name: str, memory: float, size: float) -> None:
    """Power of 90 % at 0.7 times white and 1.2 times coloured noise, in 1000 samples."""
    part = of_size(PARTS[name](1000), 2.0 * size)
    found = [split(part + coloured(k, 1000, memory, 2.0)) for k in range(DRAWS)]
    assert sum(unmodelled(one, one.total) for one in found) >= 0.9 * DRAWS


@pytest.mark.thorough
@pytest.mark.parametrize("name", list(PARTS))
@pytest.mark.parametrize("memory", [0.0, 0.7])
def test_the_bound_is_below_the_truth_in_most_cases(name: str, memory: float) -> None:
    """95 % in the large; of 60 cases 9 or more above the truth would be 1 in 200."""
    part = of_size(PARTS[name](1000), 3.0)
    found = [split(part + coloured(k, 1000, memory, 2.0)) for k in range(DRAWS)]
    assert sum(one.least > 3.0 for one in found) <= 8


def test_a_reading_step_is_noise_that_is_known() -> None:
    """Coloured noise under white noise of a step would pass for noise without a memory."""
    step = 3.0
    noise = math.sqrt(3.0**2 + step**2 / 12.0)
    known, unknown = [], []
    for k in range(DRAWS):
        exact = coloured(k, 1500, 0.8, 3.0) + 100.0 * motion(1500)
        errors = step * np.round(exact / step) - 100.0 * motion(1500)
        known.append(split(errors, step=step).noise)
        unknown.append(split(errors).noise)
    assert np.median(known) == pytest.approx(noise, rel=0.1)
    assert abs(np.median(unknown) - noise) > 2.0 * abs(np.median(known) - noise)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.9), st.floats(0.0, 5.0), st.floats(0.01, 1.0))
def test_figures_scale_with_errors_and_their_squares_add_up(
    seed: int, memory: float, size: float, scale: float
) -> None:
    """Smaller ones: larger ones would be too loud for noise."""
    errors = coloured(seed, 400, memory, 3.0) + size * motion(400)
    one, scaled = split(errors), split(-scale * errors)
    assert scaled.total == pytest.approx(scale * one.total)
    assert scaled.structured == pytest.approx(scale * one.structured, abs=1e-6 * scale)
    assert scaled.least == pytest.approx(scale * one.least, abs=1e-6 * scale)
    assert 0.0 <= one.least <= one.structured <= one.total
    if one.structured > 0.0 and one.noise > 1.0:
        assert math.hypot(one.structured, one.noise) == pytest.approx(one.total)


def test_no_errors_and_short_records_have_nothing_structured() -> None:
    assert split(np.zeros(500)) == Residuals(0.0, 0.0, 1.0, 0.0)
    short = split(5.0 * motion(100))
    assert short.structured == short.least == 0.0
    assert short.total == short.noise


positive = st.floats(0.0, 100.0)


@given(positive, positive, st.floats(1.0, 10.0), positive, st.floats(1.0, 3.0))
def test_the_more_is_left_the_more_is_missing(
    structured: float, share: float, noise: float, gap: float, more: float
) -> None:
    left = Residuals(structured, min(share, 1.0) * structured, noise, math.hypot(structured, noise))
    larger = replace(left, structured=more * structured, least=more * left.least)
    assert unmodelled(larger, gap) >= unmodelled(left, gap)
    assert unmodelled(left, gap) >= unmodelled(left, more * gap)
    assert not unmodelled(replace(left, least=0.0), gap)
    # many effects imitate anything: whatever they surely leave is missing, and nothing else is
    assert unmodelled(left, gap, 3) == unmodelled(left, 0.0, 1) == sure(left)
    assert unmodelled(left, gap, 2) == unmodelled(left, gap)


def test_what_is_remembered_of_a_log_does_not_keep_it_alive() -> None:
    fitter, _ = made({})
    one = fitter.unfitted()
    gone = weakref.ref(fitter.logs[0])
    assert one.left.total > 0.0
    del fitter, one
    gc.collect()
    assert gone() is None
