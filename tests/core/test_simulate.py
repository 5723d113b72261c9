"""The in-process simulation: what it accepts, and that it does not depend on how it is called."""

from __future__ import annotations

import gc
import math
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.linalg import expm

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuators, model
from servo_models.core import simulate as simulation
from servo_models.core.c_text import c_run_text
from servo_models.core.plant import Actuator, Wire
from servo_models.core.types import Array
from servo_models.errors import UserError

STEP = 1e-3
TIMES = STEP * np.arange(201)
LINEAR = model("torque_motor", "measured", {"end_stops.half_range": 0.0})


def exact(voltage: Array) -> Array:
    """Current, angle and speed of Table 1 for a voltage held over each row of ``TIMES``."""
    k_t, k_b, r, h, j, k_f, k_s = 6.432, 0.08, 3630.0, 34.0, 7.246e-7, 2.7e-4, 1.1
    a = np.array(
        [[-r / h, 0.0, -k_b / h, 1.0 / h], [0, 0, 1, 0], [k_t / j, -k_s / j, -k_f / j, 0], [0] * 4]
    )
    step, state, out = expm(a * STEP), np.zeros(4), []
    for volts in voltage:
        out.append(state[:3])
        state = step @ np.array([*state[:3], volts])
    return np.array(out)


def test_linear_torque_motor_is_the_matrix_exponential() -> None:
    voltage = np.random.default_rng(5).uniform(-30.0, 30.0, len(TIMES))
    found = simulate(LINEAR, TIMES, {"voltage": voltage})
    for name, column in zip(("current", "angle", "rate"), exact(voltage).T):
        error = np.abs(found[name] - column).max()
        assert error < 1e-5 * np.abs(column).max(), name


def test_grid_refined_by_more_points_changes_only_rounding() -> None:
    """Communication points on the internal grid cut no sub-step anew."""
    fine = 1e-4 * np.arange(2001)
    voltage = np.where(fine < 0.0499999, 20.0, -10.0)
    coarse = simulate(LINEAR, fine[::10], {"voltage": voltage[::10]})
    dense = simulate(LINEAR, fine, {"voltage": voltage})
    np.testing.assert_allclose(dense["angle"][::10], coarse["angle"], atol=1e-13)


def test_equal_times_are_a_clean_step_of_the_inputs() -> None:
    doubled = np.array([0.0, 0.01, 0.01, 0.02])
    plain = np.array([0.0, 0.01, 0.02])
    one = simulate(LINEAR, doubled, {"voltage": [0.0, 0.0, 20.0, 20.0]})["angle"]
    other = simulate(LINEAR, plain, {"voltage": [0.0, 20.0, 20.0]})["angle"]
    assert one[[0, 1, 3]].tolist() == other.tolist()
    assert one[2] == one[1]


def test_runs_in_threads_do_not_disturb_each_other() -> None:
    levels = np.linspace(-30.0, 30.0, 24)
    alone = [simulate(LINEAR, TIMES, {"voltage": volts})["angle"] for volts in levels]
    with ThreadPoolExecutor(4) as pool:
        at_once = pool.map(lambda volts: simulate(LINEAR, TIMES, {"voltage": volts}), levels)
    assert all(np.array_equal(one["angle"], other) for one, other in zip(at_once, alone))


