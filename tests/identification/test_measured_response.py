"""Frequency responses of records, and curves of a page."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.signal import lfilter

from servo_models.analysis.sine_test import hold
from servo_models.core.types import Array
from servo_models.identification.measured_response import Record, empirical
from servo_models.identification.sections import beside
from servo_models.report.curves import envelope


def test_measured_frequency_response_of_a_known_filter() -> None:
    """y[k] = a y[k-1] + (1 - a) u[k-1] + noise; its response is known exactly."""
    random = np.random.default_rng(2)
    n, step, a = 40_000, 1e-3, 0.8
    given = random.standard_normal(n)
    clean = lfilter([0.0, 1.0 - a], [1.0, -a], given)
    record = Record(np.arange(n) * step, given, clean + 0.05 * random.standard_normal(n), clean)
    seen = empirical([record], step)
    assert seen is not None
    z = np.exp(2j * np.pi * seen.hertz * step)
    exact = (1.0 - a) / (z - a)
    assert len(seen.hertz) > 10
    assert np.abs(seen.simulated / exact - 1.0).max() < 0.1
    assert np.abs(seen.measured / exact - 1.0).max() < 0.4  # 20 % of noise in 9 windows
    assert np.median(np.abs(seen.measured / exact - 1.0)) < 0.1


def test_noise_has_no_frequency_response() -> None:
    random = np.random.default_rng(3)
    times = np.arange(5_000) * 1e-2
    points = 0
    for _ in range(20):
        seen = empirical([Record(times, *random.standard_normal((3, 5_000)))], 1e-2)
        points += 0 if seen is None else len(seen.hertz)
    assert points <= 4  # of some 20 x 500 frequencies, each by chance in 1 of 100 000


def test_records_of_other_steps_are_pooled_and_short_ones_left_out() -> None:
    random = np.random.default_rng(4)
    slow, fast = np.arange(8_000) * 2e-2, np.arange(16_000) * 1e-2
    u, v = np.repeat(random.standard_normal(2_000), 4), np.repeat(random.standard_normal(2_000), 8)
    pair = [Record(slow, u, 2.0 * u, 2.0 * u), Record(fast, v, 2.0 * v, 2.0 * v)]
    seen = empirical([*pair, Record(slow[:50], u[:50], -u[:50], u[:50])], 2e-2)
    assert seen is not None
    low = seen.hertz < 2.0
    assert np.abs(seen.measured[low] - 2.0).max() < 0.05
    assert empirical([Record(slow[:100], u[:100], u[:100], u[:100])], 2e-2) is None


def test_hold_is_the_fundamental_of_a_staircase() -> None:
    fine, points, step = 200, 16, 1e-2
    hertz = 1.0 / (points * step)
    sine = np.exp(2j * np.pi * np.arange(points) / points)
    stairs = np.repeat(sine, fine)
    phase = np.exp(-2j * np.pi * (np.arange(points * fine) + 0.5) / (points * fine))
    assert hold(np.array([2.0 * np.pi * hertz]), step)[0] == pytest.approx(
        np.mean(stairs * phase), abs=1e-4
    )


@given(st.floats(-1e3, 1e3), st.floats(-math.pi, math.pi))
def test_a_phase_stays_within_half_a_turn_of_its_reference(reference: float, angle: float) -> None:
    shown = float(beside(np.array([reference]), np.array([np.exp(1j * angle)]))[0])
    assert abs(shown - reference) <= 180.0 + 1e-6
    assert math.cos(math.radians(shown) - angle) == pytest.approx(1.0, abs=1e-9)


@given(arrays(float, st.integers(2, 3_000), elements=st.floats(-1e6, 1e6)), st.integers(2, 200))
def test_a_decimated_curve_keeps_extremes_ends_and_order(values: Array, buckets: int) -> None:
    times = np.arange(len(values), dtype=float)
    kept_times, kept = envelope(times, values, buckets)
    assert len(kept) <= 2 * buckets + 2
    assert np.all(np.diff(kept_times) > 0.0)
    assert np.array_equal(values[kept_times.astype(int)], kept)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert (kept_times[0], kept_times[-1]) == (times[0], times[-1])
