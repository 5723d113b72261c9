"""Stamps that came late against the clock that was read; a host that reads late is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.core.simulate import model
from servo_models.core.types import Array
from servo_models.data.arrays import describe
from servo_models.data.clock import stamped_late
from servo_models.identification.check import check

PERIOD = 0.01  # [s] from one tick to the next
SEEDS = st.integers(0, 10_000)


def ticks(random: np.random.Generator, rows: str) -> Array:
    """Numbers of 1200 rows: all of them, some lost, or one to three apart."""
    steps = {
        "all": np.ones(1199),
        "lost": 1.0 + 4.0 * (random.random(1199) < 0.02),
        "uneven": random.choice([1.0, 2.0, 3.0], 1199),
    }
    return np.concatenate([[0.0], np.cumsum(steps[rows])])


def arrivals(random: np.random.Generator, rows: Array, mean: float) -> Array:
    """Times [s] at which messages of these ticks arrive, in order."""
    late = rows + random.exponential(mean, len(rows))
    return PERIOD * (np.maximum.accumulate(late - 0.02 * rows) + 0.02 * rows)


def motion(times: Array) -> Array:
    """An angle [rad] that never rests."""
    return np.asarray(np.sin(5.0 * times) + 0.4 * np.sin(17.0 * times + 1.0))


def readings(random: np.random.Generator, times: Array) -> Array:
    return motion(times) + 2e-3 * random.standard_normal(len(times))


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from(["all", "lost", "uneven"]), st.floats(0.15, 0.4))
def test_rows_that_arrive_late_are_put_back_on_the_clock_that_was_read(
    seed: int, rows: str, mean: float
) -> None:
    """All but a few: one that is later than the next tick may be taken for that one's."""
    random = np.random.default_rng(seed)
    truth = ticks(random, rows)
    stamps = arrivals(random, truth, mean)
    late = stamped_late(stamps - stamps[0], [readings(random, PERIOD * truth)])
    assert late is not None
    assert late.period == pytest.approx(PERIOD, rel=1e-4)
    off = late.times - PERIOD * truth
    off -= np.median(off)
    assert np.mean(np.abs(off) < 0.1 * PERIOD) > (0.98 if rows == "all" else 0.9)
    before = stamps - PERIOD * truth
    assert np.mean(np.abs(off)) < 0.6 * np.mean(np.abs(before - np.median(before)))


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from(["all", "lost", "uneven"]), st.floats(0.1, 0.4))
def test_a_host_that_wakes_late_and_reads_late_keeps_its_stamps(
    seed: int, rows: str, mean: float
) -> None:
    random = np.random.default_rng(seed)
    stamps = arrivals(random, ticks(random, rows), mean)
    assert stamped_late(stamps - stamps[0], [readings(random, stamps)]) is None


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(0.05, 0.5))
def test_a_clock_that_wanders_keeps_its_stamps(seed: int, jitter: float) -> None:
    """Each row is a step after the one before, not after a tick."""
    random = np.random.default_rng(seed)
    stamps = PERIOD * np.cumsum(1.0 + jitter * random.random(1200))
    assert stamped_late(stamps - stamps[0], [readings(random, stamps)]) is None


def test_readings_that_say_nothing_leave_stamps_as_they_are() -> None:
    random = np.random.default_rng(0)
    stamps = arrivals(random, np.arange(1200.0), 0.3)
    assert stamped_late(stamps - stamps[0], [random.standard_normal(1200)]) is None
    assert stamped_late(PERIOD * np.arange(1200.0), [random.standard_normal(1200)]) is None
    assert stamped_late(stamps[:12] - stamps[0], [random.standard_normal(12)]) is None


def test_check_tells_that_rows_are_stamped_late() -> None:
    random = np.random.default_rng(3)
    stamps = arrivals(random, np.arange(1200.0), 0.3)
    angle = readings(random, PERIOD * np.arange(1200.0))
    log = {"time": stamps, "goal": np.sin(3.0 * stamps), "angle": angle}
    found = describe(model("smart_servo"), {"arm": log}, {name: name for name in log})
    (read,) = found.logs
    assert np.ptp(np.diff(read.times)) < 1e-9
    told = str(check(found).document()["notes"])
    assert "an even clock of 10 ms and not over the stamps" in told
