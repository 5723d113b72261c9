"""Where data show parameters only together, a fit ends where priors say, not where it began."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.identification.optimise import along_valley, descend
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
