"""The motors: closed forms of first and second order, and the speed loop by another solver."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuator, model
from servo_models.core.types import Array
from servo_models.data.log import Start
from servo_models.identification.simulation import prepared
from servo_models.identification.starts import with_starts
from servo_models.validation.dc_motor.reference import InSpeedLoop, Motor
from servo_models.validation.solvers import changes
from tests.support.logs import log_of

TIMES = 1e-3 * np.arange(401)
NAMES = ("dc_motor", "dc_motor_current", "dc_motor_speed")
NO_COIL = {"winding_lag.time_constant": 0.0}
J, K, B, R = 1e-5, 0.03, 2e-6, 2.0


@settings(max_examples=25, derandomize=True)
@given(
    inertia=st.floats(3e-6, 1e-3),
    constant=st.floats(0.01, 0.1),
    resistance=st.floats(0.5, 10.0),
    ratio=st.floats(1.0, 200.0),
    volts=st.floats(-24.0, 24.0),
)
def test_on_a_voltage_it_is_a_first_order_behind_its_gearbox(
    inertia: float, constant: float, resistance: float, ratio: float, volts: float
) -> None:
    """Speed V k / (k^2 + b R), time constant J R / (k^2 + b R), at the motor."""
    values = {
        **NO_COIL,
        "rotor_inertia": inertia,
        "torque_constant": constant,
        "resistance": resistance,
        "gear_ratio": ratio,
        "viscous_coefficient": B,
    }
    found = simulate(model("dc_motor", "direct", values), TIMES, {"voltage": volts})
    damping = constant**2 + B * resistance
    final, slow = volts * constant / damping, inertia * resistance / damping
    speed = -final * np.expm1(-TIMES / slow)
    bar = 1e-6 * max(abs(final), 1e-3)
    np.testing.assert_allclose(found["encoder_speed"], speed, atol=bar)
    np.testing.assert_allclose(found["rate"], speed / ratio, atol=bar)
    way = final * TIMES - slow * speed
    np.testing.assert_allclose(found["encoder_angle"], way, atol=bar)


def test_an_inductance_makes_it_a_second_order() -> None:
    """Poles of L J s^2 + (R J + b L) s + k^2 + b R."""
    inductance = 1e-3
    found = simulate(
        model("dc_motor", "direct", {"winding_lag.time_constant": inductance / R}),
        TIMES,
        {"voltage": 10.0},
    )
    one, other = np.roots([inductance * J, R * J + B * inductance, K**2 + B * R])
    final = 10.0 * K / (K**2 + B * R)
    swing = (other * np.exp(one * TIMES) - one * np.exp(other * TIMES)) / (other - one)
    np.testing.assert_allclose(found["encoder_speed"], final * (1.0 - swing), atol=1e-4 * final)


def test_on_a_current_it_runs_up_against_its_drag() -> None:
    current, load = 0.8, 0.01
    found = simulate(
        model("dc_motor_current"), TIMES, {"current_command": current, "load_torque": load}
    )
    final, slow = (K * current - load) / B, J / B
    np.testing.assert_allclose(found["rate"], -final * np.expm1(-TIMES / slow), rtol=1e-9)
    assert found["current"].tolist() == [current] * len(TIMES)


def test_a_stalled_motor_draws_voltage_over_resistance() -> None:
    held = {"end_stops.half_range": 1e-3}
    found = simulate(model("dc_motor", "geared", held), [0.0, 0.5], {"voltage": 12.0})
    assert found["current"][-1] == pytest.approx(12.0 / R)
    assert found["rate"][-1] == 0.0


def test_within_the_limit_the_speed_loop_is_its_transfer_function() -> None:
    """The reference by located events, and by the matrix exponential, and the model."""
    loop = InSpeedLoop(Motor(30.0, 100.0, 2e-3), 0.02, 0.05, 5.0)
    inputs = {
        "position_command": np.zeros(len(TIMES)),
        "speed_command": np.where(TIMES > 0.05, 100.0, 0.0),
        "load_torque": np.where(TIMES > 0.2, 0.02, 0.0),
    }
    asked = changes(TIMES, inputs["speed_command"])
    pushed = loop.motor.pushed(TIMES, inputs["load_torque"])
    exact = loop.motor.named(loop.system().response(TIMES, [asked, pushed]))
    followed = loop(TIMES, inputs)
    found = simulate(model("dc_motor_speed"), TIMES, inputs)
    for name, curve in exact.items():
        bar = np.abs(curve).max()
        np.testing.assert_allclose(followed[name], curve, atol=1e-8 * bar)
        np.testing.assert_allclose(found[name], curve, atol=1e-7 * bar)


def test_no_load_leaves_an_error_of_the_speed_in_the_end() -> None:
    load = {"speed_command": 80.0, "load_torque": 0.05}
    found = simulate(model("dc_motor_speed"), [0.0, 3.0], load)
    assert found["encoder_speed"][-1] == pytest.approx(80.0, rel=1e-9)
    assert found["current"][-1] == pytest.approx((0.05 + B * 80.0) / K, rel=1e-6)


@settings(max_examples=10, derandomize=True)
@given(
    gain=st.floats(0.005, 0.1),
    time=st.floats(0.01, 0.5),
    limit=st.floats(0.3, 6.0),
    speed=st.floats(-400.0, 400.0),
    load=st.floats(-0.005, 0.005),
    holding=st.sampled_from([0.0, 5.0, 30.0]),
    fastest=st.sampled_from([math.inf, 60.0]),
)
def test_the_loops_with_their_limits_are_those_of_another_solver(
    gain: float,
    time: float,
    limit: float,
    speed: float,
    load: float,
    holding: float,
    fastest: float,
) -> None:
    """The laws as they are written, by ``solve_ivp`` in short pieces; holding at 4 rad or not."""

    def law(_: float, x: Array) -> list[float]:
        asked = min(max(speed + holding * (4.0 - x[2]), -fastest), fastest)
        current = min(max(gain * (asked - x[0]) + x[1], -limit), limit)
        return [(K * current - B * x[0] - load) / J, (current - x[1]) / time, x[0]]

    solved = solve_ivp(
        law, (0.0, TIMES[-1]), [0.0] * 3, "RK45", TIMES, max_step=5e-4, rtol=1e-9, atol=1e-9
    )
    values = {"speed_gain": gain, "integral_time": time, "current_limit": limit}
    values |= {"position_gain": holding, "speed_limit": fastest if fastest < math.inf else 0.0}
    values["internal_step"] = 5e-5  # where the limit is left is not located within a step
    inputs = {"speed_command": speed, "position_command": 4.0, "load_torque": load}
    found = simulate(model("dc_motor_speed", "direct", values), TIMES, inputs)
    scale = max(abs(speed), 50.0)
    np.testing.assert_allclose(found["encoder_speed"], solved.y[0], atol=1e-4 * scale)


def test_its_integral_does_not_wind_up() -> None:
    """Out of the limit it stops short of 3 % over the command, however long it ran up.

    With an integral that goes on, I' = K e / T_i, it would overshoot by more than half.
    """
    times = 1e-3 * np.arange(3001)
    values = {"current_limit": 0.05, "integral_time": 0.05, "speed_gain": 0.02}
    found = simulate(model("dc_motor_speed", "direct", values), times, {"speed_command": 150.0})
    assert np.count_nonzero(found["current"] == 0.05) > 500
    assert 150.0 < found["encoder_speed"].max() < 1.03 * 150.0


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_that_a_data_sheet_leaves_open_is_uncertain(name: str) -> None:
    """The gear ratio is a number of teeth, the rated speed a scale."""
    found = actuator(name)
    own = {p.name for p in found.plant.parameters.values() if not p.owner}
    for variant in found.variants:
        known = {key for key in variant.uncertainty if "." not in key}
        off = {name for name in own if found.values(variant.name)[name] == 0.0}
        assert known == own - off - {"internal_step", "gear_ratio", "rated_speed"}


@settings(max_examples=5, derandomize=True)
@given(load=st.floats(-0.02, 0.02), speed=st.floats(20.0, 100.0))
def test_a_log_cut_out_of_a_run_begins_with_what_its_loop_has_gathered(
    load: float, speed: float
) -> None:
    """In the end the integral part is all of the current, (load + b omega) / k."""
    times = 1e-3 * np.arange(2001)
    inputs = {"speed_command": speed, "load_torque": load}
    found = simulate(model("dc_motor_speed"), times, inputs)
    cut = slice(1500, None)
    held = {name: np.full(501, value) for name, value in inputs.items()}
    read = {"encoder_angle": found["encoder_angle"][cut]}
    log = log_of(times[cut] - times[cut.start], held, read, start=Start(fitted=True))
    (begun,) = with_starts(model("dc_motor_speed"), [log])
    run = prepared(model("dc_motor_speed"), begun)
    assert run.beginning
    begin = run.beginning.values(run.model.vector)
    assert begin["integral"] == pytest.approx((load + B * speed) / K, abs=1e-4)
    assert begin["rate"] == pytest.approx(speed, rel=1e-4)
