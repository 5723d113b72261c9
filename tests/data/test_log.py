"""A log as it is kept: clocks that only miss their grid by rounding."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.data.clock import regular


@settings(max_examples=60)
@given(
    st.integers(20, 3000),
    st.sampled_from([1e-3, 1.0 / 30.0, 2e-2, 0.0134]),
    st.floats(0.0, 1.0),
    st.integers(0, 99),
)
def test_rounded_times_go_back_to_their_grid(
    count: int, step: float, share: float, seed: int
) -> None:
    exact = step * np.arange(count)
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, count)
    noise[0] = 0.0
    found = regular(exact + 2e-4 * share * step * noise)
    np.testing.assert_allclose(found, exact, atol=1e-3 * step, rtol=0.0)
    assert np.ptp(np.diff(found)) <= 1e-9 * step or share == 0.0


def test_jittered_times_stay_as_they_are() -> None:
    times = np.cumsum(np.tile([0.013, 0.014, 0.013], 30))
    assert np.array_equal(regular(times), times)
