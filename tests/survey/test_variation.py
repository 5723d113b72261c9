"""Means and splits of variance against closed forms, outliers against draws with none."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.errors import UserError
from servo_models.survey.variation import MOST_UNITS, outlying, pooled, split, told
from tests.support.made_outcomes import estimate

FIGURES = st.floats(-5.0, 5.0)


@given(FIGURES, FIGURES, st.floats(0.1, 3.0), st.floats(0.5, 5.0))
def test_what_logs_tell_gives_the_estimate_with_its_prior_again(
    value: float, nominal: float, error: float, prior: float
) -> None:
    """The product of two normal densities, of the logs and of the prior."""
    precision = error**-2 + prior**-2
    both = (value / error**2 + nominal / prior**2) / precision
    found = told(estimate("x", both, precision**-0.5, nominal, prior))
    if precision**-0.5 > 0.5 * prior:
        assert found is None
    else:
        assert found == pytest.approx((value, error), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("error", [None, 0.0, np.inf])
def test_without_an_error_no_value_is_told(error: float | None) -> None:
    assert told(estimate("x", 1.0, error)) is None


@given(st.lists(FIGURES, min_size=2, max_size=9), st.floats(0.01, 3.0))
def test_the_mean_of_values_of_equal_errors(values: list[float], error: float) -> None:
    """Their plain mean, and what their variance is more than the squared error."""
    found = pooled(np.array(values), np.full(len(values), error))
    between = max(np.var(values, ddof=1) - error**2, 0.0)
    assert found.mean == pytest.approx(np.mean(values), abs=1e-9)
    assert found.between**2 == pytest.approx(between, rel=1e-6, abs=1e-9)
    assert found.error**2 == pytest.approx((between + error**2) / len(values), rel=1e-6)


@given(FIGURES, st.floats(0.01, 3.0))
def test_one_value_is_its_mean_and_has_no_variation(value: float, error: float) -> None:
    found = pooled(np.array([value]), np.array([error]))
    assert (found.between, found.count) == (0.0, 1)
    assert (found.mean, found.error) == pytest.approx((value, error))


def test_values_alike_are_weighted_by_their_errors() -> None:
    found = pooled(np.array([1.0, 1.5]), np.array([0.5, 1.0]))
    assert (found.mean, found.between) == (pytest.approx(1.1), 0.0)


def test_the_unit_that_stands_out_is_told_and_left_out() -> None:
    values = np.array([*np.random.default_rng(1).normal(1.0, 0.1, 11), 3.0])
    common, far = outlying(values, np.full(12, 0.05))
    assert far == [11]
    assert common == pooled(values[:11], np.full(11, 0.05))


def test_noise_makes_hardly_any_unit_stand_out() -> None:
    random = np.random.default_rng(2)
    false = [
        bool(outlying(random.normal(1.0, 0.1, n), np.full(n, 0.03))[1])
        for n in (3, 6, 12, 30)
        for _ in range(100)
    ]
    assert np.mean(false) <= 0.03


@pytest.mark.parametrize(("units", "episodes"), [(3, 2), (6, 5), (30, 3)])
@pytest.mark.parametrize("between", [0.02, 1.0])
def test_the_split_of_a_balanced_survey_is_that_of_its_mean_squares(
    units: int, episodes: int, between: float
) -> None:
    """Searle, Casella, McCulloch, Variance Components (1992), sec. 4.3."""
    random = np.random.default_rng(units)
    values = between * random.normal(size=(units, 1)) + random.normal(size=(units, episodes))
    outer = episodes * np.var(values.mean(axis=1), ddof=1)
    inner = np.mean(np.var(values, axis=1, ddof=1))
    whole = np.var(values, ddof=1)
    expected = (max(outer - inner, 0.0) / episodes, inner if outer > inner else whole)
    names = np.repeat([f"u{k}" for k in range(units)], episodes).tolist()
    found = split(names, 1e-3 * values.ravel(), np.full(values.size, 4e-4))
    assert found is not None
    assert found.unit == pytest.approx(1e-6 * expected[0], rel=1e-3, abs=1e-9)
    assert found.episode + found.rest == pytest.approx(1e-6 * expected[1], rel=1e-3)
    assert found.rest == pytest.approx(1.6e-7)
    assert sum(found.shares) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("step", "error", "shares"),
    [
        (0.1, 9.0, [0.99, 0.0, 0.01]),  # no more is explained by errors than there is
        (0.0, 0.1, [1.0, 0.0, 0.0]),  # of which there is no likelihood
    ],
)
def test_a_split_at_its_ends(step: float, error: float, shares: list[float]) -> None:
    """Variances within are half a squared step, between units 0.5 less half of that."""
    values = np.array([1.0, 1.0 + step, 2.0, 2.0 + step])
    found = split(["a", "a", "b", "b"], values, np.full(4, error))
    assert found is not None
    assert found.shares == pytest.approx(shares, abs=1e-4)


@pytest.mark.parametrize("names", [["a", "b", "c"], ["a", "a", "a"]])
def test_nothing_is_split_where_unit_and_episode_are_one(names: list[str]) -> None:
    assert split(names, np.array([1.0, 2.0, 4.0]), np.ones(3)) is None


def test_many_units_are_picked_evenly() -> None:
    n = 4 * MOST_UNITS
    names = [f"u{k:04}" for k in range(n) for _ in range(2)]
    values = np.repeat(np.arange(n) % 2, 2) + np.tile([0.0, 0.1], n)
    found = split(names, values, np.full(2 * n, 0.01))
    assert found is not None
    assert found.unit == pytest.approx(0.25, rel=0.1)


def test_without_its_library_the_split_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "statsmodels", None)
    monkeypatch.setitem(sys.modules, "statsmodels.regression.mixed_linear_model", None)
    with pytest.raises(UserError, match=r"servo-models\[survey\]"):
        split(["a"], np.ones(1), np.ones(1))
