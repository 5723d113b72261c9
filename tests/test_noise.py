"""Noise in residuals: whether it is white, what the input left in it, how many samples count."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim
from scipy.stats import binom

from servo_models.noise import dependence, inflation, whiteness


def test_residual_tests_reject_noise_at_their_nominal_rate() -> None:
    u = np.sign(np.sin(np.arange(1000) / 20.0))
    runs, level = 400, 0.05
    for test in (whiteness, lambda e: dependence(e, u)):
        false = sum(
            test(np.random.default_rng(k).standard_normal(1000)) < level for k in range(runs)
        )
        assert false <= binom.ppf(1.0 - 1e-4, runs, level)
    assert sum(
        whiteness(np.random.default_rng(k).standard_normal(1000)) < level for k in range(runs)
    ) >= binom.ppf(1e-4, runs, level)


def test_residual_tests_see_correlation_and_what_the_input_left() -> None:
    rng = np.random.default_rng(0)
    u = np.sign(np.sin(np.arange(2000) / 20.0))
    white = rng.standard_normal(2000)
    coloured = lsim(([1.0], [1.0, 0.2]), white, np.arange(2000), interp=False)[1]
    assert whiteness(coloured) < 1e-6
    assert dependence(coloured, u) > 1e-3
    assert dependence(white + 0.3 * np.roll(u, 3), u) < 1e-6


def test_correlated_noise_counts_as_fewer_samples() -> None:
    """An AR(1) process of correlation r has (1 + r) / (1 - r) samples to each independent one."""
    rng, r = np.random.default_rng(1), 0.8
    noise = np.zeros(20000)
    for k in range(1, len(noise)):
        noise[k] = r * noise[k - 1] + rng.standard_normal()
    assert inflation(noise) == pytest.approx((1.0 + r) / (1.0 - r), rel=0.25)
