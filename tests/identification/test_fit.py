"""Fits by simulation error: against exact solutions, another optimiser, and laws.

The rig is the linear torque motor, simulated by the matrix exponential from the valve
paper's equations, which shares nothing with the product's integrator.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.block import Param
from servo_models.core.plant import Parameter
from servo_models.core.types import Array
from servo_models.data.log import Channel
from servo_models.errors import UserError
from servo_models.identification import fit as fit_module
from servo_models.identification.doubts import FROM_PRIOR, PULLED, doubt
from servo_models.identification.fit import fit
from servo_models.identification.linear_inference import Information, covariance, spread_of
from servo_models.identification.optimise import descend
from servo_models.identification.problem import Free, Problem, free_names, free_parameter
from servo_models.identification.simulation import Run, false_starts, prepared
from servo_models.report.numbers import MOST_DIGITS, with_error
from tests.support.exact_motor import STEP, TRUE, bench_log, noisy, nominal, prbs, rig
from tests.support.logs import changed, log_of, measured

NAMES = ("torque_constant", "inductance", "friction_coefficient")


def test_a_clean_log_gives_the_constants_back() -> None:
    voltage = prbs(1000, 1)
    found = fit(nominal(), [bench_log(voltage, rig(TRUE, voltage))], NAMES)
    assert found.converged
    for free, value in zip(found.free, found.values):
        assert value == pytest.approx(TRUE[free.name], rel=2e-5)


def test_it_is_the_least_squares_estimate_of_another_optimiser_on_another_simulator() -> None:
    log = noisy(3)

    def curve(_: Array, *values: float) -> Array:
        return rig({**TRUE, **dict(zip(NAMES, values))}, log.inputs["voltage"])

    start = [nominal().values[name] for name in NAMES]
    best, covariance = curve_fit(curve, log.times, log.outputs["angle"], start, method="lm")
    found = fit(nominal(), [log], NAMES)
    errors = np.sqrt(np.diag(covariance))
    assert np.abs(found.values - best).max() < 1e-2 * errors.max()
    # white noise: the coloured-noise formula must come near the textbook's
    np.testing.assert_allclose(found.standard_errors, errors, rtol=0.35)


@pytest.mark.long
def test_standard_errors_cover_the_truth_in_coloured_noise() -> None:
    """Of 60 rigs, 95 % intervals cover between 85 and 100 % with probability above 0.999."""
    inside = 0
    for seed in range(60):
        log = noisy(seed, sigma=0.0, count=900)
        white = np.random.default_rng(seed + 50).standard_normal(900)
        coloured = np.empty(900)
        level = 0.0
        for i, shock in enumerate(white):
            level = 0.9 * level + shock
            coloured[i] = 2e-4 * level
        noised = replace(log, outputs={"angle": log.outputs["angle"] + coloured})
        chosen = nominal(inductance=TRUE["inductance"], torque_constant=5.2)
        found = fit(chosen, [noised], ["torque_constant"])
        inside += abs(found.values[0] - TRUE["torque_constant"]) < 1.96 * found.standard_errors[0]
    print(inside)
    assert inside >= 49


def test_a_wide_prior_changes_nothing_and_a_tight_one_holds() -> None:
    log = noisy(5)
    bare = fit(nominal(), [log], NAMES)
    wide = fit(nominal(), [log], NAMES, {"torque_constant": 1e3})
    tight = fit(nominal(), [log], NAMES, {"torque_constant": 1e-9})
    np.testing.assert_allclose(wide.values, bare.values, rtol=1e-5)
    assert tight.values[0] == pytest.approx(nominal().values["torque_constant"], abs=1e-7)
    assert any("from its prior only" in said for said in tight.warnings)


def test_a_value_that_is_pulled_off_its_prior_is_not_said_to_be_from_it() -> None:
    """A ripple that the model lacks, an error that is alike for long: as uncertain as the prior."""
    free = Free("k", 0.0, 10.0, 5.0, 1.0, nominal=5.0, prior=1.0)
    assert doubt(free, 5.4, 0.9) == FROM_PRIOR
    assert doubt(free, 8.0, 0.9) == PULLED
    assert doubt(free, 8.0, 2.0) == PULLED
    assert doubt(free, 8.0, 0.3) == ""


def test_alike_parameters_in_white_noise_are_pulled_by_nothing_but_their_noise() -> None:
    """Slowly, only a ratio of three constants shows: each stays 0.8 priors uncertain, and moves."""
    true = {"torque_constant": 0.97, "resistance": 1.03, "stiffness": 1.03}
    start = nominal()
    rig = changed(start, {n: v * start.values[n] for n, v in true.items()})
    times = 2e-3 * np.arange(5000)
    slow = measured(rig, times, {"voltage": 8.0 * np.sin(0.2 * np.pi * times)}, {"angle": 3e-4}, 2)
    priors = {name: 0.02 * start.values[name] for name in true}
    found = fit(start, [slow], tuple(true), priors)
    assert np.all(found.standard_errors > 0.7 * np.array(list(priors.values())))
    assert not any("was pulled" in text for text in found.warnings)


def test_settled_logs_at_several_levels_determine_what_holds_at_rest() -> None:
    """Three standstills at different voltages: the stiffness is the slope of angle over torque."""
    known = nominal().values
    gain = known["torque_constant"] / (known["resistance"] * 1.32)
    times, logs = 1e-3 * np.arange(300), []
    for level in (2.0, 4.0, -3.0):
        volts = {"voltage": np.full(300, level)}
        noise = 1e-5 * np.random.default_rng(1).standard_normal(300)
        angle = {"angle": gain * level + noise}
        logs.append(log_of(times, volts, angle, name=f"{level:g} V", settle=1.0))
    found = fit(nominal(), logs, ["stiffness"])
    assert found.values[0] == pytest.approx(1.32, rel=2e-3)
    with pytest.raises(UserError, match="no input ever changes"):
        fit(nominal(), logs[:1], ["stiffness"])


def test_samples_held_out_are_never_seen() -> None:
    log = noisy(7)
    half = np.arange(len(log.times)) >= 750
    poisoned = np.where(half, 1.0, log.outputs["angle"])
    seen = fit(nominal(), [replace(log, held_out=half)], NAMES)
    same = fit(nominal(), [replace(log, held_out=half, outputs={"angle": poisoned})], NAMES)
    assert np.array_equal(seen.values, same.values)
    assert seen.rms("angle", "held out") == pytest.approx(2e-4, rel=0.1)


def test_logs_with_constants_of_their_own() -> None:
    """The same rig at two known stiffnesses; wrong constants would give a wrong answer."""
    voltage = prbs(800, 11)
    logs = [
        bench_log(
            voltage,
            rig({**TRUE, "stiffness": stiffness}, voltage),
            f"k{stiffness:g}",
            constants={"stiffness": stiffness},
        )
        for stiffness in (0.9, 1.4)
    ]
    found = fit(nominal(), logs, NAMES)
    assert found.values[0] == pytest.approx(TRUE["torque_constant"], rel=2e-5)
    with pytest.raises(UserError, match="every log states 'stiffness'"):
        fit(nominal(), logs, ["stiffness"])


def test_a_constant_load_of_one_log_is_an_input() -> None:
    """A load of 0.01 N m turns the resting angle by load / K_s."""
    voltage = np.zeros(400)
    log = bench_log(voltage, np.full(400, -0.01 / 1.1), constants={"load_torque": 0.01}, settle=0.5)
    found = Problem(nominal(), [log], []).responses(np.empty(0))[0]["angle"]
    np.testing.assert_allclose(found, -0.01 / 1.1, rtol=1e-6)


def test_a_settled_log_begins_in_equilibrium() -> None:
    voltage = np.full(200, 10.0)
    rest = 10.0 / TRUE["resistance"] * TRUE["torque_constant"] / TRUE["stiffness"]
    chosen = nominal(torque_constant=TRUE["torque_constant"])
    log = bench_log(voltage, np.full(200, rest), settle=0.5)
    found = Problem(chosen, [log], []).responses(np.empty(0))[0]["angle"]
    np.testing.assert_allclose(found, rest, rtol=1e-6)


@pytest.mark.parametrize("settle", [0.0, 0.2])
def test_a_log_that_begins_in_another_state_is_warned_of(settle: float) -> None:
    """The rig has held its first row if the model begins at rest, and the other way round."""
    voltage = np.repeat([20.0, -15.0, 5.0, 0.0, 10.0], 300)
    before = np.full(0 if settle else 400, voltage[0])
    angle = rig(TRUE, np.concatenate([before, voltage]))[len(before) :]
    log = replace(bench_log(voltage, angle), settle=settle)
    same = {name: TRUE[name] for name in TRUE if name in nominal().values}
    (text,) = false_starts([prepared(nominal(), log)], same)
    assert "'rig' begins in another state than the model" in text
    assert ("begins at rest:" in text) == (settle == 0.0)
    fair = replace(log, settle=0.2 - settle)
    assert not [*false_starts([prepared(nominal(), fair)], same)]
    jumps = np.concatenate([[1.0, -1.0], np.zeros(len(angle) - 2)])  # a current is no state
    both = replace(fair, outputs={"angle": angle, "current": jumps})
    assert not [*false_starts([prepared(nominal(), both)], same)]
    wrong, right = (fit(nominal(**same), [one], ["stiffness"]) for one in (log, fair))
    assert (wrong.believable, right.believable) == (False, True)


def test_an_effect_is_found_from_off() -> None:
    """Dead zone has no slope at 0; the search starts from its typical size."""
    voltage = prbs(1500, 13, hold=40, size=6.0)
    dead = np.sign(voltage) * np.maximum(np.abs(voltage) - 1.5, 0.0)
    log = bench_log(voltage, rig(TRUE, dead))
    chosen = nominal(torque_constant=5.4, inductance=31.0)
    voltages = np.where(np.arange(1500) < 700, 0.5, 1.0) * voltage
    dead = np.sign(voltages) * np.maximum(np.abs(voltages) - 1.5, 0.0)
    log = bench_log(voltages, rig(TRUE, dead))
    found = fit(chosen, [log], ["torque_constant", "drive_dead_zone.half_width"])
    assert found.values == pytest.approx([5.4, 1.5], rel=1e-4)


@pytest.mark.thorough
def test_global_search_leaves_a_valley_that_traps_slopes() -> None:
    """The delay of a tone burst is ambiguous by its period to whoever follows the slope."""
    grid = np.arange(1200)
    burst = 15.0 * np.sin(2.0 * np.pi * 250.0 * STEP * grid) * np.exp(-(((grid - 500) / 60) ** 2))
    shift = 14
    log = bench_log(burst, rig(TRUE, np.concatenate([np.zeros(shift), burst[:-shift]])))
    true = {name: TRUE[name] for name in NAMES}
    chosen = nominal(**true, **{"transport_delay.time": 1e-3})
    free = ["transport_delay.time"]
    local = fit(chosen, [log], free)
    assert abs(local.values[0] - shift * STEP) > 3e-3
    whole = fit(nominal(**true), [log], free, kind="global", seed=2)
    assert whole.values[0] == pytest.approx(shift * STEP, abs=2e-5)


def test_warnings_name_what_the_log_does_not_tell() -> None:
    log = noisy(17)
    scaled = ["torque_constant", "stiffness", "rotor_inertia", "friction_coefficient"]
    ratio = fit(nominal(inductance=31.0), [log], scaled)
    assert any("the data do not determine 'stiffness'" in said for said in ratio.warnings)
    assert any("ill-conditioned" in said for said in ratio.warnings)
    pair = fit(nominal(**TRUE), [log], ["torque_constant", "stiffness"])
    assert any(
        "'torque_constant' and 'stiffness' cannot be told apart" in said for said in pair.warnings
    )
    card = pair.report().cards[0]
    assert "2 of 2 determined only together" in card.text
    assert card.passed is None
    edge = fit(nominal(), [log], ["torque_constant", "coulomb_friction.level"])
    assert any("'coulomb_friction.level' sits on its low bound" in said for said in edge.warnings)
    unseen = fit(nominal(), [log], ["torque_constant", "stribeck_friction.speed"])
    assert any("'stribeck_friction.speed' is not excited" in said for said in unseen.warnings)


def test_an_interrupted_search_keeps_its_best_point(monkeypatch: pytest.MonkeyPatch) -> None:
    log = noisy(19)
    plain = Problem.residuals
    counts = {"calls": 0}

    def impatient(self: Problem, vector: Array) -> Array:
        counts["calls"] += 1
        if counts["calls"] == 6:
            raise KeyboardInterrupt
        return plain(self, vector)

    monkeypatch.setattr(Problem, "residuals", impatient)
    found = fit(nominal(), [log], NAMES)
    assert found.interrupted
    assert not found.converged
    assert found.warnings[-1].startswith("stopped before it converged")
    assert found.accuracy[0].after < 0.5 * found.accuracy[0].before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"free": []}, "no parameter is free: name some with --free"),
        ({"free": ["torque_constnt"]}, "did you mean 'torque_constant'"),
        ({"kind": "loca"}, "did you mean 'local'"),
    ],
)
def test_a_wrong_question_is_refused(change: dict[str, object], words: str) -> None:
    request = {"free": ["torque_constant"], **change}
    with pytest.raises(UserError, match=words):
        fit(nominal(), [noisy(1, count=100)], **request)  # type: ignore[arg-type]


def test_too_few_samples_to_fit() -> None:
    log = noisy(1, count=100)
    with pytest.raises(UserError, match="2 samples to fit for 3 free parameters"):
        fit(nominal(), [replace(log, held_out=np.arange(100) > 1)], NAMES)


def test_an_effect_means_all_of_its_parameters() -> None:
    plant = nominal().plant
    assert free_names(plant, "stiffness") == ("stiffness",)  # no letters of a text
    names = free_names(plant, ["stribeck_friction", "stiffness"])
    assert set(names) == {"stribeck_friction.excess", "stribeck_friction.speed", "stiffness"}


@given(st.floats(-5.0, 5.0), st.floats(0.0, 3.0), st.sampled_from([None, 0.2]))
def test_a_free_parameter_starts_inside_its_bounds(
    value: float, typical: float, prior: float | None
) -> None:
    param = Param("1", "", low=-5.0, high=5.0, typical=typical, switch=True)
    free = free_parameter(Parameter("x", param, ""), value, prior)
    assert free.low <= free.start <= free.high
    assert free.scale > 0.0


def test_the_modules_share_one_list_of_methods() -> None:
    assert set(fit_module.METHODS) == set(fit_module.SEARCHES)


FREE_NAMES = tuple(name for name in nominal().plant.parameters if name != "internal_step")


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    names=st.lists(st.sampled_from(FREE_NAMES), min_size=1, max_size=4, unique=True),
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
