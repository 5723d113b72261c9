"""What check, identify and diagnose are sure of, where steps, holds and friction make slopes rough.

Groups of parameters that are exactly degenerate are known from the equations of the plant, and
confirmed by scaling them in the model; all three commands have to name them, and nothing else.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.diagnosis.diagnose import diagnose
from servo_models.identification.check import check
from servo_models.identification.fit import fit
from servo_models.identification.identify import identify
from servo_models.identification.linear_inference import _principal, _Probes, information, spread
from servo_models.identification.optimise import descend
from servo_models.identification.problem import Problem, free_parameter
from tests.support.logs import changed, log_of, measured

FREE = ("inertia", "torque_constant", "resistance", "loop_factor")
PAIR = {"inertia", "resistance"}
TIMES = 5e-3 * np.arange(600)


def goals(seed: int) -> Array:
    """Steps of up to 0.8 rad, large enough to saturate the duty."""
    levels = np.random.default_rng(seed).uniform(-0.8, 0.8, 12)
    levels[0] = 0.0
    return np.repeat(levels, 50)


def servo(**values: float) -> Model:
    return model("smart_servo", "sts3215", {k.replace("__", "."): v for k, v in values.items()})


def logged(chosen: Model, noise: float = 0.0, seed: int = 0, output: str = "angle") -> Log:
    return measured(chosen, TIMES, {"goal": goals(seed)}, {output: noise}, seed)


@pytest.fixture(scope="module")
def issued(tmp_path_factory: pytest.TempPathFactory) -> Description:
    """The log of a servo that differs by its inertia and resistance, whose product counts."""
    folder = tmp_path_factory.mktemp("rig")
    log = logged(servo(inertia=0.036, resistance=4.471))
    rows = zip(log.times, log.inputs["goal"], log.outputs["angle"])
    lines = ["t,goal,angle", *(f"{t:.6g},{u!r},{y!r}" for t, u, y in rows)]
    (folder / "log.csv").write_text("\n".join(lines).replace("np.float64(", "").replace(")", ""))
    (folder / "rig.toml").write_text(
        f'actuator = "smart_servo"\nvariant = "sts3215"\nfree = {list(FREE)!r}\n'
        '[[logs]]\nfile = "log.csv"\ntime = { column = "t" }\n'
        'inputs.goal = { column = "goal", unit = "rad" }\n'
        'outputs.angle = { column = "angle", unit = "rad" }\n'.replace("'", '"')
    )
    return read_description(folder / "rig.toml")


def alone(told: Description) -> Description:
    """The same where nothing else is known of the parameters."""
    return replace(told, uncertainty={})


def test_inertia_and_resistance_count_as_a_product_only() -> None:
    """What the tests below rely on: exactly nothing changes."""
    before = logged(servo(inertia=0.036, resistance=4.471)).outputs["angle"]
    after = logged(servo(inertia=0.018, resistance=8.942)).outputs["angle"]
    assert np.array_equal(before, after)


def test_check_does_not_call_a_product_determined(issued: Description) -> None:
    found = check(alone(issued))
    assert [set(group) for group in found.identifiability.together] == [PAIR]
    assert any("cannot be told apart" in text for text in found.warnings)
    reaches = {reach.name: reach for reach in found.identifiability.parameters}
    assert all(reaches[name].together > 1.0 for name in PAIR)
    assert all(reaches[name].together < 0.1 for name in set(FREE) - PAIR)


def test_identify_gives_a_product_no_standard_error(issued: Description) -> None:
    found = identify(alone(issued)).result
    assert [set(group) for group in found.groups] == [PAIR]
    errors = dict(zip(FREE, found.standard_errors))
    assert all(errors[name] == np.inf for name in PAIR)
    assert all(errors[name] < 0.05 * found.fitted.values[name] for name in set(FREE) - PAIR)
    told = [text for text in found.warnings if "cannot be told apart" in text]
    assert len(told) == 1
    assert all(f"'{name}'" in told[0] for name in PAIR)
    values = dict(zip(FREE, found.values))
    product = values["inertia"] * values["resistance"]
    assert product == pytest.approx(0.036 * 4.471, rel=0.02)


@pytest.mark.thorough
def test_diagnose_says_that_a_product_is_known_together_only(issued: Description) -> None:
    found = diagnose(issued)
    assert [set(group) for group in found.selection.taken.together] == [PAIR]
    sheet = str(found)
    assert "only together" in sheet
    for value, error in re.findall(r"([-\d.e+]+) \+- ([\d.e-]+)", sheet):
        assert float(error) > 1e-6 * abs(float(value))  # no clock is known to a millionth
    errors = {one.name: one.standard_error for one in found.found}
    priors = issued.uncertainty
    assert all(0.3 * priors[name] < errors[name] <= 1.01 * priors[name] for name in PAIR)


@pytest.mark.parametrize("rough", [False, True])
def test_what_a_log_determines_is_in_no_group(rough: bool) -> None:
    values = {} if rough else {"sensor_quantisation__step": 0.0, "sample_hold__period": 0.0}
    chosen = servo(**values)
    found = fit(chosen, [logged(chosen, noise=2e-3)], ["torque_constant", "loop_factor", "inertia"])
    assert found.groups == ()
    assert np.isfinite(found.standard_errors).all()


@pytest.mark.long
def test_intervals_hold_the_truth_on_rough_responses() -> None:
    """20 logs through a coarse encoder and dry friction, with white noise on the reading.

    A log that the model itself made may be met to its very steps, and better than a rig's, so
    widths are judged by the slopes of the same servo without an encoder.
    """
    step, friction, noise = 6e-3, 0.05, 5e-3
    true = servo(sensor_quantisation__step=step, coulomb_friction__level=friction)
    smooth = servo(sensor_quantisation__step=0.0, coulomb_friction__level=friction)
    names = ("torque_constant", "loop_factor")
    start = changed(true, {n: 1.2 * true.values[n] for n in names})
    truth = np.array([true.values[name] for name in names])
    wrong, widths = [], []
    for seed in range(20):
        log = logged(true, noise, seed, "angle_reading")
        found = fit(start, [log], names, jobs=1)
        free = [free_parameter(smooth.plant.parameters[n], true.values[n], None) for n in names]
        twin = Problem(smooth, [log], free, sigma={"angle_reading": noise})
        slopes = twin.jacobian(np.ones(2), np.full(2, 0.03))
        smallest = truth * np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
        wrong += list((found.values - truth) / found.standard_errors)
        widths += list(found.standard_errors / smallest)
    # of 40 nominal 95 % intervals, 29 and fewer hold with a probability below 1e-5
    assert np.sum(np.abs(wrong) < 1.96) > 29
    assert 1.0 / 1.5 < np.median(widths) < 1.5


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_fit_on_a_rough_surface_leaves_no_more_than_the_truth(seed: int) -> None:
    """Least squares end in a dent: a held and rounded voltage left up to eight times as much."""
    rough = {
        "command_quantisation.step": 0.5,
        "sample_hold.period": 1e-3,
        "sensor_quantisation.step": 1e-4,
        "end_stops.half_range": 0.0,
    }
    nominal = model("torque_motor", "measured", rough)
    factors = {"torque_constant": 1.2, "inductance": 0.85, "friction_coefficient": 1.15}
    values = {name: factor * nominal.values[name] for name, factor in factors.items()}
    random = np.random.default_rng(seed)
    times, n = 1e-3 * np.arange(500), 500
    voltage = np.interp(times, np.linspace(0.0, 0.5, 9), [0.0, *random.uniform(-15.0, 15.0, 8)])
    truth = changed(nominal, values)
    exact = simulate(truth, times, {"voltage": voltage})["angle"]
    angle = exact + 1e-3 * np.std(exact) * random.standard_normal(n)
    log = log_of(times, {"voltage": voltage}, {"angle": angle})
    fitted = fit(nominal, [log], list(factors), jobs=1).fitted
    left = angle - simulate(fitted, times, {"voltage": voltage})["angle"]
    assert np.sum(left**2) <= np.sum((angle - exact) ** 2)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 1.5e-3, 6e-3]), st.floats(0.0, 0.1))
def test_slopes_of_a_product_cancel(seed: int, step: float, friction: float) -> None:
    """Gain and loop factor count as a product whatever is in the loop."""
    chosen = servo(sensor_quantisation__step=step, coulomb_friction__level=friction)
    names = ("gain", "loop_factor", "torque_constant")
    free = [free_parameter(chosen.plant.parameters[n], chosen.values[n], None) for n in names]
    problem = Problem(chosen, [logged(chosen, 2e-3, seed)], free, sigma={"angle": 2e-3})
    told = information(problem, problem.start)
    assert told.groups == ((0, 1),)
    assert np.linalg.norm(told.slopes @ [1.0, -1.0, 0.0]) < 0.02 * np.linalg.norm(told.slopes)


def test_a_delay_beside_a_hold_is_known_to_the_tick() -> None:
    """Steps of the command come at multiples of 20 ms, where the hold ticks: a delay between two
    ticks is any of them."""
    values = {"sample_hold.period": 0.02, "transport_delay.time": 0.03, "supply_limit.share": 0.0}
    chosen = model("sg90", "measured", values)
    times = 4e-3 * np.arange(500)
    pulse = 1.5e-3 + 3e-4 * np.repeat(np.random.default_rng(1).uniform(-1.0, 1.0, 10), 50)
    pulse[:50] = 1.5e-3
    log = measured(chosen, times, {"pulse_width": pulse}, {"angle": 1e-3}, seed=2)
    found = fit(chosen, [log], ["transport_delay.time", "motor_gain"])
    assert found.standard_errors[0] >= 0.02 / np.sqrt(12.0) / 2.0


def slow_drive(seed: int) -> tuple[Model, Log]:
    """A position loop through an encoder, with dry friction; its log is nearly without noise."""
    random = np.random.default_rng(seed)
    rough = {"sensor_quantisation.step": 1e-5, "coulomb_friction.level": 20.0, "sample_time": 1e-3}
    true = model("linear_drive", "simple", rough)
    times = 4e-3 * np.arange(400)
    waves = [np.sin(2.0 * np.pi * random.uniform(0.5, 4.0) * times) for _ in range(6)]
    reference = np.asarray(1e-4 * np.sum(waves, axis=0))
    found = simulate(true, times, {"reference": reference})
    outputs = {
        name: found[name] + 1e-3 * np.std(found[name]) * random.standard_normal(len(times))
        for name in ("position", "drive")
    }
    return true, log_of(times, {"reference": reference}, outputs)


@pytest.mark.long
def test_a_dent_of_a_rough_surface_is_no_knowledge() -> None:
    """Viscous friction hardly shows beside dry friction: a fit ends in a dent, next to which all
    is worse, and its value there is not known for that."""
    names = ("mass", "viscous_coefficient", "force_gain", "coulomb_friction.level")
    for seed in range(8):
        true, log = slow_drive(seed)
        away = np.clip(np.random.default_rng(1000 + seed).standard_normal(len(names)), -2.0, 2.0)
        values = {name: true.values[name] * (1.0 + 0.2 * z) for name, z in zip(names, away)}
        start = changed(true, values)
        found = fit(start, [log], names, jobs=1)
        error = np.abs(found.values - np.array([true.values[name] for name in names]))
        assert np.all(error < 5.0 * found.standard_errors), (seed, error / found.standard_errors)


def test_the_count_of_a_fast_ripple_is_known_as_well_as_its_slopes_say() -> None:
    """1 % of it turns the phase by several rad, so that no slope holds over so much."""
    true = {"cogging.torque": 2e-4, "cogging.count": 36.0, "cogging.phase": 0.5}
    rig = model("dc_motor_speed", "direct", true)
    times, noise = 4e-3 * np.arange(1000), 1e-4
    log = measured(rig, times, {"speed_command": np.full(1000, 1.1)}, {"encoder_angle": noise}, 5)
    free = [free_parameter(rig.plant.parameters[name], true[name], None) for name in true]
    problem = Problem(rig, [log], free, {"encoder_angle": noise})
    vector, _, _ = descend(problem, problem.nominal, 1e-10, 20)
    narrow = problem.jacobian(vector, np.full(len(free), 1e-5))
    bound = np.sqrt(np.diag(np.linalg.inv(narrow.T @ narrow)))
    found = spread(problem, vector)
    assert not found.groups
    np.testing.assert_allclose(found.standard_errors / problem.scales, bound, rtol=0.15)


@given(st.integers(0, 10_000), st.floats(1e-3, 1e3), st.sampled_from([-1.0, 1.0]))
def test_of_two_slopes_along_one_line_one_combination_is_seen_and_one_is_not(
    seed: int, size: float, sign: float
) -> None:
    """Whatever rounding makes of J'J, which has no inverse."""
    line = np.random.default_rng(seed).standard_normal(1000)
    slopes = np.outer(line, [1.0, sign * size])
    random = np.array([1e-3, 1e-3])
    known = _Probes(np.eye(2), slopes, random, random, np.zeros((1000, 2)), random > 1.0)
    own, along, shares = _principal(known, np.arange(2))
    seen, unseen = np.linalg.norm(own @ along, axis=0)
    assert seen == pytest.approx(1.0)
    assert unseen < 1e-3
    assert shares[0] < 1e-3
    assert shares[1] > 1e3
