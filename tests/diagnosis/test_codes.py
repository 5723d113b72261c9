"""What a code histogram tells: the step under the noise, and how loud the noise can be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from servo_models.core.types import Array
from servo_models.diagnosis.codes import Step, loudest, steps_under_noise

SEEDS = st.integers(0, 2**32 - 1)


def motion(count: int, size: float) -> Array:
    """An angle that goes there and back a few times and rests in between."""
    wave = np.sin(np.linspace(0.0, 17.0, count)) + 0.3 * np.sin(np.linspace(0.0, 41.0, count))
    return np.asarray(0.5 * size * np.clip(wave, -0.9, 1.1))


def noise(seed: int, count: int, memory: float) -> Array:
    fresh = np.random.default_rng(seed).standard_normal(count + 300)
    return np.asarray(lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], fresh))[300:]


def quantised(step: float, codes: float, share: float, seed: int, memory: float = 0.0) -> Array:
    """Codes of a motion over so many steps, under noise of this share of a step."""
    smooth = motion(3000, step * codes)
    return step * np.round(smooth / step) + share * step * noise(seed, 3000, memory)


@given(st.floats(1e-3, 1.0), st.floats(4.0, 60.0), st.floats(0.0, 0.12), SEEDS)
def test_codes_under_a_little_noise_show_their_step(
    step: float, codes: float, share: float, seed: int
) -> None:
    found = steps_under_noise([quantised(step, codes, share, seed)])
    assert min(abs(one.size / step - 1.0) for one in found) < 0.005


@pytest.mark.thorough
def test_the_error_of_a_step_is_that_of_the_line_through_its_codes() -> None:
    """Standard scores of many draws have a deviation of one; noise with a memory has been
    allowed for, so that of white noise is less."""
    for memory, low, high in ((0.0, 0.3, 0.6), (0.66, 0.7, 1.4)):
        scores = []
        for seed in range(200):
            records = [quantised(0.1, 12.0, 0.1, seed, memory)]
            best = min(steps_under_noise(records), key=lambda it: abs(it.size - 0.1))
            scores.append((best.size - 0.1) / best.error)
        assert low < math.sqrt(np.mean(np.square(scores))) < high


def test_a_step_is_shown_once_and_not_by_its_fractions() -> None:
    walk = np.cumsum(np.random.default_rng(1).standard_normal(4000))
    records = [5.0 * np.round(walk / 5.0), 5.0 * np.round(walk[:500] / 5.0)]
    found = np.array([one.size for one in steps_under_noise(records)])
    assert found[0] == pytest.approx(5.0, rel=1e-3)
    parts = 5.0 / found[1:]
    assert np.all(np.abs(parts - np.round(parts)) > 0.03 * np.round(parts))


def test_a_step_that_one_record_hardly_shows_is_sure_by_several_of_the_same_codes() -> None:
    """Each moves elsewhere and has noise of its own; what they share is the grid of codes."""
    alone, both = [], []
    for seed in range(20):
        smooth = (motion(600, 6.3) + 0.37, motion(600, 5.9) + 2.71)
        records = [
            np.round(it) + 0.26 * noise(2 * seed + k, 600, 0.0) for k, it in enumerate(smooth)
        ]
        alone += [any(is_one(it) for it in steps_under_noise([one])) for one in records]
        both.append(any(is_one(it) for it in steps_under_noise(records)))
    assert np.mean(both) > 0.9
    assert np.mean(alone) < 0.6


def is_one(step: Step) -> bool:
    return step.sure and abs(step.size - 1.0) < 0.02


def test_values_that_do_not_move_have_no_step_and_bound_no_noise() -> None:
    assert steps_under_noise([np.full(100, 2.0)]) == []
    assert loudest(np.full(100, 2.0), 0.0) == math.inf


@given(
    st.floats(2.0, 60.0), st.floats(0.02, 1.0), st.sampled_from([0.0, 0.5, 0.9]), SEEDS,
    st.booleans(),
)  # fmt: skip
def test_noise_is_never_louder_than_its_codes_allow(
    codes: float, share: float, memory: float, seed: int, stepped: bool
) -> None:
    """Whatever the motion: with steps of a quantiser in it or without, and however it rests."""
    if stepped:
        values = quantised(1.0, codes, share, seed, memory)
    else:
        values = motion(3000, codes) + share * noise(seed, 3000, memory)
    assert loudest(values, 0.0) > 0.9 * share


@pytest.mark.parametrize("memory", [0.0, 0.9])
@pytest.mark.parametrize("share", [0.03, 0.06, 0.12])
def test_sharp_codes_bound_the_noise_closely(share: float, memory: float) -> None:
    for seed in range(20):
        assert loudest(quantised(0.1, 20.0, share, seed, memory), 0.0) < 0.1 * (share + 0.04)


@pytest.mark.parametrize("digits", [0.02, 0.1])
def test_digits_of_the_reading_itself_bound_no_noise(digits: float) -> None:
    """They come after the noise, and are as sharp whatever it is."""
    values = motion(3000, 10.0) + 0.3 * noise(1, 3000, 0.5)
    written = digits * np.round(values / digits)
    assert loudest(written, digits) > 0.27
