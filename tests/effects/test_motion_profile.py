"""The trapezoid of a motion profile, against its closed form and against laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.core.types import Array
from servo_models.effects.motion_profile import motion_profile
from servo_models.effects.rate_limit import rate_limit
from tests.support.bench import held_bench, respond

RANDOM = np.random.default_rng(5)
IRREGULAR = np.concatenate([[0.0], np.cumsum(RANDOM.exponential(4e-3, 600))])


def profiled(velocity: float, acceleration: float, times: Array, goal: Array | float) -> Array:
    """What the effect makes of a goal."""
    values = {"effect.velocity": velocity, "effect.acceleration_time": velocity / acceleration}
    return respond(held_bench(motion_profile), values, times, goal)["signal"]


def from_rest(distance: float, velocity: float, acceleration: float, times: Array) -> Array:
    """Way of a trapezoid, or of a triangle where it is too short for one (e-manual, fig. 2)."""
    top = min(velocity, math.sqrt(acceleration * distance))
    rising = top / acceleration
    end = distance / top + rising
    t = np.clip(times, 0.0, end)
    up = 0.5 * acceleration * t**2
    along = 0.5 * top * rising + top * (t - rising)
    down = distance - 0.5 * acceleration * (end - t) ** 2
    return np.asarray(np.where(t < rising, up, np.where(t < end - rising, along, down)))


@settings(max_examples=60, deadline=None)
@given(
    distance=st.floats(1e-3, 3.0), velocity=st.floats(0.05, 20.0), acceleration=st.floats(0.5, 1e3)
)
def test_a_step_is_a_trapezoid_or_a_triangle(
    distance: float, velocity: float, acceleration: float
) -> None:
    for side in (1.0, -1.0):
        out = profiled(velocity, acceleration, IRREGULAR, side * distance)
        expected = side * from_rest(distance, velocity, acceleration, IRREGULAR)
        np.testing.assert_allclose(out, expected, atol=1e-7 * max(1.0, velocity))


def test_units_of_the_e_manual_give_its_acceleration_time() -> None:
    """It prints 64 ms times the ratio of its registers, of 0.229 rev/min and 214.577 rev/min2."""
    velocity, acceleration = 0.229 / 60.0, 214.577 / 3600.0
    assert velocity / acceleration == pytest.approx(0.064, rel=1e-3)


def test_a_goal_that_turns_is_followed_with_a_steady_velocity() -> None:
    """At 2 rad/s when the goal goes back: 0.2 s to a halt, 0.2 rad on, then back from rest."""
    velocity, acceleration = 2.0, 10.0
    times = 1e-3 * np.arange(3001)
    out = profiled(velocity, acceleration, times, np.where(times < 0.5 - 1e-9, 3.0, 0.0))
    at_turn = float(from_rest(3.0, velocity, acceleration, np.array([0.5]))[0])
    since = times - 0.5
    halting = at_turn + velocity * since - 0.5 * acceleration * since**2
    summit = at_turn + velocity**2 / (2.0 * acceleration)
    back = summit - from_rest(summit, velocity, acceleration, since - velocity / acceleration)
    turned = np.where(since < velocity / acceleration, halting, back)
    expected = np.where(since < 0.0, from_rest(3.0, velocity, acceleration, times), turned)
    np.testing.assert_allclose(out, expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_velocity_and_acceleration_keep_their_limits_and_the_goal_is_reached(seed: int) -> None:
    random = np.random.default_rng(seed)
    velocity, acceleration, step = 3.0, 25.0, 2e-3
    goals = np.append(np.repeat(random.uniform(-1.0, 1.0, 40), random.integers(1, 120, 40)), [0.4])
    goals = np.append(goals, np.full(1000, 0.4))
    out = profiled(velocity, acceleration, step * np.arange(len(goals)), goals)
    rates = np.diff(out) / step
    assert np.abs(rates).max() <= velocity * (1.0 + 1e-9)
    assert np.abs(np.diff(rates)).max() <= acceleration * step * (1.0 + 1e-6)
    assert out[-1] == 0.4


def test_it_does_not_depend_on_the_grid() -> None:
    """The fastest way from a point of the fastest way is the rest of it."""
    coarse, fine = 0.05 * np.arange(41), 1e-3 * np.arange(2001)
    goal = [np.where(times < 0.6 - 1e-9, 1.0, 0.2) for times in (coarse, fine)]
    np.testing.assert_allclose(
        profiled(1.5, 4.0, coarse, goal[0]), profiled(1.5, 4.0, fine, goal[1])[::50], atol=1e-9
    )


def test_without_an_acceleration_time_it_is_a_rate_limit_bit_for_bit() -> None:
    goals = np.repeat(RANDOM.uniform(-1.0, 1.0, 61), 10)[: len(IRREGULAR)]
    goals = np.resize(goals, len(IRREGULAR))
    limited = respond(held_bench(rate_limit), {"effect.rate": 4.0}, IRREGULAR, goals)["signal"]
    out = respond(held_bench(motion_profile), {"effect.velocity": 4.0}, IRREGULAR, goals)["signal"]
    np.testing.assert_array_equal(out, limited)
