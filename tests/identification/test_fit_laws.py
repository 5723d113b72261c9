"""Laws of a fit by simulation: bounds, slopes, covariance, and how its figures are printed."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.log import Channel
from servo_models.identification.fit import fit
from servo_models.identification.linear_inference import Information, covariance, spread_of
from servo_models.identification.optimise import descend
from servo_models.identification.problem import Problem, free_parameter
from servo_models.identification.simulation import Run
from servo_models.report.numbers import MOST_DIGITS, with_error
from tests.support.exact_motor import TRUE, bench_log, noisy, nominal, prbs, rig
from tests.support.logs import changed

NAMES = tuple(name for name in nominal().plant.parameters if name != "internal_step")


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    names=st.lists(st.sampled_from(NAMES), min_size=1, max_size=4, unique=True),
    seed=st.integers(0, 99),
    noise=st.sampled_from([0.0, 1e-4, 1e-2, 1.0]),
    prior=st.sampled_from([0.0, 1e-3, 1.0]),
)
def test_a_fit_of_anything_stays_in_bounds_and_never_makes_it_worse(
    names: list[str], seed: int, noise: float, prior: float
) -> None:
    count = 120
    voltage = prbs(count, seed)
    angle = rig(TRUE, voltage) + noise * np.random.default_rng(seed).standard_normal(count)
    log = bench_log(voltage, angle)
    chosen = nominal()
    priors = {name: prior * abs(chosen.values[name]) for name in names if prior}
    priors = {name: size for name, size in priors.items() if size > 0.0}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = fit(chosen, [log], names, priors)
    for free, value in zip(found.free, found.values):
        assert free.low <= value <= free.high
    if not priors:
        (row,) = found.accuracy
        assert row.after <= row.before * (1.0 + 1e-6)
    assert all(error >= 0.0 for error in found.standard_errors if not np.isnan(error))


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
def test_slopes_mean_something_where_small_differences_do_not(seed: int) -> None:
    """Encoder counts and dry friction in a sampled loop: followed by small differences, a
    search ends far from the truth, at a hundred times the error, and calls that converged.
    """
    true = {"torque_constant": 1.6, "inertia": 0.02, "coulomb_friction.level": 0.06}
    times, random = 0.02 * np.arange(1000), np.random.default_rng(seed)
    waves = zip(np.geomspace(0.1, 5.0, 8), random.uniform(0.0, 2.0 * np.pi, 8))
    goal = sum(0.05 * np.sin(2.0 * np.pi * f * times + p) for f, p in waves)
    servo = model("smart_servo", "sts3215", true)
    angle = simulate(servo, times, {"goal": goal})["angle_reading"]
    log = replace(
        bench_log(goal, angle),
        times=times,
        inputs={"goal": goal},
        outputs={"angle_reading": angle},
        channels={"angle_reading": Channel("angle_reading", "angle", "rad")},
    )
    found = fit(model("smart_servo", "sts3215"), [log], list(true))
    assert found.values == pytest.approx(list(true.values()), rel=0.02)
    assert found.accuracy[0].after < 0.05 * found.accuracy[0].before
    assert any("rough" in said for said in found.warnings)


def test_smooth_errors_have_a_covariance() -> None:
    """What a model lacks may be a smooth bump, which its own past predicts to rounding."""
    chosen = nominal()
    voltage = prbs(600, 1)
    log = bench_log(voltage, rig(TRUE, voltage))
    free = [free_parameter(chosen.plant.parameters["stiffness"], 1.1, None)]
    problem = Problem(chosen, [log], free)
    slopes = problem.jacobian(problem.start)
    for width, height in product(np.arange(20.0, 80.0, 5.0), (1.0, 3.0, 7.0)):
        bump = height * np.exp(-(((np.arange(600) - 300.0) / width) ** 2))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = covariance(problem, slopes, bump)
        white = covariance(problem, slopes, np.random.default_rng(1).permutation(bump))
        assert np.isfinite(found).all()
        assert found[0, 0] > 1.5 * white[0, 0]


def told(slopes: Array) -> Information:
    """What smooth slopes tell, as they are."""
    p = slopes.shape[1]
    return Information(slopes, np.empty((p, 0)), np.zeros(len(slopes)), np.zeros(p))


def test_a_parameter_that_moves_nothing_but_rounding_has_no_standard_error() -> None:
    """As a delay of which a hold after it shows nothing."""
    chosen = nominal()
    voltage = prbs(600, 1)
    names = ("stiffness", "torque_constant")
    free = [free_parameter(chosen.plant.parameters[name], TRUE[name], None) for name in names]
    problem = Problem(chosen, [bench_log(voltage, rig(TRUE, voltage))], free)
    slopes = problem.jacobian(problem.start)
    alone = spread_of(problem, problem.start, told(slopes * [0.0, 1.0]))
    rounding = 1e-15 * np.random.default_rng(1).standard_normal(len(slopes))
    slopes[:, 0] = np.abs(slopes).max() * rounding
    found = spread_of(problem, problem.start, told(slopes))
    assert found.slopes[0] == 0.0
    assert found.standard_errors[0] == np.inf
    assert found.standard_errors[1] == alone.standard_errors[1]


# What is printed


@given(st.floats(-1e12, 1e12), st.floats(1e-12, 1e12))
def test_a_value_is_printed_to_the_digits_of_its_error(value: float, error: float) -> None:
    shown, spread = with_error(value, error)
    assert float(spread) == pytest.approx(error, rel=0.051)
    digits = len(re.sub(r"e.*|^-?0*\.?0*|\.", "", shown))
    if digits < MOST_DIGITS and value:
        assert abs(float(shown) - value) <= 0.0501 * max(float(spread), 0.0)
    assert digits <= MOST_DIGITS or float(shown) == 0.0


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (95.1801867, 0.139384, ("95.18", "0.14")),
        (-3.17631, 0.0957138, ("-3.176", "0.096")),
        (241560.0, 3204.0, ("241600", "3200")),
        (1.9996, 0.0996, ("2.00", "0.10")),
        (7.246e-7, 1.2e-9, ("7.246e-07", "1.2e-09")),
        (0.02, 300.0, ("0.020", "300")),
        (0.0, 0.3, ("0.00", "0.30")),
        (5.2277, None, ("5.2277", "")),
        # six digits of what the data do not determine were six digits too many
        (5.2277, float("inf"), ("5.2", "")),
        (-34712.0, float("inf"), ("-35000", "")),
        (5.2277, float("nan"), ("5.2277", "")),
    ],
)
def test_printed_values(value: float, error: float | None, expected: tuple[str, str]) -> None:
    assert with_error(value, error) == expected


def test_a_parameter_on_its_bound_is_there_to_the_last_bit() -> None:
    """Searches stop short of bounds; an effect that the data want off has to be off."""
    found = fit(nominal(), [noisy(17)], ["torque_constant", "coulomb_friction.level"])
    assert found.fitted.values["coulomb_friction.level"] == 0.0
    assert np.isnan(found.standard_errors[-1])


def test_logs_all_held_out_cost_no_simulation(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are simulated before and after the fit only."""
    voltage = prbs(200, 1)
    log = bench_log(voltage, rig(TRUE, voltage))
    other = replace(log, name="other", held_out=np.ones(200, dtype=bool))
    counted: list[str] = []
    plain = Run.errors

    def errors(self: Run, values: dict[str, float]) -> Array:
        counted.append(self.log.name)
        return plain(self, values)

    monkeypatch.setattr(Run, "errors", errors)
    fit(nominal(), [other, log], ["torque_constant"])
    assert set(counted) == {"rig"}


def test_a_parameter_without_room_has_slope_zero_and_is_left_where_it_is() -> None:
    """As a compliance at its largest value, which a softer spring than logs show may not leave."""
    chosen = nominal()
    voltage = prbs(600, 1)
    stiffness, constant = (
        free_parameter(chosen.plant.parameters[name], TRUE[name], None)
        for name in ("stiffness", "torque_constant")
    )
    held = replace(stiffness, low=TRUE["stiffness"], high=TRUE["stiffness"])
    problem = Problem(chosen, [bench_log(voltage, rig(TRUE, voltage))], [held, constant])
    start = problem.start * [1.0, 0.9]
    widths = np.array([0.1, 0.1])
    slopes = problem.jacobian(start, widths)
    assert np.all(slopes[:, 0] == 0.0)
    assert slopes[:, 1].any()
    vector, _, _ = descend(problem, start, 1e-9, 50, widths)
    stiff = changed(chosen, {"stiffness": TRUE["stiffness"]})
    alone = Problem(stiff, problem.logs, [constant])
    best, _, _ = descend(alone, 0.9 * alone.start, 1e-9, 50, widths[1:])
    assert vector == pytest.approx([start[0], best[0]], rel=1e-6)
