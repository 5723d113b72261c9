"""Measures of a comparison against closed forms and hand-made curves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.analysis.compare import (
    delay_time,
    full_scale,
    max_error,
    nrmse,
    overshoot,
    rise_time,
    settling_time,
    step_metrics,
    time_to,
    tube,
)
from servo_models.errors import UserError

TIMES = np.linspace(0.0, 20.0, 20001)


def test_errors_are_relative_to_the_largest_absolute_reference() -> None:
    reference = [0.0, -4.0, 2.0, 0.0]
    assert full_scale(reference) == 4.0
    assert max_error(reference, [0.0, -4.0, 2.5, 0.0]) == 0.125
    assert nrmse(reference, [1.0, -3.0, 3.0, 1.0]) == 0.25


def test_an_error_against_nothing_is_infinite_not_hidden() -> None:
    assert max_error([0.0, 0.0], [0.0, 0.0]) == 0.0
    assert max_error([0.0, 0.0], [0.0, 1e-9]) == math.inf


def test_columns_of_different_length_are_refused() -> None:
    with pytest.raises(UserError, match="3 values for 2 points"):
        max_error([1.0, 2.0], [1.0, 2.0, 3.0])


def test_first_order_step_has_its_textbook_times() -> None:
    response = 3.0 + 2.0 * (1.0 - np.exp(-TIMES))
    found = step_metrics(TIMES, response, final=5.0)
    assert found.delay == pytest.approx(math.log(2.0), abs=1e-6)
    assert found.rise == pytest.approx(math.log(9.0), abs=1e-6)
    assert found.settling_2 == pytest.approx(math.log(50.0), abs=1e-6)
    assert found.settling_5 == pytest.approx(math.log(20.0), abs=1e-6)
    assert found.overshoot == 0.0


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.69])
@pytest.mark.parametrize("size", [1.0, -3.0])
def test_second_order_overshoot(damping: float, size: float) -> None:
    damped = math.sqrt(1.0 - damping**2)
    swing = np.cos(damped * TIMES) + damping / damped * np.sin(damped * TIMES)
    response = size * (1.0 - np.exp(-damping * TIMES) * swing)
    expected = math.exp(-math.pi * damping / damped)
    assert overshoot(TIMES, response, final=size) == pytest.approx(expected, abs=1e-6)


def test_a_late_step_is_measured_from_its_own_time() -> None:
    response = np.where(TIMES < 5.0, 0.0, 1.0 - np.exp(-(TIMES - 5.0)))
    assert delay_time(TIMES, response, at=5.0, final=1.0) == pytest.approx(math.log(2), abs=1e-6)
    assert time_to(TIMES, response, 0.5, final=1.0) == pytest.approx(5.0 + math.log(2), abs=1e-6)


def test_what_a_response_never_does_is_none() -> None:
    ringing = 1.0 + np.cos(TIMES)
    assert settling_time(TIMES, ringing, 0.05, final=1.0) is None
    assert rise_time(TIMES, 0.5 * (1.0 - np.exp(-TIMES)), final=1.0) is None
    still = step_metrics(TIMES, np.ones_like(TIMES))
    assert (still.delay, still.rise, still.overshoot, still.settling_2) == (None,) * 4


def test_settling_counts_the_last_excursion() -> None:
    times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    response = [0.0, 1.0, 1.0, 1.2, 1.0, 1.0]
    assert settling_time(times, response, 0.1) == pytest.approx(3.5)
    assert settling_time(times, response, 0.3) == pytest.approx(0.7)


def test_a_step_before_the_first_time_is_refused() -> None:
    with pytest.raises(UserError, match="before the first time"):
        delay_time([1.0, 2.0], [0.0, 1.0], at=0.5)


def test_tube_forgives_time_by_its_width_and_no_more() -> None:
    jump = np.where(TIMES < 10.0, 0.0, 1.0)
    for late, inside in ((0.009, True), (0.02, False)):
        response = (TIMES - late >= 10.0).astype(float)
        found = tube(TIMES, jump, response, time_width=0.01, amplitude=1e-9)
        assert bool(found.inside.all()) is inside
    assert found.outside_share == pytest.approx(0.009 * 1000 / 20001, rel=0.2)


def test_tube_forgives_amplitude_by_its_width_and_no_more() -> None:
    curve = np.sin(TIMES)
    assert tube(TIMES, curve, curve + 0.0099, 0.0, 0.01).inside.all()
    assert not tube(TIMES, curve, curve + 0.0101, 0.0, 0.01).inside.any()


def test_tube_takes_responses_on_times_of_their_own() -> None:
    own = np.linspace(0.05, 19.95, 777)
    assert tube(TIMES, np.sin(TIMES), np.sin(own), 0.0, 1e-6, at=own).inside.all()
    assert not tube(TIMES, np.sin(TIMES), np.sin(own + 0.3), 0.1, 1e-6, at=own).inside.all()


@given(
    st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=30),
    st.floats(0.0, 5.0),
    st.floats(0.0, 1.0),
)
def test_tube_bounds_equal_a_search_over_a_fine_grid(
    curve: list[float], width: float, amplitude: float
) -> None:
    times = np.arange(len(curve), dtype=float)
    found = tube(times, curve, curve, width, amplitude)
    assert found.inside.all()
    for k, time in enumerate(times):
        near = np.interp(np.linspace(time - width, time + width, 101), times, curve)
        assert found.lower[k] <= near.min() - amplitude + 1e-9
        assert found.upper[k] >= near.max() + amplitude - 1e-9
        reach = np.ceil(width)
        around = [c for t, c in zip(times, curve) if abs(t - time) <= reach]
        assert found.lower[k] >= min(around) - amplitude - 1e-9
        assert found.upper[k] <= max(around) + amplitude + 1e-9
