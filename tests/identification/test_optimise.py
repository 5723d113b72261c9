"""Where data show parameters only together, a fit ends where priors say, not where it began."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.identification.linear_inference import symmetries
from servo_models.identification.optimise import along_valley, as_believed, descend
from servo_models.identification.problem import Problem, free_parameter
from tests.support.logs import changed, measured

TIMES: Array = 5e-3 * np.arange(1200)
NOISE = 1e-3  # rad
RIG = {"coulomb_friction.level": 0.012, "constant_load.torque": 4.5e-3}
PRIORS = {"torque_constant": 0.1, "resistance": 0.1, "rotor_inertia": 0.2}
"""Standard deviations, of the nominal value."""


def volts(seed: int) -> Array:
    """Steps, then a sweep."""
    levels = np.random.default_rng(seed).uniform(-6.0, 6.0, 12)
    levels[0] = 0.0
    sweep = 6.0 * np.sin(2.0 * math.pi * (0.4 + 0.2 * TIMES) * TIMES)
    return np.where(TIMES < 3.0, np.repeat(levels, 100), sweep)


def problem(seed: int) -> Problem:
    """A motor whose data show resistance, inertia, friction and load as products only."""
    motor = model("dc_motor", "direct")
    log = measured(changed(motor, RIG), TIMES, {"voltage": volts(seed)}, {"encoder_angle": NOISE})
    parameters = motor.plant.parameters
    free = [
        free_parameter(parameters[name], motor.values[name], share * motor.values[name])
        for name, share in PRIORS.items()
    ]
    free += [
        replace(free_parameter(parameters[name], 0.0, None), start=value)
        for name, value in RIG.items()
    ]
    return Problem(motor, [log], free, {"encoder_angle": NOISE})


def far(asked: Problem) -> Array:
    """The true values, moved along the products by a third."""
    values = {name: asked.model.values[name] for name in PRIORS} | RIG
    values["resistance"] *= 1.33
    for name in ("rotor_inertia", *RIG):
        values[name] /= 1.33
    return np.array([values[free.name] for free in asked.free]) / asked.scales


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_what_data_do_not_show_keeps_its_prior_value(seed: int) -> None:
    asked = problem(seed)
    across, _, _ = descend(asked, far(asked), 1e-7, 60)
    found, ended, _ = along_valley(asked, across)
    assert ended
    values = asked.values(found)
    nominal, prior = asked.model.values["resistance"], 0.1 * asked.model.values["resistance"]
    assert abs(values["resistance"] - nominal) < 0.3 * prior
    assert values["coulomb_friction.level"] == pytest.approx(0.012, rel=0.03)


@pytest.mark.thorough
def test_it_ends_where_another_optimiser_does() -> None:
    """That of scipy, in the logarithms of all values, from the true ones."""
    from scipy.optimize import least_squares

    asked = problem(0)
    across, _, _ = descend(asked, far(asked), 1e-7, 60)
    found, _, _ = along_valley(asked, across)
    truth = {name: asked.model.values[name] for name in PRIORS} | RIG
    begin = np.log(np.array([truth[free.name] for free in asked.free]) / asked.scales)
    best = least_squares(
        lambda logs: asked.residuals(np.exp(logs)), begin, "3-point", x_scale=1e-3, xtol=1e-12
    )
    assert 2.0 * asked.costs([found])[0] < 2.0 * best.cost + 0.2
    assert asked.values(found)["resistance"] == pytest.approx(
        asked.values(np.exp(best.x))["resistance"], abs=0.05
    )


def test_where_there_is_no_valley_nothing_moves() -> None:
    """One parameter of which data tell all."""
    asked = problem(0)
    alone = replace(asked, free=asked.free[:1], start=None, model=changed(asked.model, RIG))
    end, _, _ = descend(alone, alone.start, 1e-10, 60)
    found, ended, _ = along_valley(alone, end)
    assert ended
    assert found == pytest.approx(end, rel=1e-6)


LIMITED = {
    "coulomb_friction.level": 0.1,
    "drive_saturation.limit": 0.4,
    "coasting_backlash.half_width": 0.01,
}
BELIEVED = {"inertia": 0.15, "torque_constant": 0.1, "resistance": 0.1, "loop_factor": 0.05}
MOTION = {"inertia": 1, "resistance": -1, "coulomb_friction.level": 1}
DUTY = {"torque_constant": 1, "loop_factor": 1, "resistance": 2, "drive_saturation.limit": 1}
"""Exponents of factors on parameters that leave the motion of a servo as it is: torque over inertia
counts, and duty only with the torque that it makes."""


def servo_problem(effects: tuple[str, ...], seed: int = 0) -> Problem:
    """A servo that reads whole codes, with these effects; its own firmware limits no duty."""
    wrong = {name: value for name, value in LIMITED.items() if name in effects}
    servo = model("smart_servo", "sts3215")
    levels = np.random.default_rng(seed).uniform(-0.8, 0.8, 8)
    goal = np.repeat(levels, 100)
    times = 5e-3 * np.arange(len(goal))
    log = measured(changed(servo, wrong), times, {"goal": goal}, {"angle_reading": 0.0}, seed)
    known, nominal = servo.plant.parameters, servo.values
    free = [free_parameter(known[it], nominal[it], p * nominal[it]) for it, p in BELIEVED.items()]
    free += [replace(free_parameter(known[it], 0.0, None), start=wrong[it]) for it in wrong]
    return Problem(servo, [log], free, {"angle_reading": 4.5e-4})


@pytest.mark.parametrize(
    ("effects", "groups"),
    [
        (("drive_saturation.limit",), [MOTION, DUTY]),
        (("coulomb_friction.level", "drive_saturation.limit"), [MOTION, DUTY]),
        (("coulomb_friction.level", "coasting_backlash.half_width"), [MOTION]),
        (tuple(LIMITED), [MOTION, DUTY]),
    ],
)
def test_products_that_no_reading_shows_are_found(
    effects: tuple[str, ...], groups: list[dict[str, int]]
) -> None:
    """By the equations of a servo whose supply limits its duty, unless an effect does."""
    asked = servo_problem(effects)
    found = symmetries(asked, asked.start)
    want = np.array([[it.get(free.name, 0) for free in asked.free] for it in groups]).T
    assert found.shape == want.shape
    assert np.linalg.matrix_rank(np.hstack([found, want])) == len(groups)


@pytest.mark.parametrize("by", [(0.2, 0.0), (-0.1, 0.15), (0.15, -0.1)])
def test_a_fit_to_codes_ends_where_priors_say(by: tuple[float, float]) -> None:
    """Each code that flips costs more than priors do, so only the very products lead there."""
    asked = servo_problem(("coulomb_friction.level", "drive_saturation.limit"))
    names = [free.name for free in asked.free]
    ways = np.array([[it.get(name, 0) for name in names] for it in (MOTION, DUTY)])
    begin = asked.start * np.exp(np.array(by) @ ways)
    vector = as_believed(asked, along_valley(asked, begin)[0])
    n = asked.samples
    assert np.allclose(asked.residuals(vector)[:n], asked.residuals(begin)[:n], atol=1e-9)
    # what was believed is true, and lies on these ways
    assert vector == pytest.approx(asked.start, rel=1e-4)
