"""The curves of a residual map against numpy's interpolation, and the map against effects that it
can imitate."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import Model, with_output
from servo_models.core.types import Array
from servo_models.data.arrays import describe
from servo_models.data.log import Start
from servo_models.effects.residual_map import CURVES, KNOTS, curve, time_since_reversal
from servo_models.identification.check import check
from servo_models.identification.fit import fit
from tests.support.logs import changed, measured

value = st.floats(-1.0, 1.0)
number = st.floats(-50.0, 50.0)


@given(st.lists(value, min_size=KNOTS, max_size=KNOTS), number, st.floats(0.1, 20.0), number)
def test_a_curve_is_the_interpolation_and_held_at_its_ends(
    knots: list[float], low: float, width: float, x: float
) -> None:
    found, beyond = curve(0.5, x, 1.0, low, low + width, *knots, 0.0)
    places = np.linspace(low, low + width, KNOTS)
    scale = 1.0 + abs(x - low) / width  # of the distances that cancel far outside
    assert found == pytest.approx(0.5 + np.interp(x, places, knots), abs=1e-13 * KNOTS * scale)
    if min(abs(x - low), abs(x - low - width)) > 1e-5 * width:
        assert beyond == float(not low <= x <= low + width)


def test_a_curve_has_its_own_parameters_at_each_place() -> None:
    own = _of("rate", low=0.0, high=8.0)
    assert CURVES["rate"](0.0, 2.0, rate=1.0, rate_beyond=0.0, **own) == (0.25, 0.0)
    assert "knot_1" not in CURVES["rate"].params


def _of(key: str, low: float, high: float) -> dict[str, float]:
    values = {f"{key}_knot_{k + 1}": k / 8.0 for k in range(KNOTS)}
    return {f"{key}_low": low, f"{key}_high": high, **values}


def test_time_counts_from_each_turn() -> None:
    lasted = direction = 0.0
    seen = []
    for speed in (0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 1.0):
        signed, lasted, direction = time_since_reversal(0.0, speed, 0.1, 1.0, lasted, direction)
        seen.append(signed)
    assert seen == pytest.approx([0.0, 0.0, 0.1, 0.2, -0.0, -0.1, 0.0])


@pytest.mark.parametrize("step", [2e-4, 1e-3])
def test_a_turn_is_located_whatever_the_internal_step(step: float) -> None:
    """Against the zeros of the rate, from a run with many samples."""
    values = {"internal_step": step, "residual_map.reversal": 1.0, "residual_map.torque": 1e-9}
    servo = with_output(model("sg90", None, values), "since_reversal")
    times = np.arange(0.0, 1.2, 1e-4)
    pulses = 1.5e-3 + 2e-4 * np.sin(2.0 * np.pi * 2.0 * times)
    found = simulate(servo, times, {"pulse_width": pulses})
    rate, since = found["rate"], found["since_reversal"]
    k = np.flatnonzero(rate[:-1] * rate[1:] < 0.0)
    turns = times[k] + 1e-4 * rate[k] / (rate[k] - rate[k + 1])
    assert len(turns) >= 4
    for begin, end in itertools.pairwise(turns):
        own = (times > begin + 1e-3) & (times < end - 1e-3)
        way = np.sign(np.mean(rate[own]))
        np.testing.assert_allclose(since[own], way * (times[own] - begin), atol=2e-5)


TIMES = np.linspace(0.0, 1.0, 401)
STEPS = np.where(TIMES > 0.5, 1.2e-3, np.where(TIMES > 0.1, 1.9e-3, 1.5e-3))


def response(**values: float) -> Array:
    servo = model("sg90")
    changed = {name.replace("__", "."): value for name, value in values.items()}
    return _run(replace(servo, values={**servo.values, **changed}))


def _run(servo: Model) -> Array:
    return np.asarray(simulate(servo, TIMES, {"pulse_width": STEPS})["angle"])


def flat(key: str, level: float) -> dict[str, float]:
    return {f"residual_map__{key}_knot_{k + 1}": level for k in range(KNOTS)}


def test_a_level_curve_on_the_torque_is_a_constant_load() -> None:
    torque = {"residual_map__torque": 0.04, "residual_map__position": 1.0}
    mapped = response(**torque, **flat("position", 0.5))
    assert mapped == pytest.approx(response(constant_load__torque=0.02), abs=1e-9)
    assert np.abs(mapped - response()).max() > 1e-3


def test_a_straight_curve_of_the_rate_is_a_viscous_friction() -> None:
    servo = model("sg90")
    full = 14.0
    straight = {"residual_map__rate_low": -full, "residual_map__rate_high": full}
    mapped = response(residual_map__torque=0.05, residual_map__rate=1.0, **straight)
    top = servo.values["motor_gain"] * 4.8 / 24.0  # of which the torque of the friction is
    assert np.abs(np.gradient(mapped, TIMES)).max() < full  # or the curve is held at its end
    viscous = response(viscous_friction__torque=0.05 * top / full)
    assert mapped == pytest.approx(viscous, abs=0.02 * np.abs(viscous - response()).max())


def test_outside_its_range_it_is_held() -> None:
    narrow = {"residual_map__command_low": 1e-3, "residual_map__command_high": 1.1e-3}
    held = response(residual_map__torque=0.04, residual_map__command=1.0, **narrow)
    assert held == pytest.approx(response(constant_load__torque=0.04), abs=1e-9)


def test_a_run_beyond_its_range_is_told() -> None:
    known = {"residual_map.command_low": 1.4e-3, "residual_map.command_high": 1.6e-3}
    on = {"residual_map.torque": 0.01, "residual_map.command": 1.0, **known}
    servo = model("sg90")
    response = simulate(
        replace(servo, values={**servo.values, **on}), TIMES, {"pulse_width": STEPS}
    )
    (told,) = response.warnings
    assert "'pulse_width' went beyond the range of its curve" in told
    assert not simulate(servo, TIMES, {"pulse_width": STEPS}).warnings


def test_ends_that_are_crossed_leave_no_range_and_are_told() -> None:
    crossed = {"residual_map.command_low": 1.6e-3, "residual_map.command_high": 1.4e-3}
    on = {"residual_map.torque": 0.01, "residual_map.command": 1.0, **crossed}
    servo = model("sg90")
    plain = simulate(servo, TIMES, {"pulse_width": STEPS})
    mapped = simulate(changed(servo, on), TIMES, {"pulse_width": STEPS})
    assert len(mapped.warnings) == 1
    assert np.array_equal(mapped["angle"], plain["angle"])


@pytest.mark.parametrize("moved", [False, True])
def test_a_log_beyond_its_range_is_told_where_it_is_fitted(moved: bool) -> None:
    """Named by its log, however that begins."""
    known = {"residual_map.command_low": 1.4e-3, "residual_map.command_high": 1.6e-3}
    servo = changed(
        model("sg90"), {"residual_map.torque": 1e-3, "residual_map.command": 1.0, **known}
    )
    log = measured(servo, TIMES, {"pulse_width": STEPS}, {"angle": 1e-3})
    if moved:
        log = replace(log, start=Start({"angle": 0.0, "rate": 0.0}))
    inside = replace(log, inputs={"pulse_width": np.clip(STEPS, 1.41e-3, 1.59e-3)}, name="small")
    told = fit(servo, [log, inside], ("motor_gain",)).warnings
    assert sum("went beyond the range of its curve" in text for text in told) == 1
    assert any("log 'log': residual_map: 'pulse_width' went beyond" in text for text in told)


def test_check_tells_that_a_log_goes_beyond_its_range() -> None:
    known = {"residual_map.command_low": 1.4e-3, "residual_map.command_high": 1.6e-3}
    on = {"residual_map.torque": 1e-3, "residual_map.command": 1.0, **known}
    servo = model("sg90", parameters=on)
    angle = simulate(servo, TIMES, {"pulse_width": STEPS})["angle"]
    noise = 1e-3 * np.random.default_rng(3).standard_normal(len(TIMES))
    table = {"t": TIMES, "pulse_width": STEPS, "angle": angle + noise}
    columns = {"time": "t", "pulse_width": "pulse_width", "angle": "angle"}
    told = check(describe(servo, {"log": table}, columns)).warnings
    assert any("log 'log': residual_map: 'pulse_width' went beyond" in text for text in told)


def test_the_range_of_a_wire_that_is_no_output_is_known_as_well() -> None:
    on = {"residual_map.torque": 0.01, "residual_map.reversal": 1.0}
    known = {"residual_map.reversal_low": -1e-3, "residual_map.reversal_high": 1e-3}
    servo = model("sg90")
    mapped = changed(servo, {**on, **known})
    warnings = simulate(mapped, TIMES, {"pulse_width": STEPS}).warnings
    assert "'since_reversal' went beyond the range of its curve" in " ".join(warnings)
