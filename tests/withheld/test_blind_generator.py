"""The generator of withheld cases against the product's own simulation, and what it draws from."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest, norm

from servo_models.analysis.linearise import linearise
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuator, model
from servo_models.validation.torque_motor.reference import Constants, Contact
from servo_models.withheld.generator.cases import (
    CLEAN,
    COLOURED,
    LEAST_VALUE,
    TIERS,
    VISIBLE,
    Acting,
    another_command,
    draw_case,
    draw_experiment,
    large_step,
    load_profile,
    rich,
    sized,
    with_log,
)
from servo_models.withheld.generator.causes import CATALOGUE, FOREIGN, Cause, draw
from servo_models.withheld.generator.rigs import RIGS, Rig
from servo_models.withheld.generator.simulation import Experiment, Plan

pytestmark = pytest.mark.thorough

Array = NDArray[np.float64]

SERVO, MOTOR, BUS, PULSE, LOOP, WOUND, FREE = RIGS

every_bench = pytest.mark.parametrize("rig", RIGS, ids=lambda b: b.actuator)


def experiment(rig: Rig, plans: tuple[Plan, ...], load: float = 0.0) -> Experiment:
    """The nominal rig; its delay is a whole number of steps."""
    places = tuple(place for _, place in rig.readings[:2])
    return Experiment(rig, rig.nominal, load, plans, places, seed=5)


def product(e: Experiment, parameters: dict[str, float]) -> tuple[Array, ...]:
    """What the product's own simulation says, one array per log as the experiment's."""
    true = {name: value for name, value in e.true.items() if name in e.rig.nominal}
    chosen = model(e.rig.actuator, e.rig.variant, {**true, **parameters})
    known = {place: signal.name for signal, place in (*e.rig.readings, *e.rig.further)}
    logs = []
    for plan in e.plans:
        rows = np.arange(len(plan.command))
        times = np.concatenate([[0.0], e.rig.settle + rows * plan.stride * e.rig.step])
        command, shares = (np.append(rows[0], rows) for rows in (plan.command, plan.shares))
        inputs = {e.rig.command.name: command, "load_torque": e.load * shares}
        inputs |= {k: np.full(len(times), v) for k, v in e.true.items() if k not in true}
        found = simulate(chosen, times, inputs)
        logs.append(np.column_stack([found[known[place]][1:] for place in e.readings]))
    return tuple(logs)


def rms(one: tuple[Array, ...], other: tuple[Array, ...]) -> float:
    """RMS difference in the judged reading."""
    apart = np.concatenate([a[:, 0] - b[:, 0] for a, b in zip(one, other)])
    return float(np.sqrt(np.mean(apart * apart)))


def ladder(rig: Rig) -> tuple[Plan, ...]:
    """Steps beyond any amplitude that is drawn: the servo's drive and the motor's stops."""
    levels = np.array([0.0, 1.2, -1.6, 1.6, 0.1, -0.1]) * rig.amplitude[1]
    stride = rig.sampling[0]
    rows = round(3.0 * rig.slowest / (stride * rig.step))
    return (Plan(stride, rig.rest + np.repeat(levels, rows)),)


PLANS = {
    "rich": lambda rig: rich(rig, np.random.default_rng(1), 1),
    "sparse": lambda rig: rich(rig, np.random.default_rng(2), 4),
    "large step": lambda rig: large_step(rig, np.random.default_rng(3)),
    "ladder": ladder,
}


@every_bench
@pytest.mark.parametrize("excitation", PLANS)
@pytest.mark.parametrize("load", [0.0, 0.5])
def test_without_a_cause_it_is_the_products_model(rig: Rig, excitation: str, load: float) -> None:
    e = experiment(rig, PLANS[excitation](rig), load * rig.load[1])
    for own, other in zip(e.plain, product(e, {})):
        assert np.all(np.abs(own - other).max(axis=0) < 1e-3 * np.ptp(other, axis=0))


@pytest.mark.parametrize(
    ("rig", "supply"), [(SERVO, {"supply_voltage": 3.5}), (BUS, {"supply": 5.0}), (PULSE, {})]
)
def test_what_is_set_and_measured_besides_is_the_products(
    rig: Rig, supply: dict[str, float]
) -> None:
    e = experiment(rig, ladder(rig), 0.5 * rig.load[1])
    further = tuple(place for _, place in rig.further)
    e = replace(e, true={**e.true, **supply}, readings=(*e.readings, *further))
    (own,), (other,) = e.plain, product(e, {})
    assert np.all(np.sqrt(np.mean((own - other) ** 2, axis=0)) < SAME * np.ptp(other, axis=0))


def test_what_is_taken_away_is_no_cause_any_more() -> None:
    case = draw_case(3, 1, "hard")
    e, gone = case.experiment, {f"{it.name}.size": 0.0 for it in (*case.acting, *case.hidden)}
    assert gone
    (one,) = with_log(case, e.plans[0].command, np.random.default_rng(1), gone).further
    np.testing.assert_array_equal(one.noise_free[0], e.plain[0])


SAME = 0.01
OTHER_LAW = {
    "coulomb_friction": 0.03,
    "load_friction": 0.03,
    "stribeck_friction": 0.06,
    "presliding_friction": 0.25,
    "hysteresis": 0.15,
    "end_stops": 0.06,
    "backlash": 0.03,
    "coasting_backlash": 0.05,
}
"""Part of the gap that may differ: the law is another one on purpose, or bounces in a play."""


class Subject(NamedTuple):
    rig: Rig
    cause: Cause


SUBJECTS = [Subject(rig, cause) for rig in RIGS for cause in CATALOGUE[rig.actuator]]
FOREIGNERS = [Subject(rig, cause) for rig in RIGS for cause in FOREIGN[rig.actuator]]


def title(subject: Subject) -> str:
    return f"{subject.rig.actuator}-{subject.cause.name}-{subject.cause.size.name}"


def acting(subject: Subject, share: float) -> tuple[Experiment, Acting]:
    """A cause that makes a gap of ``share`` of the range."""
    rig = subject.rig
    plans = rich(rig, np.random.default_rng(1), 1)
    if subject.cause.name == "load_gain" or rig.integrators:
        rng = np.random.default_rng(6)
        plans = tuple(replace(it, load=load_profile(rig, len(it.command), rng)) for it in plans)
    load = 0.0 if subject.cause.name == "coasting_backlash" else rig.load[1]  # it closes the play
    e = experiment(rig, plans, load=load)
    drawn = draw(subject.cause, np.random.default_rng(4))
    return e, sized(e, drawn, share * float(e.ranges[0]), 0.2)


@pytest.mark.parametrize("subject", SUBJECTS, ids=title)
def test_a_cause_is_the_products_effect_of_that_size(subject: Subject) -> None:
    e, found = acting(subject, 0.02)
    assert VISIBLE[0] < found.gap / e.ranges[0] < VISIBLE[1]
    theirs = product(e, found.parameters(e.rig))
    bound = OTHER_LAW.get(found.name, SAME)
    if found.name == "sensor_quantisation" and "feedback.step" in found.settings(e):
        bound = 0.1  # a loop chatters between codes at the pace of either integrator
    assert rms(e.logs(found.settings(e)), theirs) < bound * found.gap


@pytest.mark.parametrize("subject", FOREIGNERS, ids=title)
def test_a_foreign_cause_shows_and_is_none_of_the_catalogue(subject: Subject) -> None:
    e, found = acting(subject, 0.02)
    assert VISIBLE[0] < found.gap / e.ranges[0] < VISIBLE[1]
    assert found.name not in actuator(e.rig.actuator).plant_of(e.rig.variant).placements


@every_bench
def test_every_name_is_one_of_the_products(rig: Rig) -> None:
    parameters = actuator(rig.actuator).plant_of(rig.variant).parameters
    values = model(rig.actuator, rig.variant).values
    uncertainty = actuator(rig.actuator).variant(rig.variant).uncertainty
    for cause in CATALOGUE[rig.actuator]:
        for seed in range(8):
            found = Acting(draw(cause, np.random.default_rng(seed)), float(seed % 2), 0.0)
            for name, value in found.parameters(rig).items():
                param = parameters[name].param
                assert param.low <= value <= param.high, name
    known = {name: it for name, it in uncertainty.items() if values[name]}
    assert {**rig.spread} == known
    for name, value in rig.nominal.items():
        assert value == pytest.approx(values[name], rel=1e-12), name


def test_a_setting_that_is_not_there_is_named() -> None:
    e = experiment(BUS, large_step(BUS, np.random.default_rng(3)))
    with pytest.raises(KeyError, match="no such setting"):
        e.logs({"gear.plai": 1.0})


def test_bristles_end_in_dry_friction_as_they_stiffen() -> None:
    e = experiment(MOTOR, large_step(MOTOR, np.random.default_rng(3)))
    t = e.true
    plan = e.plans[0]
    rows = np.arange(len(plan.command))
    times = np.concatenate([[0.0], MOTOR.settle + rows * plan.stride * MOTOR.step])
    exact = Contact(
        Constants(
            t["torque_constant"],
            t["back_emf_constant"],
            t["resistance"],
            t["inductance"],
            t["rotor_inertia"],
            t["friction_coefficient"],
            t["stiffness"],
        ),
        stop=math.radians(3.0),
        friction=2e-3,
    )
    inputs = {
        "voltage": np.concatenate([plan.command[:1], plan.command]),
        "load_torque": np.zeros(len(times)),
    }
    truth = (exact(times, inputs)["angle"][1:, None],)
    off = [
        rms(e.logs({"friction.coulomb": 2e-3, "friction.bristle_stiffness": k}), truth)
        for k in (50.0, 250.0, 1250.0)
    ]
    assert off[0] > 2.0 * off[1] > 4.0 * off[2]


def test_fastest_and_slowest_are_poles_of_the_paper() -> None:
    """Torque motor: eq. 9 with Table 1; servo: s^2 + s / T + omega^2 of eq. 7's form; the others
    as their own actuators have them, the smart servo without clock and codes."""
    from servo_models.validation.torque_motor.reference import TABLE_1

    _, denominator = TABLE_1.equation_9()
    poles = np.abs(np.roots(denominator))
    assert pytest.approx(1.0 / poles.max()) == MOTOR.fastest
    assert pytest.approx(1.0 / poles.min()) == MOTOR.slowest
    values = model("sg90", "measured").values
    lag = values["motor_time_constant"]
    gain = values["motor_gain"] * values["amplifier_gain"] / values["gear_ratio"]
    loop = gain * values["feedback_coefficient"] * values["potentiometer_gain"]
    poles = np.roots([lag, 1.0, loop])
    assert pytest.approx(1.0 / np.abs(poles.real).min()) == SERVO.slowest
    assert min(1.0 / np.abs(poles).max(), lag) == pytest.approx(SERVO.fastest)
    smooth = {"sample_hold.period": 0.0, "sensor_quantisation.step": 0.0}
    poles = np.linalg.eigvals(linearise(model(BUS.actuator, BUS.variant, smooth)).joint_a)
    assert 1.0 / np.abs(poles).max() == pytest.approx(BUS.fastest, rel=1e-6)
    assert 1.0 / np.abs(poles.real).min() == pytest.approx(BUS.slowest, rel=1e-6)
    poles = np.linalg.eigvals(linearise(model(LOOP.actuator, LOOP.variant)).joint_a)
    poles = poles[np.abs(poles) > 1e-6]  # the angle is an integral
    assert 1.0 / np.abs(poles).max() == pytest.approx(LOOP.fastest, rel=1e-6)
    assert 1.0 / np.abs(poles.real).min() == pytest.approx(LOOP.slowest, rel=1e-6)
    stiff = {"winding_lag.time_constant": 0.0}
    poles = np.linalg.eigvals(linearise(model(WOUND.actuator, WOUND.variant, stiff)).joint_a)
    assert 1.0 / np.abs(poles).max() == pytest.approx(WOUND.fastest, rel=1e-6)
    poles = np.linalg.eigvals(linearise(model(PULSE.actuator, PULSE.variant)).joint_a)
    assert 1.0 / np.abs(poles).max() == pytest.approx(PULSE.fastest, rel=1e-6)


def test_the_slowest_of_a_free_motor_is_the_time_that_it_says() -> None:
    """The output turned by 60 degrees at the no-load speed of 24 V; the bare rotor turned once by
    one ampere from rest, both without friction."""
    values = model(WOUND.actuator, WOUND.variant).values
    speed = 24.0 / values["torque_constant"] / values["gear_ratio"]
    assert speed * WOUND.slowest == pytest.approx(math.radians(60.0))
    values = model(FREE.actuator, FREE.variant).values
    pushed = values["torque_constant"] * 1.0 / values["rotor_inertia"]
    assert 0.5 * pushed * FREE.slowest**2 == pytest.approx(2.0 * math.pi)


@pytest.mark.parametrize("rig", [WOUND, FREE], ids=lambda b: b.actuator)
def test_steps_and_loads_bring_back_what_nothing_holds(rig: Rig) -> None:
    """As many sums of them as integrals lie before the angle end where they began."""
    rng = np.random.default_rng(9)
    for _ in range(20):
        step = draw_experiment(rig, "poor", rng).plans[0].command
        for signal in (step, load_profile(rig, len(step), rng)):
            assert signal[0] == 0.0
            assert np.abs(signal).max() > 0.1
            summed = signal
            for _ in range(rig.integrators):
                summed = np.cumsum(summed)
                assert abs(summed[-1]) < 1e-9


@every_bench
def test_true_constants_scatter_as_the_description_says(rig: Rig) -> None:
    rng = np.random.default_rng(8)
    drawn = [draw_experiment(rig, "poor", rng).true for _ in range(400)]
    for name, spread in rig.spread.items():
        standard = [(true[name] / rig.nominal[name] - 1.0) / spread for true in drawn]
        cut = norm.cdf((LEAST_VALUE - 1.0) / spread)
        share = kstest(standard, lambda z, c=cut: (norm.cdf(z) - c) / (1.0 - c)).pvalue
        assert share > 1e-4, name  # the least of 37 is below 1e-3 for every 27th seed


@pytest.mark.parametrize("tier", CLEAN)
def test_a_further_log_is_of_the_same_rig_with_the_same_noise(tier: str) -> None:
    """The command of a log once more makes that log again, but for its noise."""
    case = draw_case(3, 1, tier)
    e = case.experiment
    more = with_log(case, e.plans[-1].command, np.random.default_rng(1))
    (one,) = more.further
    np.testing.assert_array_equal(one.noise_free[0], case.noise_free[-1])
    np.testing.assert_array_equal(more.logs[0], case.logs[0])
    pairs = zip((case.logs[-1], one.logs[0]), (case.noise_free[-1], one.noise_free[0]))
    first, further = (np.std(log - clean, axis=0) for log, clean in pairs)
    rows = min(len(log) for log in case.logs) / (10.0 if tier == "hard" else 1.0)  # independent
    three_sigmas = 3.0 / math.sqrt(rows)
    assert further == pytest.approx(first, rel=three_sigmas)
    floor = case.floor * (COLOURED if tier == "hard" else 1.0)
    assert further[0] == pytest.approx(floor, rel=three_sigmas)


@pytest.mark.parametrize("tier", TIERS)
def test_another_command_is_of_the_first_kind(tier: str) -> None:
    case = draw_case(3, 1, tier)
    e = case.experiment
    rows = 3 * len(e.plans[0].command)
    command = another_command(case, rows, np.random.default_rng(1))
    assert len(command) == rows
    assert np.abs(command - e.rig.rest).max() <= e.rig.amplitude[1] * (1.0 + 1e-9)
    levels = len(np.unique(command))
    assert levels < 10 if tier == "poor" else levels > 100  # steps there and back, or sweeps
    other = another_command(case, rows, np.random.default_rng(2))
    assert not np.array_equal(command, other)
