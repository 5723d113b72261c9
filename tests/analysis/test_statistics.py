"""Noise in residuals: whether it is white, what the input left in it, how many samples count."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.signal import lfilter, lfiltic, lsim, welch
from scipy.stats import binom

from servo_models.analysis.statistics import (
    autocovariance,
    cross_correlation,
    dependence,
    hann,
    inflation,
    recursion,
    scatter,
    stretch_powers,
    whiteness,
)
from servo_models.core.types import Array


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


def test_an_echo_of_the_input_shows_at_its_lag_beyond_the_bounds() -> None:
    white, u = np.random.default_rng(3).standard_normal((2, 3000))
    errors = white + 0.5 * np.roll(u, 7)
    both, deviation = cross_correlation(errors, u, 40)
    centred = u - u.mean()
    whole = np.correlate(errors, centred, "full")[2999:3040]
    size = np.linalg.norm(errors) * np.linalg.norm(centred)
    np.testing.assert_allclose(both, whole / size, atol=1e-12)
    assert np.argmax(np.abs(both)) == 7
    assert deviation == pytest.approx(1.0 / np.sqrt(3000), rel=0.1)  # of two white signals
    assert cross_correlation(errors, np.ones(3000), 40)[1] == 0.0


SEEN = np.arange(2200) % 44 < 22  # stretches of 22 samples, with as many held out between them


def test_residual_tests_keep_their_nominal_rate_across_samples_held_out() -> None:
    """What stands at samples that are not seen is nobody's business, infinite errors too."""
    runs, level = 400, 0.05
    noise = [np.random.default_rng(k).standard_normal(len(SEEN)) for k in range(runs)]
    white = [np.where(SEEN, e, np.inf) for e in noise]
    found = sum(whiteness(e, SEEN) < level for e in white)
    assert binom.ppf(1e-4, runs, level) <= found <= binom.ppf(1.0 - 1e-4, runs, level)


def test_residual_tests_count_time_across_samples_held_out() -> None:
    """Neighbours of two stretches are 23 samples apart, not one."""
    rng, seen = np.random.default_rng(0), np.tile(SEEN, 4)
    white = rng.standard_normal(len(seen))
    assert whiteness(white + 0.9 * np.roll(white, 20), seen) < 1e-6


@pytest.mark.parametrize("held_out", [slice(0, 0), slice(0, 300), slice(1700, None)])
def test_a_record_seen_in_one_stretch_is_that_stretch(held_out: slice) -> None:
    errors = np.random.default_rng(2).standard_normal(2200)
    errors += np.roll(errors, 1)
    seen = np.ones(len(errors), dtype=bool)
    seen[held_out] = False
    assert whiteness(errors, seen) == whiteness(errors[seen])


def test_correlated_noise_counts_as_fewer_samples() -> None:
    """An AR(1) process of correlation r has (1 + r) / (1 - r) samples to each independent one."""
    rng, r = np.random.default_rng(1), 0.8
    noise = np.zeros(20000)
    for k in range(1, len(noise)):
        noise[k] = r * noise[k - 1] + rng.standard_normal()
    assert inflation(noise) == pytest.approx((1.0 + r) / (1.0 - r), rel=0.25)


@pytest.mark.parametrize("lags", [1, 7, 50])
def test_the_scatter_of_slopes_is_their_product_with_the_whole_covariance(lags: int) -> None:
    rng = np.random.default_rng(3)
    slopes, covariance = rng.standard_normal((50, 3)), rng.standard_normal(lags)
    whole = toeplitz(np.concatenate([covariance, np.zeros(50 - lags)]))
    np.testing.assert_allclose(scatter(slopes, covariance), slopes.T @ whole @ slopes, rtol=1e-9)


@pytest.mark.parametrize("denominator", [[1.0, -0.95], [1.0, -1.98, 0.985], [1.0, 0.3, -0.5, 0.1]])
def test_a_recursion_is_the_free_response_of_a_filter(denominator: list[float]) -> None:
    order = len(denominator) - 1
    first = np.random.default_rng(4).standard_normal(order)
    memory = lfiltic([1.0], denominator, first[::-1])
    after, _ = lfilter([1.0], denominator, np.zeros(500), zi=memory)
    found = recursion(-np.array(denominator[1:]), first, 500 + order)
    np.testing.assert_allclose(found, [*first, *after], rtol=1e-9, atol=1e-12)


def smooth(n: int) -> Array:
    return np.asarray(np.sin(np.arange(n) / 50.0) + np.sin(np.arange(n) / 33.0) ** 3)


@pytest.mark.parametrize("poles", [[0.6], [0.99 * np.exp(0.1j), 0.99 * np.exp(-0.1j)], [0.9] * 3])
def test_an_autocovariance_is_that_of_the_best_autoregression(poles: list[complex]) -> None:
    """Here each order is solved by itself, and its equation run on as a filter."""
    n, lags = 4000, 20
    noise = np.random.default_rng(5).standard_normal(n)
    errors = lfilter([1.0], np.poly(poles).real, noise) + 0.1 * smooth(n)
    r = np.array([errors[k:] @ errors[: n - k] for k in range(lags + 1)]) / n
    fits = [(0.0, np.zeros(0))]
    for order in range(1, lags + 1):
        phi = solve_toeplitz(r[:order], r[1 : order + 1])
        left = 1.0 - phi @ r[1 : order + 1] / r[0]
        fits.append((n * np.log(left) + order * np.log(n), phi))
    phi = min(fits, key=lambda fit: fit[0])[1]
    found = autocovariance(errors)
    order = len(phi)
    memory = lfiltic([1.0], [1.0, *-phi], r[order:0:-1])
    after, _ = lfilter([1.0], [1.0, *-phi], np.zeros(len(found)), zi=memory)
    expected = [*r[: order + 1], *after]
    np.testing.assert_allclose(found, expected[: len(found)], rtol=0.0, atol=1e-9 * r[0])
    assert np.all(np.abs(expected[len(found) :]) <= 1e-3 * r[0])


@pytest.mark.parametrize("length", [16, 47, 48, 1000])
def test_stretches_have_the_power_of_welch(length: int) -> None:
    """Whose density has both signs of a frequency."""
    values, window = np.random.default_rng(6).standard_normal(1000), hann(length)
    overlap = length - length // 2
    _, density = welch(values, window=window, noverlap=overlap, detrend=False)
    density[1 : (length + 1) // 2] /= 2.0
    np.testing.assert_allclose(stretch_powers(values, window).mean(axis=0), density, rtol=1e-9)
