"""Stiction of a valve: against the published algorithm, written here as it is printed; its limits,
which are known in closed form; and what holds of any input."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.effects.stiction import stiction
from tests.support.bench import held_bench, respond, sine_bench

BAND, JUMP = 0.3, 0.4
TRIANGLE = np.abs((np.arange(400) * 0.0137 + 1.0) % 4.0 - 2.0) - 1.0
WALK = np.cumsum(np.random.default_rng(5).normal(0.0, 0.07, 2000))


def published(inputs: Iterable[float], band: float, jump: float) -> Array:
    """He et al. 2007, fig. 3: the force that is left accumulates from sample to sample.

    ``band`` is S and ``jump`` is J, both in units of the input; fs = (S + J) / 2, fd = (S - J) / 2.
    """
    static, kinetic = (band + jump) / 2.0, (band - jump) / 2.0
    left = valve = before = 0.0
    out = []
    for value in inputs:
        force = left + value - before
        if abs(force) > static:
            way = math.copysign(1.0, force)
            valve, left = valve + force - way * kinetic, way * kinetic
        else:
            left = force
        before = value
        out.append(valve)
    return np.array(out)


def on_samples(inputs: Array, internal_step: float, jump: float = JUMP) -> Array:
    """What the effect makes of each input, held for 10 ms."""
    times = 0.01 * np.arange(len(inputs) + 1)
    bench = held_bench(stiction, internal_step=internal_step)
    given_ = {"effect.band": BAND, "effect.jump": jump}
    return respond(bench, given_, times, np.append(inputs, 0.0))["signal"][1:]


@pytest.mark.parametrize("inputs", [TRIANGLE, WALK], ids=["triangle", "walk"])
@pytest.mark.parametrize("internal_step", [7e-4, 1.0])
@pytest.mark.parametrize("jump", [0.1, 0.4, 0.9])
def test_it_is_the_published_algorithm(inputs: Array, internal_step: float, jump: float) -> None:
    expected = published(inputs, BAND, jump * BAND)
    assert len(np.unique(expected)) > 5
    np.testing.assert_allclose(on_samples(inputs, internal_step, jump), expected, atol=1e-12)


def test_without_a_jump_it_is_the_play_operator() -> None:
    """Krejci: the output is dragged by the nearer edge."""
    half = 0.5 * BAND
    dragged = itertools.accumulate(
        WALK, lambda out, u: min(max(out, u - half), u + half), initial=0.0
    )
    np.testing.assert_array_equal(on_samples(WALK, 1e-3, jump=0.0), list(dragged)[1:])


def test_with_nothing_but_a_jump_the_last_accepted_input_is_kept() -> None:
    kept = itertools.accumulate(WALK, lambda out, u: u if abs(u - out) > BAND else out, initial=0.0)
    np.testing.assert_array_equal(on_samples(WALK, 1e-3, jump=1.0), list(kept)[1:])


@pytest.mark.parametrize("internal_step", [1e-3, 4e-3])
def test_of_a_moving_input_it_is_the_published_algorithm_on_fine_samples(
    internal_step: float,
) -> None:
    """A slip is found within 1/128 of the internal step; sampled at the steps it would be late by
    up to a whole one, each time."""
    times = 1e-2 * np.arange(101)
    given_ = {"effect.band": BAND, "effect.jump": JUMP, "frequency": 5.0}
    found = respond(sine_bench(stiction, internal_step), given_, times)
    exact = published(np.sin(5.0 * 1e-6 * np.arange(1_000_001)), BAND, JUMP * BAND)[::10_000]
    slips = np.count_nonzero(np.diff(exact))
    late = 5.0 * internal_step / 128.0 * slips
    unlike = np.abs(found["signal"] - exact) > late + 1e-5
    assert slips > 20
    assert np.count_nonzero(unlike) <= 1  # a sample just at a slip


lengths = st.floats(-10.0, 10.0, allow_subnormal=False)
bands, jumps = st.floats(1e-6, 5.0), st.floats(0.0, 1.0)
ROUNDING = 1e-13


@given(st.lists(lengths, min_size=1, max_size=30), bands, jumps)
def test_it_moves_only_if_it_must_and_is_never_farther_than_the_static_band(
    inputs: list[float], band: float, jump: float
) -> None:
    static, kinetic = 0.5 * (1.0 + jump) * band, 0.5 * (1.0 - jump) * band
    held = turned = 0.0
    for value in inputs:
        before = turned
        out, after, turned = stiction(value, band, jump, held, turned)
        assert out == after
        assert abs(value - out) <= static + ROUNDING
        if out != held:
            assert abs(value - held) > static - ROUNDING
            assert abs(abs(value - out) - kinetic) <= ROUNDING
        assert (turned != before) == (out != held)
        assert stiction(value, band, jump, after, turned) == (out, after, turned), "looked at again"
        held = after


@given(st.lists(lengths, min_size=1, max_size=30), bands, jumps)
def test_it_has_no_preferred_direction(inputs: list[float], band: float, jump: float) -> None:
    one = other = 0.0
    for value in inputs:
        _, one, _ = stiction(value, band, jump, one, 0.0)
        _, other, _ = stiction(-value, band, jump, other, 0.0)
        assert other == -one


@pytest.mark.parametrize(
    ("actuator", "variant", "command", "scale"),
    [("torque_motor", "measured", "voltage", 10.0), ("second_order_servo", "bus", "goal", 0.5)],
)
def test_a_command_within_the_static_band_moves_no_actuator(
    actuator: str, variant: str, command: str, scale: float
) -> None:
    """S = 1 and J = 0.4 of the scale: it holds at 0.69 and slips at 0.71, up to 0.3 before it."""
    sticking = {"stiction.band": scale, "stiction.jump": 0.4}
    times = np.linspace(0.0, 1.0, 201)
    rest, moved, bare = (
        simulate(model(actuator, variant, values), times, {command: share * scale})["angle"]
        for values, share in ((sticking, 0.69), (sticking, 0.71), ({}, 0.41))
    )
    assert not np.any(rest)
    np.testing.assert_allclose(moved[-1], bare[-1], rtol=1e-6)
