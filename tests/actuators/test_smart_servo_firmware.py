"""What smart servos have in firmware: I and D gains, limits of current and of duty.

The PID loop is followed by hand from tick to tick: the motor under a constant voltage is a linear
system, whose step over one tick is exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from servo_models.analysis.linearise import linearise
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array

TICK = 1e-3
SMOOTH = {"sensor_quantisation.step": 0.0}
HELD = {"end_stops.half_range": 1e-6}
"""A blocked shaft: it has not a hundredth of a count to move, so the encoder reads 0."""
VARIANTS = ("xl330", "sts3215")
OUTPUTS = ("angle", "rate", "angle_reading", "duty", "current")


def motor(variant: str) -> tuple[float, float, float, float, float]:
    """Supply [V], torque constant [N m/A], resistance [Ohm], inertia [kg m2], duty over error."""
    chosen = model("smart_servo", variant)
    names = ("torque_constant", "resistance", "inertia")
    known = [chosen.values[name] for name in names]
    stiffness = chosen.values["gain"] * chosen.values["loop_factor"]
    return float(chosen.plant.wire["supply"].rest), known[0], known[1], known[2], stiffness


def over_a_tick(variant: str) -> tuple[Array, Array]:
    """Matrices of (angle, speed) over one tick under a constant duty."""
    supply, constant, resistance, inertia, _ = motor(variant)
    damping = constant**2 / resistance / inertia
    push = constant * supply / resistance / inertia
    whole = expm(TICK * np.array([[0.0, 1.0, 0.0], [0.0, -damping, push], [0.0, 0.0, 0.0]]))
    return whole[:2, :2], whole[:2, 2]


def by_hand(variant: str, goal: Array, gains: Mapping[str, float]) -> tuple[Array, Array]:
    """Angle and duty at the ticks, of a PID loop with conditional integration."""
    a, b = over_a_tick(variant)
    *_, stiffness = motor(variant)
    state, total, last = np.zeros(2), 0.0, 0.0
    out = []
    for wanted in goal:
        error = wanted - state[0]
        summed = total + gains.get("integral_gain", 0.0) * TICK * error
        rest = stiffness * error + gains.get("derivative_gain", 0.0) * (error - last) / TICK
        if (rest + summed) * error > 0.0:  # no further than to the limit, and never back for it
            side = math.copysign(1.0, error)
            summed = side * min(side * summed, max(side * total, 1.0 - side * rest))
        total, last = summed, error
        duty = min(max(rest + total, -1.0), 1.0)
        out.append((state[0], duty))
        state = a @ state + b * duty
    return np.array(out)[:, 0], np.array(out)[:, 1]


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(
    "gains",
    [
        {"derivative_gain": 0.05},
        {"integral_gain": 4.0},
        {"integral_gain": 4.0, "derivative_gain": 0.05},
    ],
    ids=["D", "I", "ID"],
)
@pytest.mark.parametrize("size", [0.01, 1.5], ids=["linear", "at the limit"])
def test_gains_act_as_the_discrete_loop(variant: str, gains: dict[str, float], size: float) -> None:
    ticks = np.arange(600)
    goal = size * np.where(ticks < 20, 0.0, np.where(ticks < 350, 1.0, -0.4))
    angle, _ = by_hand(variant, goal, gains)
    run = simulate(model("smart_servo", variant, {**SMOOTH, **gains}), TICK * ticks, {"goal": goal})
    np.testing.assert_allclose(run["angle"], angle, atol=1e-8)
    assert bool(np.abs(run["duty"]).max() == 1.0) == (size > 1.0)


def test_the_sum_of_a_held_shaft_is_a_stair_of_one_step_a_tick_up_to_the_limit() -> None:
    """With the shaft blocked at 0 the error is the goal: after n ticks, gain n period error."""
    gain, goal, ticks = 20.0, 0.05, np.arange(1, 1000)
    *_, stiffness = motor("xl330")
    chosen = model("smart_servo", "xl330", {**HELD, "integral_gain": gain})
    run = simulate(chosen, TICK * np.arange(1000), {"goal": goal})
    sums = np.minimum(stiffness * goal + gain * TICK * goal * ticks, 1.0)
    assert run["angle_reading"].max() == 0.0
    np.testing.assert_allclose(run["duty"][1:], sums, atol=gain * TICK * goal * 1.001)
    below = sums < 1.0
    np.testing.assert_allclose(run["duty"][1:][below], sums[below], rtol=1e-12)


def test_a_sum_that_waited_at_the_limit_lets_go_at_once() -> None:
    """After 2 s it has what the P term left of the limit, a small part of what it would have."""
    chosen = model("smart_servo", "xl330", {**HELD, "integral_gain": 20.0})
    *_, stiffness = motor("xl330")
    times = TICK * np.arange(2100)
    run = simulate(chosen, times, {"goal": np.where(times < 2.0 - 1e-9, 0.8, -0.05)})
    assert run["duty"][1999] == 1.0
    left = 1.0 - 0.8 * stiffness
    expected = left - (stiffness + 20.0 * TICK) * 0.05
    assert run["duty"][2001] == pytest.approx(expected, rel=1e-9)


def test_a_motor_that_is_off_sums_nothing() -> None:
    chosen = model("smart_servo", "xl330", {**HELD, "integral_gain": 20.0})
    *_, stiffness = motor("xl330")
    times = TICK * np.arange(1001)
    enabled = np.where(times < 1.0 - 1e-9, 0.0, 1.0)
    run = simulate(chosen, times, {"goal": 0.02, "enabled": enabled})
    assert run["duty"][999] == pytest.approx(stiffness * 0.02, rel=1e-12)


def test_the_linear_model_of_a_loop_with_gains_is_that_of_its_ticks() -> None:
    """P acts at once where the hold is left out; I and D stay from tick to tick."""
    gains = {"integral_gain": 4.0, "derivative_gain": 0.02}
    linear = linearise(model("smart_servo", "xl330", {**SMOOTH, **gains}))
    assert linear.period == pytest.approx(TICK)
    assert linear.left_out == {"sample_hold": "it has a memory"}
    supply, constant, resistance, inertia, stiffness = motor("xl330")
    damping = constant**2 / resistance / inertia
    push = constant * supply / resistance / inertia
    whole = expm(
        TICK * np.array([[0.0, 1.0, 0.0], [-push * stiffness, -damping, push], [0.0, 0.0, 0.0]])
    )
    a, b = whole[:2, :2], whole[:2, 2]
    angle, summed = np.array([1.0, 0.0]), gains["integral_gain"] * TICK
    slope = gains["derivative_gain"] / TICK
    # states: angle, speed, sum, angle at the tick before
    after = np.zeros((4, 4))
    after[:2, :2] = a - np.outer(b, (summed + slope) * angle)
    after[:2, 2], after[:2, 3] = b, b * slope
    after[2, :3], after[3, 0] = (-summed, 0.0, 1.0), 1.0
    poles = np.linalg.eigvals(after)
    found = np.linalg.eigvals(linear.matrices()[0])
    for pole in poles:
        assert np.abs(found - pole).min() < 1e-5


@pytest.mark.parametrize("variant", VARIANTS)
def test_without_gains_the_linear_model_is_one_of_continuous_time(variant: str) -> None:
    assert linearise(model("smart_servo", variant)).period == 0.0


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_stalled_motor_takes_no_more_than_the_limit(variant: str) -> None:
    supply, _, resistance, _, _ = motor(variant)
    limit = 0.3 * supply / resistance
    for sign in (1.0, -1.0):
        chosen = model("smart_servo", variant, {**HELD, "current_limit.limit": limit})
        run = simulate(chosen, [0.0, 0.1], {"goal": sign * 10.0})
        assert run["current"][-1] == sign * limit
        small = simulate(chosen, [0.0, 0.1], {"goal": sign * 0.02})
        wanted = small["duty"][-1] * supply / resistance
        assert small["current"][-1] == pytest.approx(wanted, rel=1e-12)
        assert abs(wanted) < limit


def test_a_start_at_the_current_limit_is_a_parabola_and_then_the_motor_s_exponential() -> None:
    """Full duty: constant torque until back EMF leaves less than the limit."""
    supply, constant, resistance, inertia, _ = motor("xl330")
    limit = 0.4 * supply / resistance
    chosen = model(
        "smart_servo", "xl330", {"current_limit.limit": limit, "internal_step": 1e-4, **SMOOTH}
    )
    times = np.linspace(0.0, 0.5, 501)
    run = simulate(chosen, times, {"goal": 50.0})
    push, knee = constant * limit / inertia, (supply - resistance * limit) / constant
    lag, top, bend = resistance * inertia / constant**2, supply / constant, knee / push
    later = np.clip(times - bend, 0.0, None)
    slow = knee + (top - knee) * -np.expm1(-later / lag)
    np.testing.assert_allclose(run["rate"], np.where(times < bend, push * times, slow), atol=2e-4)


def test_a_limit_of_the_duty_and_one_of_the_current_against_solve_ivp() -> None:
    supply, constant, resistance, inertia, stiffness = motor("sts3215")
    ceiling, limit = 0.6, 0.5
    values = {
        **SMOOTH,
        "sample_hold.period": 0.0,
        "drive_saturation.limit": ceiling,
        "current_limit.limit": limit,
        "internal_step": 2e-4,
    }
    times = np.linspace(0.0, 0.8, 401)
    run = simulate(model("smart_servo", "sts3215", values), times, {"goal": 1.0})

    def motion(_: float, state: Array) -> list[float]:
        duty = np.clip(stiffness * (1.0 - state[0]), -ceiling, ceiling)
        current = np.clip((duty * supply - constant * state[1]) / resistance, -limit, limit)
        return [state[1], constant * current / inertia]

    exact = solve_ivp(motion, (0.0, 0.8), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(run["angle"], exact.y[0], atol=1e-5)
    assert run["duty"].max() == ceiling
    assert run["current"].max() == limit


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(
    ("limit", "huge"),
    [("current_limit.limit", 15.0), ("drive_saturation.limit", 1.0), ("motion_profile", 0.0)],
)
def test_a_limit_that_never_acts_changes_no_bit(variant: str, limit: str, huge: float) -> None:
    """An acceleration time alone is no profile."""
    name = limit if "." in limit else "motion_profile.acceleration_time"
    times = TICK * np.arange(800)
    goal = np.where(times < 0.4, 1.2, -0.7)
    friction = {"coulomb_friction.level": 0.03}
    free = simulate(model("smart_servo", variant, friction), times, {"goal": goal})
    changed = {**friction, name: huge or 0.2}
    limited = simulate(model("smart_servo", variant, changed), times, {"goal": goal})
    for output in OUTPUTS:
        assert free[output].tobytes() == limited[output].tobytes()


def test_a_profile_faster_than_any_servo_changes_little() -> None:
    """It is late by one tick: it begins where the goal was."""
    times = TICK * np.arange(800)
    goal = np.where(times < 0.4, 0.8, -0.3)
    free = simulate(model("smart_servo", "xl330"), times, {"goal": goal})
    chosen = model("smart_servo", "xl330", {"motion_profile.velocity": 9e3})
    fast = simulate(chosen, times, {"goal": goal})
    top = motor("xl330")[0] / motor("xl330")[1]
    assert np.abs(fast["angle"] - free["angle"]).max() <= 1.05 * top * TICK
    assert math.isclose(fast["angle"][-1], free["angle"][-1], abs_tol=1e-3)
