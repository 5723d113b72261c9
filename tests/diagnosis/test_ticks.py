"""Ticks of a hold at which commands are answered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.catalogue import model
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.ticks import Answers, answers
from servo_models.identification.problem import free_parameter
from tests.support.diagnoses import HOLD, _values, made, with_hold
from tests.support.logs import measured


def told(fitted: FittedModel) -> Answers:
    seen = answers(fitted, HOLD)
    assert seen
    return seen


@pytest.mark.parametrize("period", [1.7e-3, 2.43e-3, 4.1e-3])
def test_steps_before_a_hold_are_answered_on_its_ticks(period: float) -> None:
    found = told(with_hold({f"{HOLD}.period": period}, period))
    starts = 0.025 * np.arange(1, 6)
    assert found.due == pytest.approx(np.ceil(starts / period) * period - starts, abs=1e-12)
    assert found.late == pytest.approx(found.due, abs=0.08 * period)
    assert found.bunched > 0.97
    assert found.chance < 0.03  # of five steps there are 120 orders


def test_a_delay_before_the_hold_is_waited_for_first() -> None:
    truth = {f"{HOLD}.period": 4.1e-3, "transport_delay.time": 1.3e-3}
    fitter, every = made(truth, 2e-5)
    free = [*every[HOLD].free, *every["transport_delay"].free]
    values = {**_values(4.1e-3), "transport_delay.time": 1.3e-3}
    found = told(fitter.at_values((HOLD, "transport_delay"), free, values))
    assert found.late == pytest.approx(found.due, abs=0.3e-3)


@pytest.mark.parametrize(
    "truth", [{"transport_delay.time": 1.2e-3}, {"sensor_lag.time_constant": 1e-3}]
)
def test_what_makes_all_steps_late_alike_knows_no_clock(truth: dict[str, float]) -> None:
    """Of many periods a clock may fit by chance, as often as that is said to happen."""
    periods = 1e-3 * np.array([1.57, 1.83, 2.11, 2.43, 2.77, 3.19, 3.61, 4.13, 4.57, 5.21])
    found = [answers(with_hold(truth, period), HOLD) for period in periods]
    assert np.median([it.chance for it in found if it]) > 0.1


@pytest.mark.thorough
@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(4, 40))
def test_answers_at_any_time_are_hardly_ever_bunched(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    due, late = random.uniform(0.0, 1.0, (2, 100, count))
    chances = [Answers(HOLD, 1.0, *pair, np.ones(count)).chance for pair in zip(due, late)]
    assert np.mean(np.array(chances) < 0.05) <= 0.15  # 0.05 and four standard errors and a half


@given(st.integers(8, 60), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_steps_at_one_phase_of_a_clock_say_nothing_of_it(
    count: int, due: float, late: float
) -> None:
    """Whatever makes them late makes them all late alike."""
    one = np.ones(count)
    assert Answers(HOLD, 1.0, due * one, late * one, one).chance > 0.99


def test_without_steps_of_the_command_nothing_is_told() -> None:
    found = with_hold({f"{HOLD}.period": 2.43e-3}, 2.43e-3)
    (log,) = found.problem.logs
    late = slice(600, None)
    chirp = replace(
        log, times=log.times[:600], rows=log.rows[:600], held_out=log.held_out[:600],
        inputs={"voltage": log.inputs["voltage"][late]},
        outputs={"angle": log.outputs["angle"][late]},
    )  # fmt: skip
    problem = replace(found.problem, logs=[chirp])
    assert answers(replace(found, problem=problem), HOLD) is None


def test_a_hold_of_an_inner_signal_is_not_judged_by_commands() -> None:
    """The clock of a firmware holds the duty."""
    chosen = model("smart_servo")
    times = 5e-3 * np.arange(400.0)
    goal = {"goal": np.repeat([0.0, 0.2, -0.1, 0.3], 100)}
    fitter = Fitter(chosen, [measured(chosen, times, goal, {"angle": 0.0})], (), {"angle": 1e-3})
    hold = free_parameter(chosen.plant.parameters[f"{HOLD}.period"], 0.0, None)
    found = fitter.at_values((HOLD,), [hold], {hold.name: 0.02})
    assert answers(found, HOLD) is None
