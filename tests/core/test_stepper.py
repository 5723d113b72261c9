"""The contract of a step, on the smallest plants that show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.catalogue import actuators
from servo_models.core.block import Block, Clock, Fault, Memory, Mode, Param, block
from servo_models.core.compiled import plain_make
from servo_models.core.flat import neutral_effects, trouble
from servo_models.core.flatten import flatten
from servo_models.core.plant import Plant, State, Wire
from servo_models.core.stepper import run_text, step_text
from servo_models.effects import effects
from servo_models.effects.sample_hold import sample_hold
from servo_models.validation.plain_integration import integrate
from tests.support.bench import held_bench, respond, step_constant

H = 1e-3


def small_plant(
    *chain: Block, states: Sequence[State] = (), outputs: Sequence[str], step: float = H
) -> Plant:
    return Plant(
        inputs=(Wire("u", "1", "input"),),
        wires=(),
        chain=chain,
        states=tuple(states),
        outputs=tuple(outputs),
        constants=step_constant(step),
    )


def stepper_of(plant: Plant) -> tuple[list[float], Any]:
    """State at rest and the step function, all parameters at their default."""
    flat = flatten(plant, "small")
    vector = [p.param.default for p in plant.parameters.values()]
    start, step = plain_make(step_text(flat, neutral_effects(flat, vector)))(vector)
    return start(), step


# Point 4 is point 0 of the next sub-step.

remembering = [
    pytest.param(found, id=found.name)
    for blocks in effects().values()
    for found in blocks
    if found.memory
]


@pytest.mark.thorough
@pytest.mark.parametrize("effect", remembering)
@settings(max_examples=80, deadline=None, derandomize=True)
@given(data=st.data())
def test_output_after_commit_is_output_before(effect: Block, data: st.DataObject) -> None:
    """output(commit(m, x, dt), x, 0) == output(m, x, dt), so point 0 may be skipped."""
    arguments: dict[str, Any] = {name: data.draw(st.floats(-2, 2), name) for name in effect.wires}
    if "elapsed" in arguments:
        arguments["elapsed"] = data.draw(st.floats(1e-9, 0.01))
    if "now" in arguments:
        arguments["due"] = arguments["now"] + 1e-9
    for name, param in effect.params.items():
        value = data.draw(st.floats(param.low, param.high), name)
        arguments[name] = value if abs(value) > 1e-9 else 0.0  # not lost in rounding
    for name in effect.memory:
        arguments[name] = 0.0 if effect.queues else data.draw(st.floats(0.0, 1.0), name)
    arguments |= {name: [0.0] * queue.size for name, queue in effect.queues.items()}
    wires = len(effect.acts_on)
    at_the_end = effect(**arguments)
    arguments |= dict(zip(effect.memory, at_the_end[wires:]))
    again = effect(**{**arguments, **({"elapsed": 0.0} if "elapsed" in arguments else {})})
    assert again[:wires] == at_the_end[:wires]


# A plant without states.


@block("doubled")
def doubling(u: float) -> float:
    """Answers at once."""
    return 2.0 * u


def test_a_plant_may_have_no_states() -> None:
    flat = flatten(small_plant(doubling, outputs=("doubled",)), "gain")
    scope: dict[str, Any] = {}
    exec(run_text(flat), scope)
    inputs, out = np.array([[1.0], [3.0], [5.0]]), np.empty((3, 1))
    times = np.array([0.0, 3.0 * H, 3.0 * H])
    assert scope["run"](np.array([H]), np.zeros(flat.size), times, inputs, out)[0] == 0
    assert out.ravel().tolist() == [2.0, 2.0, 6.0]


# Sub-steps.


@block("count", "total")
def sub_steps(
    elapsed: float, u: float, steps: Annotated[float, Memory()], time: Annotated[float, Memory()]
) -> tuple[float, float, float, float]:
    """Counts commits at ends of sub-steps and adds their lengths."""
    if elapsed > 0.0:
        steps = steps + 1.0
    return steps, time + elapsed, steps, time + elapsed


@pytest.mark.parametrize(
    ("size", "expected"),
    [(H, 1), (3 * H, 3), (0.7 * H, 1), (2.5 * H, 3), (0.1 + 0.2, 300), (1.0, 1000)],
)
def test_a_step_is_cut_into_the_fewest_equal_sub_steps(size: float, expected: int) -> None:
    x, step = stepper_of(small_plant(sub_steps, outputs=("count", "total")))
    code, (count, total) = step(x, [0.0], 0.0, size)
    assert code == 0
    assert count == expected
    assert total == pytest.approx(size, rel=1e-12)


@block("moved")
def rising(u: float, input_age: float) -> float:
    """An input that goes on rising by 1 per second after it was set."""
    return u + input_age


def test_the_age_of_an_input_counts_from_the_communication_point() -> None:
    """Across sub-steps, and in the Runge-Kutta stages: the integral of a line is exact."""
    sum_of_it = State(Wire("sum", "1", "integral"), rate="moved")
    plant = small_plant(rising, states=[sum_of_it], outputs=("moved", "sum"))
    times, inputs = np.array([0.0, 0.7 * H, 5.7 * H, 25.2 * H]), np.array([3.0, -1.0, 2.0, 0.0])
    sizes = np.diff(times)
    sums = np.cumsum([0.0, *(inputs[:-1] * sizes + 0.5 * sizes * sizes)])
    exact = np.column_stack([[3.0, *(inputs[:-1] + sizes)], sums])

    scope: dict[str, Any] = {}
    exec(run_text(flatten(plant, "small")), scope)
    x, out = np.zeros(len(plant.states)), np.empty((4, 2))
    assert scope["run"](np.array([H]), x, times, inputs[:, None], out)[0] == 0
    np.testing.assert_allclose(out, exact, rtol=1e-12, atol=1e-15)

    x, step = stepper_of(plant)
    for begin, size, u, expected in zip(times, sizes, inputs, exact[1:]):
        code, found = step(x, [u], begin, size)
        assert code == 0
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)
    plain = integrate(plant, {"internal_step": H}, times, inputs[:, None], finer=1)
    np.testing.assert_allclose(plain.outputs[plain.rows], exact, rtol=1e-12, atol=1e-15)


@block("ticks", "tick")
def metronome(
    due: float,
    u: float,
    period: Annotated[float, Param("s", "", default=0.0137, high=1.0)],
    beats: Annotated[float, Memory()],
    next_beat: Annotated[float, Clock()],
) -> tuple[float, float, float, float]:
    """Counts its ticks, the one at time 0 included."""
    if due >= next_beat:
        beats = beats + 1.0
        next_beat = (math.floor(due / period) + 1.0) * period
    return beats, next_beat, beats, next_beat


def test_a_sub_step_ends_at_a_tick() -> None:
    """Ten sub-steps, three of them cut in two by ticks at 1.37, 2.74 and so on."""
    plant = small_plant(metronome, sub_steps, outputs=("ticks", "tick", "count", "total"))
    x, step = stepper_of(plant)
    _, (ticks, tick, count, total) = step(x, [0.0], 0.0, 0.05)
    assert (ticks, tick) == (4.0, pytest.approx(4 * 0.0137))
    assert count == 50 + 3
    assert total == pytest.approx(0.05, rel=1e-12)


def test_ticks_on_the_grid_cost_no_sub_step() -> None:
    """Every tick is a sub-step's end, but for rounding."""
    chain = (replace(metronome, params={"period": Param("s", "", default=3e-3)}), sub_steps)
    x, step = stepper_of(small_plant(*chain, outputs=("count",)))
    for k in range(100):
        _, (count,) = step(x, [0.0], 0.01 * k, 0.01)
        assert count == 10 * (k + 1)


