"""Effects that remember: lag, rate limit, backlash, hysteresis, dead band, thermal drift."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import signal as scipy_signal

from servo_models.core.plant import place
from servo_models.core.types import Array
from servo_models.effects.backlash import backlash
from servo_models.effects.dead_band import dead_band
from servo_models.effects.hysteresis import hysteresis
from servo_models.effects.lag import lag
from servo_models.effects.rate_limit import rate_limit
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
