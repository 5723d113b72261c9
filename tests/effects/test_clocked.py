"""Delay and sample-and-hold, whose instants need not be communication points."""

from __future__ import annotations

from typing import Annotated

import numpy as np
import pytest

from servo_models.core.block import Block, Param, block
from servo_models.core.flatten import flatten
from servo_models.core.plant import Plant, State, Wire, place
from servo_models.effects.sample_hold import sample_hold
from servo_models.effects.transport_delay import EDGES, transport_delay
from tests.support.bench import held_bench, held_signal, respond, sine_bench, step_constant


@block("filtered_rate")
def first_order(
    signal: float, filtered: float, time_constant: Annotated[float, Param("s", "", default=0.02)]
) -> float:
    """time_constant x' + x = signal."""
    return (signal - filtered) / time_constant


@block("signal")
def clock_signal(clock: float) -> float:
    """The time, as a state."""
    return clock


@block("clock_rate")
def one(internal_step: float) -> float:
    """Slope of the time."""
    return 1.0 + 0.0 * internal_step


def filtered_bench(effect: Block) -> Plant:
    """The held input through the effect into a first-order filter."""
    return Plant(
        inputs=(Wire("u", "1", "input"),),
        wires=(Wire("signal", "1", "signal under test"),),
        chain=(held_signal, place("effect", effect, "signal"), first_order),
        states=(State(Wire("filtered", "1", "filtered"), "filtered_rate"),),
        outputs=("filtered",),
        constants=step_constant(1e-3),
    )


def clock_bench(effect: Block) -> Plant:
    """The time through the effect: a sample tells when it was taken."""
    return Plant(
        inputs=(Wire("u", "1", "not used"),),
        wires=(Wire("signal", "1", "signal under test"),),
        chain=(clock_signal, place("effect", effect, "signal"), one),
        states=(State(Wire("clock", "s", "time"), "clock_rate"),),
        outputs=("signal",),
        constants=step_constant(1e-3),
    )


@pytest.mark.parametrize("delay", [0.0004, 0.0011, 0.003, 0.0123456])
@pytest.mark.parametrize("step", [1e-3, 7e-4, 4.1e-3])
def test_delayed_step_is_the_shifted_exact_response(delay: float, step: float) -> None:
    times = np.arange(0.0, 0.1, step)
    out = respond(
        filtered_bench(transport_delay), {"effect.time": delay}, times, np.ones_like(times)
    )
    since = np.maximum(times - delay, 0.0)
    np.testing.assert_allclose(out["filtered"], 1.0 - np.exp(-since / 0.02), atol=1e-8)


def test_every_change_comes_out_after_the_delay() -> None:
    """Changes at irregular points, many at once in the line, more than the line has slots."""
    random, delay = np.random.default_rng(1), 0.0377
    times = np.cumsum(random.exponential(2e-4, 3 * EDGES))
    inputs = random.normal(size=len(times))
    out = respond(held_bench(transport_delay), {"effect.time": delay}, times, inputs)["signal"]
    row = np.searchsorted(times, times - delay, side="right") - 1
    np.testing.assert_array_equal(out, np.where(row >= 0, inputs[row], 0.0))


def test_a_full_delay_line_stops_the_run_and_says_why() -> None:
    plant = held_bench(transport_delay)
    times = 1e-4 * np.arange(EDGES + 2)
    inputs = np.arange(1.0, len(times) + 1.0)
    respond(plant, {"effect.time": 0.2}, times[:EDGES], inputs[:EDGES])
    with pytest.raises(RuntimeError, match="-1"):
        respond(plant, {"effect.time": 0.2}, times, inputs)
    assert "delay line is full" in flatten(plant, "full").faults[0][2]


@pytest.mark.parametrize("step", [1e-3, 2e-3, 5e-3])
def test_frames_of_20_ms_stay_at_absolute_time_when_the_master_s_clock_rounds(step: float) -> None:
    """Sums of 1 ms drift by rounding; the input that starts at a tick is the one sampled."""
    per_frame = round(0.02 / step)
    times = np.concatenate([[0.0], np.cumsum(np.full(1000 * per_frame, step))])
    assert not np.array_equal(times, step * np.arange(len(times)))
    inputs = np.arange(1.0, len(times) + 1.0)
    out = respond(held_bench(sample_hold), {"effect.period": 0.02}, times, inputs)["signal"]
    frame = (np.arange(1, len(times)) - 1) // per_frame
    np.testing.assert_array_equal(out[1:], inputs[frame * per_frame])


def test_a_moving_signal_is_sampled_at_the_tick_itself() -> None:
    period, times = 0.0137, np.linspace(0.0, 1.0, 181)
    out = respond(sine_bench(sample_hold), {"effect.period": period, "frequency": 20.0}, times)[
        "signal"
    ]
    expected = np.sin(20.0 * period * np.floor(times / period))
    np.testing.assert_allclose(out, expected, atol=1e-6)


def test_ticks_on_the_grid_of_sub_steps_are_not_missed_by_rounding() -> None:
    """Ticks every 3 ms, sub-steps every 1 ms, communication every 10 ms: none exact in binary."""
    times = np.concatenate([[0.0], np.cumsum(np.full(2000, 1e-2))])
    out = respond(clock_bench(sample_hold), {"effect.period": 3e-3}, times)["signal"]
    before = (10 * np.arange(1, len(times)) - 1) // 3
    np.testing.assert_allclose(out[1:], 3e-3 * before, atol=1e-8)


def park_miller(count: int, seed: int = 20260) -> list[float]:
    """The minimal standard generator in integers (CACM 31, 1192)."""
    drawn = []
    for _ in range(count):
        seed = 16807 * seed % (2**31 - 1)
        drawn.append(seed / (2**31 - 1))
    return drawn


@pytest.mark.parametrize("jitter", [0.0, 0.3, 0.9])
def test_jitter_makes_each_tick_late_by_its_random_number(jitter: float) -> None:
    period, frames = 0.02, 400
    times = np.arange(0.0, frames * period, 7.3e-3)
    given = {"effect.period": period, "effect.jitter": jitter}
    out = respond(clock_bench(sample_hold), given, times)["signal"]
    ticks = [0.0, *((k + 1 + jitter * r) * period for k, r in enumerate(park_miller(frames)))]
    expected = [max(tick for tick in ticks if tick < t - 1e-9) for t in times[1:]]
    np.testing.assert_allclose(out[1:], expected, atol=1e-9)
    np.testing.assert_array_equal(out, respond(clock_bench(sample_hold), given, times)["signal"])


@pytest.mark.parametrize("period", [1e-9, 1e-300])
def test_a_frame_too_short_to_see_passes_the_signal(period: float) -> None:
    times = np.linspace(0.0, 0.01, 11)
    out = respond(held_bench(sample_hold), {"effect.period": period}, times, times)["signal"]
    np.testing.assert_array_equal(out[1:], times[:-1])
