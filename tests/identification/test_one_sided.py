"""Squared errors along an estimate; a limit that is met for moments is told from below only."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize, minimize_scalar

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.identification.linear_inference import _profiled, spread
from servo_models.identification.optimise import along_valley, descend
from servo_models.identification.problem import Problem, free_parameter
from tests.support.logs import changed, measured

TIMES: Array = 0.01 * np.arange(1000)
NOISE = 2e-3  # rad
PRIORS = {"natural_frequency": 0.3, "damping_ratio": 0.3, "acceleration_limit": 0.5}
"""Standard deviations, of the nominal value."""


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("limit", [1.3, 2.0])
def test_the_interval_of_a_limit_holds_the_true_one(seed: int, limit: float) -> None:
    """The prior draws it down to where it just does no harm; by slopes it is known there."""
    nominal = model("second_order_servo", "bus")
    values = nominal.values
    rig = changed(nominal, {"acceleration_limit": limit * values["acceleration_limit"]})
    levels = np.random.default_rng(seed).uniform(-0.5, 0.5, 10)
    levels[0] = 0.0
    log = measured(rig, TIMES, {"goal": np.repeat(levels, 100)}, {"angle": NOISE}, seed)
    free = [
        free_parameter(nominal.plant.parameters[name], values[name], share * values[name])
        for name, share in PRIORS.items()
    ]
    problem = Problem(nominal, [log], free, {"angle": NOISE})
    end, _, _ = descend(problem, problem.start, 1e-8, 60)
    vector, _, _ = along_valley(problem, end)
    errors = spread(problem, vector).standard_errors
    found = problem.values(vector)
    for free_one, error in zip(free, errors):
        true = rig.values[free_one.name]
        assert abs(found[free_one.name] - true) < 3.0 * error, free_one.name
    assert errors[0] < 0.01 * found["natural_frequency"]  # known from both sides, and well


def test_where_no_slope_tells_a_value_nothing_is_wider() -> None:
    """The response does not depend on a limit far above what is asked for, which has no prior."""
    nominal = model("second_order_servo", "bus")
    goal = 0.1 * np.sin(TIMES)
    log = measured(nominal, TIMES, {"goal": goal}, {"angle": NOISE})
    limit = free_parameter(nominal.plant.parameters["acceleration_limit"], 200.0, None)
    problem = Problem(nominal, [log], [limit], {"angle": NOISE})
    assert _profiled(problem, problem.start, np.zeros((len(TIMES), 1)), 0, 0.1)[0] == 1.0


def test_profiles_are_those_of_the_other_parameter_fitted_again_and_held() -> None:
    nominal = model("second_order_servo", "bus")
    goal = np.repeat([0.0, 0.3, -0.2, 0.1], 250)
    log = measured(nominal, TIMES, {"goal": goal}, {"angle": NOISE}, 1)
    free = [
        free_parameter(nominal.plant.parameters[name], nominal.values[name], None)
        for name in ("natural_frequency", "damping_ratio")
    ]
    problem = Problem(nominal, [log], free, {"angle": NOISE})
    vector, _, _ = descend(problem, problem.start, 1e-12, 60)
    found = spread(problem, vector)
    least = problem.costs([vector])[0]
    for i, profile in enumerate(found.profiles):
        error = found.standard_errors[i] / problem.scales[i]

        def risen(distance: float, other: float, i: int = i, error: float = error) -> float:
            moved = np.array([other, other])
            moved[i] = vector[i] + distance * error
            return problem.costs([moved])[0] / least - 1.0

        for distance, rise in profile.points:
            again = minimize_scalar(partial(risen, distance), vector[1 - i] + np.array([-0.1, 0.1]))
            assert rise == pytest.approx(again.fun, rel=0.05)
            assert rise == pytest.approx(profile.following * distance**2, rel=0.15)
            held = risen(distance, vector[1 - i])
            assert profile.held * distance**2 == pytest.approx(held, rel=0.15)
        assert len(profile.points) == 2


@pytest.mark.parametrize(
    ("free", "doubled"),
    [
        ("coasting_backlash.share", {"contact": 120.0, "damping": 0.6}),
        ("sensor_quantisation.step", {"rounding": 1.0}),
        ("sample_hold.period", {}),  # its clock is taken for a steady one
        ("thermal_drift.loss", {}),  # what it is counted in is no guess
        ("inertia", {}),
    ],
)
def test_what_an_effect_assumes(free: str, doubled: dict[str, float]) -> None:
    servo = model("smart_servo", "sts3215")
    log = measured(servo, TIMES, {"goal": 0.3 * np.sin(TIMES)}, {"angle": NOISE})
    asked = Problem(servo, [log], [free_parameter(servo.plant.parameters[free], 0.1, None)])
    assert {name.rpartition(".")[2]: it for name, it in asked.assumed.items()} == doubled


@pytest.mark.thorough
def test_a_size_is_no_surer_than_what_its_effect_assumes() -> None:
    """By another optimiser, with a gear of twice the pitch, and of twice the damping."""
    nominal = model("smart_servo", "sts3215")
    size, part = "coasting_backlash.half_width", "coasting_backlash.share"
    rig = changed(nominal, {size: 8e-3, part: 0.1, "coulomb_friction.level": 0.08})
    levels = np.random.default_rng(3).uniform(-0.5, 0.5, 10)
    log = measured(rig, TIMES, {"goal": np.repeat(levels, 100)}, {"angle": 1e-4})
    free = [free_parameter(rig.plant.parameters[it], rig.values[it], None) for it in (size, part)]

    def asked(key: str, value: float) -> Problem:
        other = changed(rig, {f"coasting_backlash.{key}": value})
        return Problem(other, [log], free, {"angle": 1e-4})

    begin = np.array([[1.0, 1.0], [1.02, 1.0], [1.0, 1.02]])
    options = {"initial_simplex": begin, "xatol": 1e-3, "fatol": 1.0}
    moved = [
        minimize(
            lambda at, it=it: it.costs([at])[0], begin[0], method="Nelder-Mead", options=options
        ).x
        - 1.0
        for it in (asked("contact", 120.0), asked("damping", 0.6))
    ]
    same = asked("damping", 0.3)
    errors = spread(same, same.start).standard_errors / same.scales
    ratio = errors / np.linalg.norm(moved, axis=0)  # the response is rough, and bends
    assert np.all((ratio > 0.5) & (ratio < 2.0))