@pytest.mark.parametrize("early", [0.0, 0.5e-6 * H, -0.5e-6 * H])
def test_a_tick_at_a_communication_point_takes_the_new_input(early: float) -> None:
    times = np.array([0.0, 0.02 + early, 0.03])
    out = respond(held_bench(sample_hold), {"effect.period": 0.02}, times, [1.0, 2.0, 3.0])
    assert out["signal"].tolist() == [1.0, 1.0, 2.0]


def test_a_step_of_size_0_only_looks() -> None:
    plant = small_plant(sub_steps, metronome, outputs=("count", "total", "ticks"))
    x, step = stepper_of(plant)
    _, before = step(x, [0.0], 0.0, 0.05)
    kept = list(x)
    assert step(x, [0.0], 0.05, 0.0) == (0, before)
    assert x == kept


# The method.


@block("height_rate")
def logistic(height: float, growth: Annotated[float, Param("1/s", "", default=1.0)]) -> float:
    """x' = x (1 - x)."""
    return growth * height * (1.0 - height)


def height(start: float) -> tuple[State, ...]:
    return (State(Wire("height", "1", "state"), "height_rate", start=start),)


def test_smooth_plants_converge_with_the_fourth_power() -> None:
    times = np.linspace(0.0, 4.0, 5)
    exact = 1.0 / (1.0 + 9.0 * np.exp(-times))
    errors = []
    for step in (0.2, 0.1, 0.05):
        plant = small_plant(logistic, states=height(0.1), outputs=("height",), step=step)
        errors.append(np.abs(respond(plant, {}, times)["height"] - exact).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all((orders > 3.7) & (orders < 4.5))


@block("height_rate")
def kinked(height: float, elapsed: float, above: Annotated[float, Mode()]) -> tuple[float, float]:
    """Slope 1 below 0.5, 0.25 above."""
    here = 1.0 if height >= 0.5 else 0.0
    if elapsed <= 0.0:
        above = here
    return 0.25 if above > 0.0 else 1.0, here


def test_a_jump_of_the_slope_is_located() -> None:
    """Sub-steps of 30 ms: across the jump the error would be up to 22 ms of slope."""
    times = np.linspace(0.0, 1.0, 8)
    plant = small_plant(kinked, states=height(0.0), outputs=("height",), step=0.03)
    exact = np.where(times < 0.5, times, 0.5 + 0.25 * (times - 0.5))
    out = respond(plant, {}, times)["height"]
    np.testing.assert_allclose(out, exact, atol=0.75 * 0.03 / 128)


@block("height_rate")
def attracted(
    height: float, elapsed: float, above: Annotated[float, Mode()]
) -> tuple[float, float]:
    """Slope -1 above 0.5 and 1 below: no solution leaves 0.5."""
    here = 1.0 if height >= 0.5 else 0.0
    if elapsed <= 0.0:
        above = here
    return -1.0 if above > 0.0 else 1.0, here


def test_sliding_along_a_jump_ends_and_stays_near_it() -> None:
    plant = small_plant(attracted, states=height(0.0), outputs=("height",))
    out = respond(plant, {}, np.linspace(0.0, 1.0, 101))["height"]
    assert np.abs(out[51:] - 0.5).max() <= H


# Trouble.


@block("height_rate")
def explosive(height: float) -> float:
    """x' = x^2, which leaves every bound at t = 1 / x(0)."""
    return height * height


def test_a_state_that_is_not_finite_is_named() -> None:
    other = State(Wire("calm", "1", "state"), "calm_rate")
    plant = small_plant(explosive, calm, states=(other, *height(1.0)), outputs=("height",))
    flat = flatten(plant, "explosive")
    with pytest.raises(RuntimeError) as caught:
        respond(plant, {}, np.linspace(0.0, 3.0, 31))
    assert caught.value.args == (2,)
    assert "'height' is not finite" in trouble(flat, 2)


@block("calm_rate")
def calm(u: float) -> float:
    """A slope of 0."""
    return 0.0 * u


@block("checked")
def check_low(u: float, low: Annotated[float, Fault(message="too low")]) -> tuple[float, float]:
    """Complains below -1."""
    return u, 1.0 if u < -1.0 else low


@block("checked_too")
def check_high(u: float, high: Annotated[float, Fault(message="too high")]) -> tuple[float, float]:
    """Complains above 1."""
    return u, 1.0 if u > 1.0 else high


@pytest.mark.parametrize(("u", "code", "words"), [(-2.0, -1, "too low"), (2.0, -2, "too high")])
def test_a_fault_stops_the_run_in_its_own_words(u: float, code: int, words: str) -> None:
    plant = small_plant(check_low, check_high, outputs=("checked",))
    with pytest.raises(RuntimeError) as caught:
        respond(plant, {}, [0.0, 1.0, 2.0], [0.0, u, 0.0])
    assert caught.value.args == (code,)
    assert words in trouble(flatten(plant, "faulty"), code)


# The text.


def test_a_dropped_effect_leaves_nothing_to_run() -> None:
    for actuator in actuators().values():
        flat = flatten(actuator.plant, actuator.name)
        step = step_text(flat, set(flat.switches)).split("def _step")[1]
        own = [name for name, owner in flat.memory if owner]
        assert own
        assert not [name for name in own if name in step]