def test_threads_compile_a_plant_at_once(
    monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    """CPython 3.11 mixes up syntax trees of two threads that change within one, as here whenever
    garbage is collected."""
    plant = actuators()["torque_motor"].plant
    monkeypatch.setattr(simulation, "compiled_run", c_run_text)
    request.addfinalizer(partial(gc.set_threshold, *gc.get_threshold()))
    gc.set_threshold(100)
    gc.callbacks.append(lambda *_: time.sleep(1e-5))
    request.addfinalizer(gc.callbacks.pop)
    with ThreadPoolExecutor(2) as threads:
        texts = list(threads.map(simulation._compiled, [plant] * 2, ["in threads"] * 2))
    assert texts[0] == texts[1]


def test_one_time_gives_the_outputs_at_rest() -> None:
    found = simulate(model("sg90"), [0.0])
    assert found["angle"].tolist() == [0.0]
    assert found["feedback_voltage"][0] == pytest.approx(3.75)


def test_inputs_not_named_stay_at_rest_and_scalars_are_held() -> None:
    servo = model("sg90")
    one = simulate(servo, TIMES, {"pulse_width": 2e-3})
    other = simulate(
        servo,
        TIMES,
        {
            "pulse_width": np.full(len(TIMES), 2e-3),
            "load_torque": np.zeros(len(TIMES)),
            "supply_voltage": np.full(len(TIMES), 5.0),
        },
    )
    assert one["angle"].tolist() == other["angle"].tolist()
    assert one["supply_voltage"].tolist() == [5.0] * len(TIMES)


@pytest.mark.parametrize(
    ("actuator", "variant", "command", "size"),
    [
        ("linear_drive", "identified", "reference", 0.05),
        ("smart_servo", "xl330", "goal", 0.5),
        ("second_order_servo", "pulse", "pulse_width", 1.9e-3),
        ("dc_motor", "direct", "voltage", 12.0),
        ("dc_motor_speed", "direct", "speed_command", 50.0),
        ("sg90", "printed", "pulse_width", 1.9e-3),
        ("torque_motor", "identified", "voltage", 5.0),
    ],
)
def test_a_run_that_begins_before_zero_is_the_same_run(
    actuator: str, variant: str, command: str, size: float
) -> None:
    """As the log of a scope with its trigger inside; half a second is a whole number of ticks."""
    servo, times = model(actuator, variant), 1e-3 * np.arange(900)
    inputs = {command: np.where(times > 0.1, size, servo.plant.wire[command].rest)}
    later, sooner = (simulate(servo, times - shift, inputs) for shift in (0.0, 0.5))
    for name in servo.plant.outputs:
        scale = np.ptp(later[name]) or 1.0
        np.testing.assert_allclose(sooner[name], later[name], atol=1e-6 * scale)


def test_parameters_with_units() -> None:
    in_degrees = model("torque_motor", "measured", {"end_stops.half_range": "2 deg"})
    in_radians = model("torque_motor", "measured", {"end_stops.half_range": math.radians(2.0)})
    assert in_degrees.values == in_radians.values
    angle = simulate(in_degrees, TIMES, {"voltage": 50.0})["angle"]
    assert angle.max() == math.radians(2.0)


@pytest.mark.parametrize(
    ("actuator", "variant", "parameters", "words"),
    [
        ("sg91", None, {}, "unknown actuator 'sg91'; did you mean 'sg90'?"),
        ("sg90", "liner", {}, "unknown variant 'liner' in actuator 'sg90'; did you mean 'linear'?"),
        ("sg90", None, {"gear_ratoi": 3.0}, "did you mean 'gear_ratio'?"),
        ("sg90", None, {"gear_ratio": "3 V"}, "parameter 'gear_ratio': unit 'V'"),
        ("sg90", None, {"gear_ratio": -3.0}, "outside"),
        ("sg90", None, {"gear_ratio": math.nan}, "not a finite number"),
        ("sg90", None, {"sensor_lag.time_constant": "3 deg"}, "give a unit like s"),
    ],
)
def test_wrong_choices(
    actuator: str, variant: str | None, parameters: dict[str, float | str], words: str
) -> None:
    with pytest.raises(UserError) as caught:
        model(actuator, variant, parameters)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("times", "inputs", "words"),
    [
        ([], {}, "no communication points"),
        ([0.0, math.nan], {}, "time in row 1 is not finite"),
        ([0.0, 1.0, 0.5], {}, "time runs backward in row 2 (1 s, then 0.5 s)"),
        ([1e12, 1e12 + 1.0], {}, "too coarse for the internal step: subtract the first one"),
        ([0.0, 1.0], {"voltage": [0.0, math.inf]}, "input 'voltage' in row 1 is not finite"),
        ([0.0, 1.0], {"voltage": [0.0, 1.0, 2.0]}, "input 'voltage' has shape (3,)"),
        ([0.0, 1.0], {"volts": 1.0}, "did you mean 'voltage'?"),
    ],
)
def test_wrong_experiments(
    times: list[float], inputs: dict[str, float | list[float]], words: str
) -> None:
    with pytest.raises(UserError) as caught:
        simulate(LINEAR, times, inputs)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


SECONDS, VOLTS = "give seconds, shape (n,)", "give one number in V, or one for each time"


