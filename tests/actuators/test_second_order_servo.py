"""The general servo: closed forms of a second order, and its limits solved piece by piece."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from servo_models import describe, diagnose
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuator, model
from servo_models.core.types import Array
from servo_models.validation.second_order_servo.reference import Limited, Linear, Servo

TIMES = 1e-3 * np.arange(801)
UNLIMITED = {"speed_limit": 1e4, "acceleration_limit": 1e7, "transport_delay.time": 0.0}
DEGREE = math.pi / 180.0


def closed_form(omega: float, zeta: float, time: Array) -> Array:
    """Unit step response of omega^2 / (s^2 + 2 zeta omega s + omega^2), zeta not 1."""
    root = np.sqrt(complex(zeta**2 - 1.0))
    one, other = -omega * (zeta - root), -omega * (zeta + root)
    swing = (other * np.exp(one * time) - one * np.exp(other * time)) / (other - one)
    return 1.0 - np.real(swing)


@settings(max_examples=25, derandomize=True)
@given(
    omega=st.floats(3.0, 60.0),
    zeta=st.floats(0.2, 3.0),
    added=st.floats(0.0, 4.0),
    delay=st.integers(0, 40),
)
def test_a_small_step_is_that_of_a_second_order(
    omega: float, zeta: float, added: float, delay: int
) -> None:
    """Load inertia slows it down: omega and zeta fall by the root of the inertias."""
    slower = math.sqrt(1.0 / (1.0 + added))
    assume(abs(zeta * slower - 1.0) > 0.01)  # the closed form has two poles, and they are apart
    values = {
        **UNLIMITED,
        "natural_frequency": omega,
        "damping_ratio": zeta,
        "inertia": 1e-4,
        "load_inertia.inertia": 1e-4 * added,
        "transport_delay.time": 1e-3 * delay,
        "pulse_gain": 1500.0,
    }
    found = simulate(model("second_order_servo", "pulse", values), TIMES, {"pulse_width": 1.6e-3})
    expected = 0.15 * closed_form(omega * slower, zeta * slower, TIMES - 1e-3 * delay)
    expected[1e-3 * delay > TIMES] = 0.0
    np.testing.assert_allclose(found["angle"], expected, atol=2e-6)


def test_far_beyond_the_speed_limit_it_turns_at_that_speed() -> None:
    """Reached as by a first order of time constant 1 / (2 zeta omega)."""
    values = {**UNLIMITED, "speed_limit": 5.0, "natural_frequency": 20.0, "damping_ratio": 1.25}
    chosen = model("second_order_servo", "bus", values)
    found = simulate(chosen, TIMES, {"goal": 40.0})
    np.testing.assert_allclose(found["rate"], -5.0 * np.expm1(-50.0 * TIMES), atol=1e-6)
    way = 5.0 * (TIMES + np.expm1(-50.0 * TIMES) / 50.0)
    np.testing.assert_allclose(found["angle"], way, atol=1e-7)


def test_the_acceleration_limit_makes_a_parabola() -> None:
    values = {**UNLIMITED, "acceleration_limit": 30.0}
    found = simulate(model("second_order_servo", "bus", values), TIMES[:201], {"goal": 20.0})
    np.testing.assert_allclose(found["angle"], 15.0 * TIMES[:201] ** 2, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found["rate"], 30.0 * TIMES[:201], rtol=1e-9, atol=1e-12)


def test_a_load_deflects_it_by_torque_over_stiffness() -> None:
    """Stiffness is inertia omega^2, whatever it carries."""
    values = {"natural_frequency": 25.0, "inertia": 8e-4, "load_inertia.inertia": 3e-4}
    found = simulate(model("second_order_servo", None, values), [0.0, 3.0], {"load_torque": 0.05})
    assert found["angle"][-1] == pytest.approx(-0.05 / (8e-4 * 25.0**2), rel=1e-9)


@settings(max_examples=10, derandomize=True)
@given(
    omega=st.floats(10.0, 50.0),
    zeta=st.floats(0.4, 1.6),
    fastest=st.floats(1.0, 10.0),
    hardest=st.floats(30.0, 500.0),
    size=st.floats(-1.5, 1.5),
)
def test_both_limits_are_those_of_another_solver(
    omega: float, zeta: float, fastest: float, hardest: float, size: float
) -> None:
    """The law of the docstring by ``solve_ivp`` in short pieces, without any regime."""

    def law(_: float, x: Array) -> list[float]:
        drive = min(max(omega / (2.0 * zeta) * (size - x[0]), -fastest), fastest)
        return [x[1], min(max(2.0 * zeta * omega * (drive - x[1]), -hardest), hardest)]

    times = TIMES[::4]
    solved = solve_ivp(law, (0.0, times[-1]), [0.0, 0.0], "RK45", times, max_step=5e-4, rtol=1e-9)
    values = {
        "natural_frequency": omega,
        "damping_ratio": zeta,
        "speed_limit": fastest,
        "acceleration_limit": hardest,
        "transport_delay.time": 0.0,
        "internal_step": 1e-4,  # where a limit is met is not located within a step
    }
    found = simulate(model("second_order_servo", "bus", values), times, {"goal": size})
    np.testing.assert_allclose(found["angle"], solved.y[0], atol=1e-5)
    np.testing.assert_allclose(found["rate"], solved.y[1], atol=1e-3)


def test_the_reference_with_limits_out_of_reach_is_the_linear_one() -> None:
    servo = Servo(90.0, 30.0, 0.8, 10.0, 6e-4, added=2e-4)
    inputs = {
        "pulse_width": np.where(TIMES > 0.1, 1.7e-3, 1.5e-3),
        "goal": 0.1 * np.ones(len(TIMES)),
        "load_torque": np.where(TIMES > 0.3, 0.03, 0.0),
    }
    far = replace(servo, fastest=1e5, hardest=1e7)
    exact = Linear(servo)(TIMES, inputs)
    for name, curve in Limited(far)(TIMES, inputs).items():
        np.testing.assert_allclose(curve, exact[name], atol=1e-8 * np.abs(exact[name]).max())


@pytest.mark.parametrize("variant", ["pulse", "bus"])
def test_every_parameter_of_it_is_uncertain_limits_included(variant: str) -> None:
    """But the gain of the command that the variant does not have."""
    other = {"pulse": "gain", "bus": "pulse_gain"}[variant]
    found = actuator("second_order_servo")
    own = {p.name for p in found.plant.parameters.values() if not p.owner} - {"internal_step"}
    known = found.variant(variant).uncertainty
    assert set(known) == (own | {"transport_delay.time"}) - {other}
    assert min(known.values()) > 0.0


def log_of_another_servo(friction: float) -> dict[str, Array]:
    """Steps and a sweep, read to 0.05 deg, of a servo 6 to 40 % off the nominal one.

    The log comes from ``solve_ivp``; friction is Coulomb's [N m].
    """
    random = np.random.default_rng(3)
    times = 5e-3 * np.arange(1200)
    steps = 1e-4 * np.repeat(random.integers(-5, 6, 12), 100)
    since = np.clip(times - 3.0, 0.0, None)
    sweep = 2.5e-4 * np.sin(np.pi * since * (1.0 + 0.3 * since))
    pulse = 1.5e-3 + np.where(times < 0.5, 0.0, np.where(times < 3.0, steps, sweep))
    servo = Servo(95.0, 24.0, 0.9, 14.0, 6e-4, fastest=400.0, hardest=15e3, friction=friction)
    rest = np.zeros(len(times))
    inputs = {"pulse_width": pulse, "goal": rest, "load_torque": rest}
    angle = Limited(servo)(times, inputs)["angle"] / DEGREE
    return {"t": times, "pulse": pulse, "deg": angle + 0.05 * random.standard_normal(len(times))}


@pytest.mark.thorough
@pytest.mark.parametrize(("friction", "effects"), [(0.0, ()), (0.012, ("coulomb_friction",))])
def test_a_servo_of_which_nothing_is_known_is_diagnosed(
    friction: float, effects: tuple[str, ...]
) -> None:
    """From the first guess alone: parameters where they suffice, and friction where there is some.

    A log without a known load tells friction over inertia only.
    """
    log = log_of_another_servo(friction)
    columns = {"time": "t", "pulse_width": "pulse", "angle": ("deg", "deg")}
    result = diagnose(describe("second_order_servo", {"log": log}, columns))
    assert result.selection.taken.effects == effects
    found = result.fitted.values
    assert found["speed_limit"] == pytest.approx(400.0 * DEGREE, rel=0.02)
    assert found["transport_delay.time"] == pytest.approx(0.014, rel=0.05)
    if effects:
        slowing = found["coulomb_friction.level"] / found["inertia"]
        assert slowing == pytest.approx(friction / 6e-4, rel=0.05)
