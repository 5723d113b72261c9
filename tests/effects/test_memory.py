"""Effects that remember: lag, rate limit, backlash, hysteresis, dead band, thermal drift."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal as scipy_signal

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.plant import place
from servo_models.core.types import Array
from servo_models.effects.backlash import backlash
from servo_models.effects.dead_band import dead_band
from servo_models.effects.hysteresis import hysteresis
from servo_models.effects.lag import lag
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.stiction import stiction
from servo_models.effects.thermal_drift import thermal_drift
from tests.support.bench import held_bench, respond, shaft_bench, sine_bench

IRREGULAR = np.concatenate([[0.0], np.cumsum(np.random.default_rng(3).exponential(3e-3, 100))])


@pytest.mark.parametrize("time_constant", [1e-5, 0.01, 1.0])
def test_lag_of_a_step_is_the_exponential(time_constant: float) -> None:
    out = respond(held_bench(lag), {"effect.time_constant": time_constant}, IRREGULAR, 1.0)
    expected = -np.expm1(-IRREGULAR / time_constant)
    np.testing.assert_allclose(out["signal"], expected, atol=1e-12)


def test_lag_of_a_moving_signal_is_scipy_s_ramp_invariant_one() -> None:
    times = 1e-3 * np.arange(1001)
    given = {"effect.time_constant": 0.05, "frequency": 30.0}
    out = respond(sine_bench(lag), given, times)
    _, expected, _ = scipy_signal.lsim(([1.0], [0.05, 1.0]), out["sine"], times, interp=True)
    np.testing.assert_allclose(out["signal"], expected, atol=1e-12)


def test_lag_of_a_sine_converges_with_the_square_of_the_step() -> None:
    tau, omega, times = 0.05, 30.0, np.linspace(0.0, 1.0, 51)
    turn = omega * tau
    transient = turn * np.exp(-times / tau)
    exact = transient + np.sin(omega * times) - turn * np.cos(omega * times)
    exact /= 1.0 + turn**2
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        given = {"effect.time_constant": tau, "frequency": omega}
        out = respond(sine_bench(lag, step), given, times)["signal"]
        errors.append(np.abs(out - exact).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 1.9) & (orders < 2.1))
    assert errors[-1] < 1e-4


def test_rate_limit_of_a_step_is_a_ramp() -> None:
    out = respond(held_bench(rate_limit), {"effect.rate": 4.0}, IRREGULAR, 0.7)["signal"]
    np.testing.assert_allclose(out, np.minimum(0.7, 4.0 * IRREGULAR), atol=1e-14)


def test_rate_limit_leaves_slower_signals_alone() -> None:
    given = {"effect.rate": 31.0, "frequency": 30.0}
    out = respond(sine_bench(rate_limit), given, IRREGULAR)
    np.testing.assert_array_equal(out["signal"], out["sine"])


def test_rate_limited_sine_becomes_the_triangle() -> None:
    """Far beyond the limit only the sign of the error counts: slope +/- rate everywhere."""
    rate, omega, times = 3.0, 40.0, 1e-3 * np.arange(2001)
    out = respond(sine_bench(rate_limit), {"effect.rate": rate, "frequency": omega}, times)
    slope = np.diff(out["signal"]) / 1e-3
    assert np.abs(slope).max() <= rate * (1 + 1e-9)
    assert np.mean(np.abs(slope) > 0.999 * rate) > 0.95
    late = out["signal"][-158:]
    assert late.max() - late.min() == pytest.approx(rate * math.pi / omega, rel=0.02)


def play(path: Array, half_width: float) -> Array:
    """The play operator (Krejci): the output is dragged by the nearer edge."""
    dragged = itertools.accumulate(
        path,
        lambda out, u: min(max(out, u - half_width), u + half_width),
        initial=0.0,
    )
    return np.array(list(dragged)[1:])


def test_backlash_is_the_play_operator() -> None:
    """On sin(30 t), against the operator on a path a hundred times as fine."""
    plant = shaft_bench(place("effect", backlash, "angle", "rate"), speed=30.0)
    times = 1e-3 * np.arange(1001)
    out = respond(plant, {"effect.half_width": 0.2, "spring": 900.0}, times)
    exact = play(np.sin(30.0 * 1e-5 * np.arange(100001)), 0.2)[::100]
    np.testing.assert_allclose(out["angle"], exact, atol=2e-6)
    moved = np.diff(out["angle"]) != 0.0
    resting, pushing = ~moved[1:] & ~moved[:-1], moved[1:] & moved[:-1]
    assert np.all(out["rate"][1:-1][resting] == 0.0)
    np.testing.assert_array_equal(out["rate"][1:-1][pushing], out["shaft_speed"][1:-1][pushing])


def test_dead_band_keeps_the_last_accepted_command() -> None:
    commands = np.array([0.0, 0.09, 0.11, 0.02, 0.0, 0.2, 0.11, 0.05, 0.3, 0.3, 0.0])
    kept = np.array([0.0, 0.0, 0.11, 0.11, 0.0, 0.2, 0.2, 0.05, 0.3, 0.3])
    times = np.arange(len(commands))
    plant = held_bench(dead_band, internal_step=1.0)
    out = respond(plant, {"effect.half_width": 0.1}, times, commands)["signal"]
    np.testing.assert_array_equal(out[1:], kept)


HYSTERESIS = {"effect.half_width": 0.2, "effect.turn": 0.25}


def loop(frequency: float, periods: int, per_period: int) -> tuple[Array, Array]:
    """Signal and output on the grid of internal steps; reversals lie on the grid."""
    step = 2.0 * math.pi / frequency / per_period
    times = step * np.arange(periods * per_period + 1)
    out = respond(sine_bench(hysteresis, step), {**HYSTERESIS, "frequency": frequency}, times)
    return out["sine"], out["signal"]


def test_hysteresis_loop_has_the_width_and_area_of_its_equation() -> None:
    """The periodic solution of dz/du = (sign du - z) / turn over -1 .. 1."""
    u, y = loop(10.0, 6, 400)
    reach = 2.0 / 0.25
    peak = math.tanh(0.5 * reach)
    falling, rising = slice(-300 - 1, -100), slice(-100 - 1, None)
    middle_up = y[rising][np.argmin(np.abs(u[rising]))]
    expected = 1.0 - (1.0 + peak) * math.exp(-1.0 / 0.25)
    assert middle_up == pytest.approx(-0.2 * expected, rel=1e-6)
    assert y[falling][np.argmin(np.abs(u[falling]))] == pytest.approx(0.2 * expected, rel=1e-6)
    area = -np.trapezoid(y[-401:], u[-401:])
    exact = 2.0 * 0.2 * (2.0 - (1.0 + peak) * 0.25 * -math.expm1(-reach))
    assert area == pytest.approx(exact, rel=1e-3)
    np.testing.assert_allclose(y[-401:-1], y[-801:-401], atol=1e-8)


def test_hysteresis_does_not_depend_on_the_rate() -> None:
    _, slow = loop(0.1, 3, 200)
    _, fast = loop(50.0, 3, 200)
    np.testing.assert_allclose(fast, slow, atol=1e-12)


def test_hysteresis_does_not_depend_on_the_step_between_reversals() -> None:
    _, coarse = loop(10.0, 3, 40)
    _, fine = loop(10.0, 3, 400)
    np.testing.assert_allclose(coarse, fine[::10], atol=1e-4)


def test_thermal_drift_warms_up_exponentially() -> None:
    times = np.linspace(0.0, 30.0, 301)
    given = {"effect.loss": 0.2, "effect.time_constant": 10.0, "effect.full_scale": 2.0}
    out = respond(held_bench(thermal_drift, internal_step=0.01), given, times, 1.5)["signal"]
    warmth = (1.5 / 2.0) ** 2 * -np.expm1(-times / 10.0)
    np.testing.assert_allclose(out, 1.5 * (1.0 - 0.2 * warmth), atol=1e-7)


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
