"""Errors that follow the command, and noise that does not, both known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter, lfilter_zi
from scipy.stats import kstest

from servo_models.core.types import Array
from servo_models.diagnosis.residual_regression import (
    NOTHING_TESTED,
    LockedTest,
    Record,
    command_locked,
    filtered,
    functions_of,
    lagged,
    locked_test,
)
from tests.support.diagnoses import made

STEP = 1e-3
COUNT = 600
TIMES: Array = STEP * np.arange(float(COUNT))
DRAWS = 40


def coloured(random: np.random.Generator, memory: float) -> Array:
    """Autoregressive noise of power 1, long after its beginning."""
    fresh = random.normal(size=COUNT + 300)
    return np.asarray(lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], fresh)[300:])


def moved(random: np.random.Generator) -> tuple[Array, Array]:
    """Steps of all sizes and a chirp, and what two lags make of them."""
    places = np.sort(random.choice(COUNT // 2, 8, replace=False))
    command = random.uniform(-1.0, 1.0, 9)[np.searchsorted(places, np.arange(COUNT))]
    time = np.linspace(0.0, 1.0, COUNT // 2)
    command[COUNT // 2 :] = 0.5 * np.sin(2.0 * np.pi * (2.0 * time + 8.0 * time**2))
    return command, lag(lag(command))


def lag(signal: Array) -> Array:
    keep = math.exp(-1.0 / 8.0)
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], signal))


def record(errors: Array, command: Array, position: Array, log: int = 0) -> Record:
    """Errors of a fit of a gain and a delay."""
    functions = functions_of(TIMES, command, position)
    slopes = np.column_stack([position, np.gradient(position, STEP)])
    return Record(log, "angle", errors, functions, slopes)


def drag(position: Array, size: float) -> Array:
    """What a drag that grows with the square of the rate does to a position, and a fit of a gain
    and a delay leaves of it, RMS ``size``."""
    rate = np.gradient(position)
    done = lag(lag(rate * np.abs(rate)))
    fitted = np.column_stack([position, rate])
    left = done - fitted @ np.linalg.lstsq(fitted, done, rcond=None)[0]
    return np.asarray(size * left / np.sqrt(np.mean(left**2)))


@pytest.mark.thorough
@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_noise_is_called_locked_as_often_as_it_says(memory: float) -> None:
    values = []
    for seed in range(DRAWS):
        random = np.random.default_rng(seed)
        values.append(locked_test([record(coloured(random, memory), *moved(random))]).p_value)
    assert kstest(values, "uniform").pvalue > 0.01
    assert np.mean(np.array(values) <= 0.05) <= 0.15  # 2 of 40 expected, 7 or more once in 300


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_a_drag_as_large_as_the_noise_is_found(memory: float) -> None:
    for seed in range(5):
        random = np.random.default_rng(seed)
        records = []
        for log in range(2):
            command, position = moved(random)
            errors = coloured(random, memory) + drag(position, 1.0)
            records.append(record(errors, command, position, log))
        found = locked_test(records)
        assert found.p_value < 0.05
        assert 0.3 < found.explained < 1.0  # less than all of it, which no function here is


def test_the_strongest_function_is_that_of_the_errors() -> None:
    random = np.random.default_rng(1)
    command, position = moved(random)
    functions = functions_of(TIMES, command, position)
    for name in ("rate |rate|", "acceleration", "|position|"):
        errors = 0.3 * coloured(random, 0.0) + 2.0 * functions[name]
        assert locked_test([record(errors, command, position)]).strongest == name


def test_units_of_errors_and_signals_do_not_matter() -> None:
    random = np.random.default_rng(2)
    command, position = moved(random)
    errors = coloured(random, 0.5) + drag(position, 0.5)
    plain = locked_test([record(errors, command, position)])
    scaled = locked_test([record(1e3 * errors, 2.0 - 1e-3 * command, 50.0 * position + 7.0)])
    assert scaled.p_value == plain.p_value
    assert scaled.strongest == plain.strongest
    assert scaled.explained == pytest.approx(1e3 * plain.explained, rel=1e-6)
    assert scaled.share_explained == pytest.approx(plain.share_explained, rel=1e-6)


def test_what_parameters_can_do_is_nothing_new() -> None:
    """A gain that is a little off is no other physics, however large its errors are."""
    random = np.random.default_rng(3)
    command, position = moved(random)
    noise = coloured(random, 0.0)
    found = locked_test([record(noise + 0.5 * position, command, position)])
    assert found.explained < 0.2
    assert found.p_value > 0.05


def test_a_short_record_is_not_tested() -> None:
    random = np.random.default_rng(6)
    command, position = moved(random)
    whole = record(100.0 * position, command, position)
    functions = {name: function[:100] for name, function in whole.functions.items()}
    short = Record(0, "angle", whole.errors[:100], functions, whole.slopes[:100])
    assert locked_test([short]) == NOTHING_TESTED


def test_a_record_that_stands_still_says_nothing() -> None:
    noise = coloured(np.random.default_rng(4), 0.5)
    found = locked_test([record(noise, np.zeros(COUNT), np.zeros(COUNT))])
    assert (found.p_value, found.explained, found.share_explained) == (1.0, 0.0, 0.0)


def test_of_a_fitted_model() -> None:
    """Errors of a real fit: noise, and the same with what a friction leaves."""
    fitter, _ = made({"coulomb_friction.level": 1.5e-3})
    left = fitter.fit((), ())
    errors, slopes = left.evidence.errors, left.linearised.slopes[: left.problem.samples]
    noise = np.random.default_rng(5).normal(size=len(errors))
    assert command_locked(left.problem, left.values, errors, slopes).p_value < 0.02
    assert command_locked(left.problem, left.values, noise, slopes).p_value > 0.02


@pytest.mark.parametrize(
    ("p_value", "explained", "gap", "limit_cycle", "lacks"),
    [
        (0.002, 1.5, 5.0, 0.0, True),
        (0.2, 1.5, 5.0, 0.0, False),  # by chance
        (0.002, 0.4, 1.0, 0.0, False),  # a fifth of the noise
        (0.002, 0.6, 1.0, 0.0, True),  # three tenths of it
        (0.002, 0.9, 5.0, 0.0, False),  # less than a fifth of the gap
        (0.002, 1.5, 5.0, 1.4, False),  # what hunting does
    ],
)
def test_what_matters_is_sure_and_large(
    p_value: float, explained: float, gap: float, limit_cycle: float, lacks: bool
) -> None:
    test = LockedTest(p_value, explained, 0.1, "rate")
    assert test.matters(2.0, gap, limit_cycle) is lacks


@pytest.mark.parametrize("samples", [0.3, 8.0, 1e4])
def test_a_lagged_signal_is_that_of_a_filter_at_rest_before(samples: float) -> None:
    signal = 3.0 + np.random.default_rng(7).standard_normal(COUNT)
    keep = math.exp(-1.0 / samples)
    expected, _ = lfilter([1.0 - keep], [1.0, -keep], signal, zi=[keep * signal[0]])
    np.testing.assert_allclose(lagged(signal, samples), expected, rtol=1e-12)


def test_errors_are_whitened_as_by_a_filter_at_rest_before() -> None:
    weights, columns = np.array([1.0, -1.2, 0.5]), np.random.default_rng(8).normal(size=(COUNT, 3))
    rest = lfilter_zi(weights, [1.0])[:, None] * columns[:1]
    expected, _ = lfilter(weights, [1.0], columns, axis=0, zi=rest)
    np.testing.assert_allclose(filtered(weights, columns), expected, rtol=1e-12, atol=1e-12)
