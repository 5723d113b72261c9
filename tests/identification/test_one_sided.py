"""Squared errors along an estimate; a limit that is met for moments is told from below only."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

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