@pytest.mark.parametrize(
    ("times", "inputs", "words"),
    [
        (["a", "b"], {}, f"argument 'times' is not of numbers, but ['a', 'b']: {SECONDS}"),
        (["0", "1"], {}, f"argument 'times' is not of numbers, but ['0', '1']: {SECONDS}"),
        ([[0.0], [0.0, 1.0]], {}, "argument 'times' is not of numbers, but [[0.0], [0.0, 1.0]]"),
        ({"t": [0.0, 1.0]}, {}, "argument 'times' is not of numbers, but {'t': [0.0, 1.0]}"),
        ([0.0, 1j], {}, "argument 'times' is not of numbers, but [0.0, 1j]"),
        (np.array([0, 1], "timedelta64[ms]"), {}, "argument 'times' is not of numbers"),
        (np.zeros((3, 2)), {}, f"argument 'times' has shape (3, 2): {SECONDS}"),
        (np.ma.masked_greater([0.0, 9.0], 5.0), {}, "argument 'times' is masked in places: fill"),
        (
            range(2),
            {"voltage": ["a", "b"]},
            f"input 'voltage' is not of numbers, but ['a', 'b']: {VOLTS}",
        ),
        (range(2), {"voltage": "9 V"}, f"input 'voltage' is not of numbers, but '9 V': {VOLTS}"),
        (range(2), {"voltage": [[1.0], [1.0, 2.0]]}, "input 'voltage' is not of numbers"),
        (range(2), {"voltage": [1j, 0.0]}, "input 'voltage' is not of numbers, but [1j, 0.0]"),
        (
            range(2),
            {"voltage": [[1.0], [2.0]]},
            f"input 'voltage' has shape (2, 1), the times (2,): {VOLTS}",
        ),
        (
            range(2),
            [1.0, 2.0],
            "argument 'inputs' is no mapping, but [1.0, 2.0]: give {'voltage': ...}",
        ),
        (range(2), "voltage", "argument 'inputs' is no mapping, but 'voltage'"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused_with_its_cure(
    times: Any, inputs: Any, words: str
) -> None:
    with pytest.raises(UserError) as caught:
        simulate(LINEAR, times, inputs)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_name_is_no_model() -> None:
    named: Any = "sg90"
    with pytest.raises(UserError, match=r"argument 'chosen' is no model, but 'sg90': .* sm.model"):
        simulate(named, [0.0])


def test_numbers_are_taken_in_any_form() -> None:
    expected = simulate(LINEAR, np.array([0.0, 1.0]), {"voltage": np.array([1.0, 2.0])})["angle"]
    for times, volts in (
        (range(2), (1, 2)),
        (pl.Series([0.0, 1.0]), pl.Series([1, 2])),
        (np.array([0, 1], dtype=object), np.array([1, 2], dtype=np.uint8)),
        (np.ma.masked_array([0.0, 1.0]), np.ma.masked_array([1.0, 2.0])),
    ):
        np.testing.assert_array_equal(
            simulate(LINEAR, times, {"voltage": volts})["angle"], expected
        )


@pytest.mark.parametrize("step", [1e-15, 1e-200, 1e-320])
def test_a_run_that_is_over_at_once_is_at_rest(step: float) -> None:
    found = simulate(LINEAR, step * np.arange(3), {"voltage": 1.0})
    assert found["angle"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert found.warnings == ()


def test_a_run_that_explodes_says_where_and_what_to_do() -> None:
    """A spring that softens without bound, pushed over its top."""
    soft = model(
        "torque_motor",
        "measured",
        {"end_stops.half_range": 0.0, "stiffness_hardening.coefficient": -200.0},
    )
    with pytest.raises(UserError, match=r"state '.*' is not finite.* at t = "):
        simulate(soft, TIMES, {"voltage": 200.0})


def test_unknown_signal_of_a_result() -> None:
    with pytest.raises(UserError, match="did you mean 'angle'"):
        simulate(LINEAR, [0.0])["angel"]


FIVE_TIMES, TWENTIETH = 5.0, 0.05
"""A nominal value is an order of magnitude: how far a response may exceed it or stay below it."""


def rates(actuator: Actuator, variant: str) -> list[Wire]:
    """Outputs of an actuator that are rates; it may have none."""
    plant = actuator.plant_of(variant)
    return [wire for name in plant.outputs if "/s" in (wire := plant.wire[name]).unit]


@pytest.mark.parametrize(
    ("name", "variant"),
    [(a.name, v.name) for a in actuators().values() for v in a.variants if rates(a, v.name)],
)
def test_nominal_rates_are_those_of_a_step(name: str, variant: str) -> None:
    """The full scale of a rate is the nominal value that a master's tolerance is taken from."""
    chosen = model(name, variant)
    times = np.linspace(0.0, chosen.stop_time, 2001)
    command, size = chosen.actuator.step
    response = simulate(chosen, times, {command: size})
    for wire in rates(chosen.actuator, variant):
        if wire.name == "rate_reading":  # the range of a gyro
            continue
        peak = float(np.abs(response[wire.name]).max())
        assert TWENTIETH * wire.scale < peak < FIVE_TIMES * wire.scale, wire.name


def test_a_response_is_a_data_frame() -> None:
    times = np.arange(0.0, 0.1, 0.001)
    response = simulate(model("sg90"), times, {"pulse_width": 1.9e-3})
    frame = response.to_pandas()
    assert frame.index.name == "time"
    assert list(frame.columns) == [*response.inputs, *response.outputs]
    np.testing.assert_array_equal(frame["angle"], response["angle"])
    np.testing.assert_array_equal(frame.index, times)
