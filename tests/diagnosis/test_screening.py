"""What a look promises of parameters that have bounds, and delays that no slope leads to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares, lsq_linear
from scipy.stats import norm

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.diagnosis.search import grid_search as staircases
from servo_models.diagnosis.search.candidates import Candidate, candidates, travel
from servo_models.diagnosis.search.crossval import advantage, blocks, cross_validate
from servo_models.diagnosis.search.fitting import Fitter, shifted
from servo_models.diagnosis.search.grid_search import shortlist
from servo_models.diagnosis.search.joint_fits import best_start, fit_with
from servo_models.diagnosis.search.screening import (
    Detectability,
    detectability,
    likeliest,
    screen,
    screening_results,
    starts_of,
)
from servo_models.diagnosis.search.selection import passes_entry_test, select_effects
from servo_models.diagnosis.settings import DEFAULT
from servo_models.errors import UserError
from servo_models.identification.linear_inference import solve_box_qp, value_at
from servo_models.identification.optimise import _Point, _step, descend
from servo_models.identification.problem import (
    PRIOR_BOUND_SIGMAS,
    REFUSED,
    Free,
    free_parameter,
    prior_parameters,
)
from tests.support.delayed_motor import DESCRIPTION, describe
from tests.support.diagnoses import made
from tests.support.logs import changed, log_of, measured


@given(seed=st.integers(0, 10_000), twins=st.booleans(), shut=st.booleans())
def test_the_least_in_a_box_is_that_of_a_library(seed: int, twins: bool, shut: bool) -> None:
    """Several at once, of columns of any size, two all but the same, a variable that is fixed."""
    random = np.random.default_rng(seed)
    slopes = random.standard_normal((3, 30, 6)) * 10.0 ** random.uniform(-2.0, 2.0, 6)
    if twins:
        slopes[:, :, 1] = 1.01 * slopes[:, :, 0] + 1e-4 * random.standard_normal((3, 30))
    errors = 10.0 * random.standard_normal((3, 30))
    low, high = -np.abs(random.standard_normal((3, 6))), np.abs(random.standard_normal((3, 6)))
    if shut:
        low[:, 2] = high[:, 2]
    gram, towards = np.swapaxes(slopes, 1, 2) @ slopes, np.einsum("kmi,km->ki", slopes, errors)
    found = solve_box_qp(gram, towards, low, high)
    assert np.all(found >= low - 1e-12 * np.abs(low))
    assert np.all(found <= high + 1e-12 * np.abs(high))
    remains = np.sum(errors**2, axis=1) + value_at(gram, towards, found)
    for a, b, below, above, own in zip(slopes, errors, low, high, remains):
        free = above > below
        rest = b + a[:, ~free] @ above[~free]
        best = lsq_linear(a[:, free], -rest, (below[free], above[free]), method="bvls")
        assert own == pytest.approx(2.0 * best.cost, rel=1e-3)


def test_beyond_its_bounds_a_parameter_promises_nothing() -> None:
    """A fit that its bounds have stopped leaves what it leaves, alone or beside an effect."""
    fitter, every = made({"sensor_offset.value": 2e-3, "torque_constant": 3.0})
    held = [replace(it, low=0.98 * it.nominal, high=1.02 * it.nominal) for it in fitter.nominal]
    fitter = replace(fitter, nominal=tuple(held))
    retuned = fitter.finish(fitter.fit((), ()))
    assert "low" in retuned.problem.sides(retuned.evidence.vector)
    assert retuned.linearised.left == pytest.approx(retuned.cost, rel=1e-3)
    results = screen((retuned.linearised,), [every["sensor_offset"], every["sensor_nonlinearity"]])
    result = next(it for it in results if it.candidate.name == "sensor_offset")
    found = fit_with(fitter, retuned, [result])
    assert found.cost == pytest.approx(result.left, rel=0.02)


def test_a_delay_is_found_though_the_voltage_jumps_with_the_command() -> None:
    """Each edge of the logged voltage is a sample early or late: the cost is a stair of samples."""
    nominal = model("sg90", "linear")
    step, late = 1.2e-3, 4.3
    times: Array = step * np.arange(900.0)
    pulse = 1e-3 * np.repeat([1.5, 1.8, 1.3, 1.6, 1.9, 1.5], 150)
    delay = nominal.values["transport_delay.time"] + late * step
    rig = changed(nominal, {"transport_delay.time": delay})
    names = {"angle_reading": 1e-4, "motor_voltage": 1e-2}
    random = np.random.default_rng(5)
    told = simulate(rig, times, {"pulse_width": pulse})
    read = {it: told[it] + noise * random.standard_normal(900) for it, noise in names.items()}
    log = log_of(times, {"pulse_width": pulse}, read)
    free = free_parameter(
        nominal.plant.parameters["transport_delay.time"],
        nominal.values["transport_delay.time"],
        0.01,
    )
    fitter = Fitter(nominal, [log], (free,), names)
    found = fitter.fit((), ())
    assert found.values["transport_delay.time"] == pytest.approx(delay, abs=0.1 * step)
    assert found.evidence.rms < 1.2


@pytest.mark.thorough
def test_no_search_ends_on_the_edge_of_a_stair() -> None:
    """There the delay can only fall off, while the other parameters still make up for it."""
    nominal, step, count = model("sg90", "measured"), 1.2e-3, 700
    times: Array = step * np.arange(float(count))
    names = {"angle_reading": 3e-4, "motor_voltage": 3e-3}
    shares = {
        "motor_time_constant": 0.25,
        "motor_gain": 0.2,
        "amplifier_gain": 0.25,
        "transport_delay.time": 0.3,
    }
    known, parameters = nominal.values, nominal.plant.parameters
    free = tuple(
        free_parameter(parameters[name], known[name], share * known[name])
        for name, share in shares.items()
    )
    left = []
    for seed in range(160):
        random = np.random.default_rng(seed)
        pulse = np.repeat(1e-3 * (1.5 + random.uniform(-0.1, 0.1, 7)), 100)
        rig = {
            name: known[name] * (1.0 + share * random.standard_normal())
            for name, share in shares.items()
        }
        inputs = {"pulse_width": pulse}
        told = simulate(replace(nominal, values={**known, **rig}), times, inputs)
        read = {it: told[it] + noise * random.standard_normal(count) for it, noise in names.items()}
        fitter = Fitter(nominal, [log_of(times, inputs, read)], free, names)
        left.append(fitter.fit((), ()).evidence.rms)
    assert max(left) < 1.2


def test_where_nothing_jumps_no_delay_is_moved() -> None:
    fitter, every = made({"transport_delay.time": 2e-3})
    problem = fitter.problem(every["transport_delay"].at({"transport_delay.time": 1e-3}))
    before = problem.memory.evaluations
    assert shifted(problem, problem.start) is None
    assert problem.memory.evaluations == before


def test_the_best_of_many_sizes_has_to_do_more_than_one() -> None:
    fitter, every = made({"sensor_offset.value": 1e-5})
    retuned = fitter.finish(fitter.fit((), ()))
    results = screen((retuned.linearised,), [every["sensor_offset"]])
    found = fit_with(fitter, retuned, results[:1])
    worth = advantage(found.evidence, retuned.evidence)
    beyond = worth - DEFAULT.entry_advantage
    assert beyond > 0.0
    assert passes_entry_test(replace(found, chance=0.0), retuned)
    assert not passes_entry_test(replace(found, chance=0.6 * beyond), retuned)


def test_a_hold_is_seen_though_the_delay_has_made_up_for_it() -> None:
    """A hold is late by half its period, so the delay of a fit without it is too long."""
    nominal = model("sg90", "linear", {"transport_delay.time": 0.02})
    random = np.random.default_rng(12)
    times: Array = 1.6e-3 * np.arange(1200.0)
    pulse = 1e-3 * np.repeat(random.uniform(1.3, 1.7, 40), random.integers(20, 60, 40))[:1200]
    period, noise = 0.0155, 1e-4
    told = simulate(
        changed(nominal, {"sample_hold.period": period}),
        times,
        {"pulse_width": pulse},
    )
    read = {"angle_reading": told["angle_reading"] + noise * random.standard_normal(len(times))}
    log = log_of(times, {"pulse_width": pulse}, read)
    delay = nominal.plant.parameters["transport_delay.time"]
    free = (free_parameter(delay, nominal.values[delay.name], 0.01),)
    fitter = Fitter(nominal, [log], free, {"angle_reading": noise})
    retuned = fitter.fit((), ())
    assert retuned.values[delay.name] > nominal.values[delay.name] + 0.3 * period
    (hold,) = [it for it in candidates(nominal, [log]) if it.name == "sample_hold"]
    result = screen((retuned.linearised,), shortlist(fitter, retuned, [hold]))[0]
    assert result.settings["sample_hold.period"] == pytest.approx(period, rel=3e-3)


def test_half_of_what_a_limit_on_a_rate_does_is_twice_the_rate() -> None:
    """And no small part of a tight one counts: it imitates a lag, and no fit leads away."""
    fitter, every = made({"rate_limit.rate": 5000.0, "null_shift.angle": 2e-3})
    seen = screen((fitter.fit((), ()).linearised,), [every["rate_limit"]])
    assert 2500.0 < seen[0].settings["rate_limit.rate"] < 10000.0
    assert seen[0].at(0.5)["rate_limit.rate"] == 2.0 * seen[0].settings["rate_limit.rate"]
    assert min(it.share for it in seen) > 0.49


def test_a_short_search_ends_where_a_library_does() -> None:
    fitter, every = made({"coulomb_friction.level": 2e-3})
    problem = fitter.problem(every["coulomb_friction"].at({"coulomb_friction.level": 1e-3}))
    vector, met, _ = descend(problem, problem.start, 1e-9, 100)
    library = least_squares(problem.residuals, problem.start, bounds=problem.bounds, xtol=1e-12)
    assert met
    assert problem.memory.best[0] == pytest.approx(library.cost, rel=1e-3)
    spread = np.linalg.inv(library.jac.T @ library.jac)
    assert np.all(np.abs(vector - library.x) < 0.3 * np.sqrt(np.diag(spread)))


def test_a_short_search_stays_inside_its_bounds() -> None:
    fitter, every = made({"coulomb_friction.level": 2e-3})
    (level,) = every["coulomb_friction"].at({"coulomb_friction.level": 5e-4})
    problem = fitter.problem([replace(level, high=1e-3)])
    vector, _, _ = descend(problem, problem.start, 1e-6, 50)
    assert problem.sides(vector)[-1] == "high"
    assert np.all(vector <= problem.bounds[1])
    assert np.all(vector >= problem.bounds[0])


@given(seed=st.integers(0, 10_000), damping=st.sampled_from([1e-9, 1e-3, 1.0]))
def test_a_step_leads_down_inside_the_box_however_degenerate(seed: int, damping: float) -> None:
    """Slopes of which one is all but another: the free step is huge, and the box stops it."""
    random = np.random.default_rng(seed)
    slopes = random.standard_normal((30, 4))
    slopes[:, 3] = slopes[:, 2] * (1.0 + 1e-4) + 1e-4 * random.standard_normal(30)
    vector, errors = random.uniform(-1.0, 1.0, 4), random.standard_normal(30)
    low, high = -np.ones(4), np.ones(4)
    step, promised = _step(_Point(vector, errors, slopes, fresh=True), low, high, damping)
    assert np.all(vector + step >= low)
    assert np.all(vector + step <= high)
    predicted = errors + slopes @ step
    assert promised == pytest.approx(0.5 * (errors @ errors - predicted @ predicted), rel=1e-6)
    best = lsq_linear(slopes, -errors, (low - vector, high - vector), method="bvls").cost
    assert 0.0 < promised <= 0.5 * errors @ errors - best + 1e-9


def test_what_a_fit_has_left_does_not_change_when_it_is_fitted_on() -> None:
    """Both share a problem, which remembers only the best of all."""
    fitter, every = made({"coulomb_friction.level": 2e-3})
    level = every["coulomb_friction"].at({"coulomb_friction.level": 1e-4})
    rough = fitter.at_values(
        ("coulomb_friction",), level, {f.name: f.start for f in (*fitter.nominal, *level)}
    )
    left = rough.cost
    further = fitter.refit(rough)
    assert further.cost < 0.5 * left
    assert rough.cost == left
    whole = further.problem.residuals(further.evidence.vector)
    assert further.cost == pytest.approx(float(whole @ whole))


def test_without_free_parameters_an_explanation_is_the_model() -> None:
    fitter, _ = made({})
    fixed = replace(fitter, nominal=())
    found = fixed.fit((), ())
    assert found.evidence.rms == pytest.approx(fixed.unfitted().evidence.rms)


def test_a_look_promises_what_a_fit_holds_where_the_response_is_straight() -> None:
    """An offset of the reading is linear: the look's start is the answer."""
    fitter, every = made({"sensor_offset.value": 2e-3})
    retuned = fitter.finish(fitter.fit((), ()))
    wanted = [every["sensor_offset"], every["coulomb_friction"]]
    results = screen((retuned.linearised,), wanted)
    assert results[0].candidate.name == "sensor_offset"
    found = fit_with(fitter, retuned, results[:1])
    assert found.cost == pytest.approx(results[0].left, rel=0.02)
    assert found.values["sensor_offset.value"] == pytest.approx(2e-3, rel=0.01)
    whole = np.sqrt(np.mean(results[0].difference ** 2))
    shown = detectability(results, wanted)["sensor_offset"].shown
    assert shown >= whole * (1.0 - 1e-6)  # of any size looked at


def test_a_look_finds_count_and_phase_of_a_ripple() -> None:
    truth = {"cogging.torque": 4e-4, "cogging.count": 230.0, "cogging.phase": -1.2}
    fitter, every = made(truth)
    retuned = fitter.finish(fitter.fit((), ()))
    results = screen((retuned.linearised,), [every["cogging"]])
    found = fit_with(fitter, retuned, results[:2])
    assert found.values["cogging.count"] == pytest.approx(230.0, rel=0.01)
    assert found.values["cogging.torque"] == pytest.approx(4e-4, rel=0.05)
    assert found.evidence.rms == pytest.approx(1.0, abs=0.1)


def test_a_hold_is_found_though_no_size_near_it_looks_like_it() -> None:
    """The peak is narrower than one part in a hundred, and constants have made up for it."""
    period = 2.43e-3
    fitter, every = made({"sample_hold.period": period}, 2e-4, sweep=50.0)
    retuned = fitter.finish(fitter.fit((), ()))
    results = screen((retuned.linearised,), shortlist(fitter, retuned, [every["sample_hold"]]))
    found = fit_with(fitter, retuned, results[:2])
    assert found.values["sample_hold.period"] == pytest.approx(period, rel=2e-3)


def test_a_stiff_resonance_is_followed_beyond_its_reach() -> None:
    """Behind a stiff spring an inertia is nearly rigid; what is left of it tells them apart."""
    truth = {"gear_compliance.inertia": 9.5e-7, "gear_compliance.compliance": 0.2}
    fitter, every = made({**truth, "gear_compliance.damping": 0.05}, noise=1e-6)
    retuned = fitter.finish(fitter.fit((), ()))
    found = {}
    for name in ("gear_compliance", "load_inertia"):
        results = screen((retuned.linearised,), [every[name]])
        found[name] = fit_with(fitter, retuned, results[:2])
    stiff, rigid = found["gear_compliance"], found["load_inertia"]
    assert stiff.values["gear_compliance.compliance"] == pytest.approx(0.2, rel=0.1)
    assert stiff.loss < rigid.loss


def test_only_a_bound_that_holds_a_fit_back_makes_a_disguise() -> None:
    fitter, every = made({"coulomb_friction.level": 2e-3})
    (level,) = every["coulomb_friction"].at({"coulomb_friction.level": 1e-3})
    held = fitter.fit(("coulomb_friction",), [replace(level, high=1e-3)])
    at_the_best = fitter.fit(("coulomb_friction",), [level]).values[level.name]
    idle = fitter.fit(("coulomb_friction",), [replace(level, high=0.9999 * at_the_best)])
    assert held.held_by_bound
    assert not idle.held_by_bound
    assert idle.problem.sides(idle.evidence.vector)[-1] == "high"


def test_of_laws_that_do_as_well_the_simplest_is_the_best() -> None:
    """Stribeck's law is Coulomb's at a high Stribeck speed, which no log of Coulomb's tells."""
    fitter, every = made({"coulomb_friction.level": 5e-4}, noise=1e-4)
    plain = fitter.fit(("coulomb_friction",), every["coulomb_friction"].free)
    excess, speed = every["stribeck_friction"].at({"stribeck_friction.excess": 5e-4})
    inside = fitter.fit(("stribeck_friction",), [excess, replace(speed, start=0.3)])
    edge = fitter.fit(("stribeck_friction",), [excess, replace(speed, low=0.9, start=0.9)])
    assert edge.problem.sides(edge.evidence.vector)[-1]
    alike = [float(it.evidence.losses.sum()) for it in (plain, inside, edge)]
    assert np.ptp(alike) < 5.0 * plain.evidence.dispersion
    assert plain.loss < inside.loss < edge.loss


def test_a_staircase_is_found_between_the_sizes_that_are_looked_at() -> None:
    fitter, every = made({"command_quantisation.step": 3.137})
    retuned = fitter.finish(fitter.fit((), ()))
    one = every["command_quantisation"]
    results = screen((retuned.linearised,), shortlist(fitter, retuned, [one]))
    found = fit_with(fitter, retuned, results[:2])
    assert found.values["command_quantisation.step"] == pytest.approx(3.137, rel=0.01)
    assert found.evidence.rms == pytest.approx(1.0, abs=0.15)


def test_a_reading_is_quantised_where_its_codes_show_it() -> None:
    step = 4e-3
    _, every = made({"sensor_quantisation.step": step}, noise=3e-4)
    one = every["sensor_quantisation"]
    assert one.discontinuous
    assert not one.grid
    sizes = np.array([size["sensor_quantisation.step"] for size in one.trial_values])
    assert np.min(np.abs(sizes / step - 1.0)) < 1e-3


def test_a_reading_without_codes_is_not_quantised_at_any_size() -> None:
    fitter, _ = made({}, noise=3e-4)
    (log,) = fitter.logs
    late = slice(600, None)  # a chirp, which rests nowhere
    chirp = replace(
        log, times=log.times[:600], rows=log.rows[late], held_out=log.held_out[late],
        inputs={"voltage": log.inputs["voltage"][late]},
        outputs={"angle": log.outputs["angle"][late]},
    )  # fmt: skip
    one = {it.name: it for it in candidates(fitter.model, [chirp])}["sensor_quantisation"]
    assert one.trial_values == ()
    assert one.trials == 1
    assert screen((fitter.fit((), ()).linearised,), [one]) == []


def test_a_resonance_stays_near_the_frequency_at_which_it_was_seen() -> None:
    _, every = made({})
    one = every["gear_compliance"]
    names = {free.name.rpartition(".")[2]: free.name for free in one.free}
    for settings in one.trial_values:
        free = {it.name: it for it in one.at(dict(settings))}
        fastest = free[names["compliance"]].low * free[names["inertia"]].low
        seen = settings[names["compliance"]] * settings[names["inertia"]]
        assert seen / fastest < 16.0 * (1.0 + 1e-9)


@pytest.mark.parametrize("share", [1e-6, 1e-2, 1.0, 100.0])
def test_every_effect_is_looked_at_whatever_the_travel(share: float) -> None:
    """A travel too small for one period of any ripple left none to look at."""
    fitter, _ = made({})
    (log,) = fitter.logs
    small = replace(log, outputs={"angle": share * log.outputs["angle"]})
    for one in candidates(fitter.model, [small]):
        assert one.trial_values or one.name == "sensor_quantisation"
        assert one.trials >= len(one.trial_values)
        for settings in one.trial_values:
            for free in one.at(dict(settings)):
                assert free.low <= free.start <= free.high


def test_nominal_parameters_stay_within_what_is_believed(tmp_path: Path) -> None:
    rows = [f"{0.01 * k},{k % 5},{0.01 * (k % 7)}" for k in range(40)]
    (tmp_path / "log.csv").write_text("\n".join(["t,u,y", *rows, ""]))
    (tmp_path / "rig.toml").write_text(
        "actuator = 'torque_motor'\nvariant = 'measured'\n"
        "[uncertainty]\ntorque_constant = '10 %'\nback_emf_constant = '50 %'\n"
        "[[logs]]\nfile = 'log.csv'\ntime = { column = 't', unit = 's' }\n"
        "inputs.voltage = { column = 'u', unit = 'V' }\n"
        "outputs.angle = { column = 'y', unit = 'deg' }\n"
    )
    told = read_description(tmp_path / "rig.toml")
    free: dict[str, Free] = {one.name: one for one in prior_parameters(told)}
    constant = free["torque_constant"]
    assert constant.high == pytest.approx((1.0 + 0.1 * PRIOR_BOUND_SIGMAS) * constant.nominal)
    assert constant.low == pytest.approx((1.0 - 0.1 * PRIOR_BOUND_SIGMAS) * constant.nominal)


def test_a_block_left_out_never_more_than_doubles_its_errors() -> None:
    """Also where one block alone says what a parameter is, and a step without it goes far."""
    fitter, every = made({"coulomb_friction.level": 2e-3})
    found = fitter.fit(("coulomb_friction",), every["coulomb_friction"].at({}))
    seen = found.linearised
    wild = replace(
        seen, slopes=seen.slopes * np.where(np.arange(len(seen.errors)) < 60, 1e4, 1.0)[:, None]
    )
    evidence = cross_validate(found.problem, wild, blocks(found.problem))
    inside = np.bincount(evidence.parts, evidence.errors**2)
    assert np.all(evidence.losses <= 4.0 * inside * (1.0 + 1e-9))


def test_the_travel_of_a_linear_drive_is_in_metres() -> None:
    """A ripple of a linear drive is sought over the positions that were visited, not over 1 rad."""
    (log,) = made({})[0].logs
    position = np.linspace(-0.05, 0.15, len(log.times))
    linear = replace(log, outputs={"position": position, "speed": 3.0 * position})
    assert travel(model("linear_drive").plant, [linear]) == pytest.approx(0.2)
    assert travel(model("torque_motor").plant, [log]) == np.ptp(log.outputs["angle"])


@pytest.mark.parametrize("effects", [{}, {"coulomb_friction.level": 2e-3}])
def test_a_bound_holds_without_a_block_as_it_does_with_it(effects: dict[str, float]) -> None:
    """Fits without each block in turn, of a constant that its prior keeps four times too near."""
    fitter, _ = made(effects)
    constant, friction = fitter.nominal
    near = replace(constant, prior=0.1, scale=0.1, low=constant.nominal - 0.4)
    fitter = replace(fitter, nominal=(near, friction))
    found = fitter.finish(fitter.fit((), ()))
    assert found.problem.sides(found.linearised.vector)[0] == "low"
    (log,), parts = fitter.logs, found.evidence.parts
    unseen = np.empty(len(parts))
    for block in range(parts.max() + 1):
        rest = replace(fitter, logs=[replace(log, held_out=parts == block)])
        without = rest.finish(rest.fit((), (), found.values))
        errors = fitter.problem().residuals(without.evidence.vector)[: len(parts)]
        unseen[parts == block] = errors[parts == block]
    assert np.sum(found.evidence.unseen**2) == pytest.approx(np.sum(unseen**2), rel=0.02)


@pytest.mark.parametrize(
    ("name", "size"), [("sensor_nonlinearity.bow", 0.02), ("flux_saturation.curvature", 20.0)]
)
def test_a_fit_begins_where_its_effect_was_seen(name: str, size: float) -> None:
    """An effect with two sizes has been looked at with one of them."""
    fitter, every = made({name: size})
    effect = name.partition(".")[0]
    results = screen([fitter.fit((), ()).linearised], [every[effect]])
    best = [it for it in results if name in it.settings][:1]
    assert best_start(best[0]).cost < 3.0 * best[0].left
    assert fit_with(fitter, fitter.fit((), ()), likeliest(results)).values[name] == pytest.approx(
        size, rel=0.05
    )


def refused() -> Array:
    """Errors by a delay that is longer than its line of samples."""
    fitter, _ = made({})
    (log,) = fitter.logs
    fast = replace(log, times=0.02 * log.times)
    problem = replace(fitter, logs=[fast], floors={"angle": 1e-9}).problem()
    late = {**problem.values(problem.nominal), "transport_delay.time": 0.05}
    with pytest.raises(UserError, match="delay"):
        problem.errors_with(late, strict=True)
    return problem.errors_with(late)


def test_what_cannot_be_simulated_is_worse_than_no_motion_at_all() -> None:
    """With a floor of a millionth of the range, a thousand floors would be a good fit."""
    errors = refused()
    fitter, _ = made({})
    (log,) = fitter.logs
    still = log.outputs["angle"] / 1e-9
    assert np.sqrt(np.mean(errors[: len(still)] ** 2)) > REFUSED * np.sqrt(np.mean(still**2))


def test_what_cannot_be_simulated_is_not_seen() -> None:
    fitter, every = made({})
    (log,) = fitter.logs
    fitter = replace(fitter, logs=[replace(log, times=0.02 * log.times)])
    one = replace(every["transport_delay"], trial_values=({"transport_delay.time": 0.05},))
    nominal = fitter.at_values((), (), {free.name: free.nominal for free in fitter.nominal})
    assert screen([nominal.linearised], [one]) == []
    assert detectability(screening_results([nominal.linearised], [one]), [one]) == {
        "transport_delay": Detectability()
    }


def test_an_uncertain_size_of_an_effect_is_free_once(tmp_path: Path) -> None:
    """It is a nominal parameter then; an uncertain shape of an effect that is off says nothing."""
    text = DESCRIPTION.format("").replace(
        "[uncertainty]",
        '[uncertainty]\n"backlash.half_width" = "0.01 deg"\n"stribeck_friction.speed" = "20 %"',
    )
    told = read_description(describe(tmp_path, text, seconds=0.1))
    names = [free.name for free in prior_parameters(told)]
    assert names.count("backlash.half_width") == 1
    assert "stribeck_friction.speed" not in names
    assert "stribeck_friction" in {one.name for one in candidates(told.model, told.logs)}


@pytest.mark.long
def test_an_uncertain_effect_is_no_candidate() -> None:
    fitter, every = made({})
    (size,) = (
        it for it in every["coulomb_friction"].free if it.name in every["coulomb_friction"].switches
    )
    fitter = replace(fitter, nominal=(*fitter.nominal, replace(size, prior=1e-4)))
    assert "coulomb_friction" not in select_effects(fitter).detectability


def test_every_size_of_a_staircase_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    fitter, every = made({"command_quantisation.step": 0.6})
    retuned = fitter.fit((), ())
    one = every["command_quantisation"]
    results = screen([retuned.linearised], [one])
    seen = []
    before = staircases._over_all

    def spied(*args: object) -> object:
        grid, found = before(*args)  # type: ignore[arg-type]
        seen.extend(tuple(it.settings.items()) for it in found)
        return grid, found

    monkeypatch.setattr(staircases, "_over_all", spied)
    staircases.shortlist(fitter, retuned, [one], results)
    assert len(seen) == len(set(seen)) > 100


@pytest.mark.parametrize("moved", [(0.0, 0.0), (2.0, 0.0), (-1.0, 3.0)])
def test_strained_parameters_count_as_their_priors_say(moved: tuple[float, float]) -> None:
    """Minus the logarithm of two normal densities, beyond that of the nominal values."""
    fitter, _ = made({})
    values = {
        free.name: free.nominal + by * (free.prior or np.nan)
        for free, by in zip(fitter.nominal, moved)
    }
    expected = -sum(norm.logpdf(by) - norm.logpdf(0.0) for by in moved)
    assert fitter.at_values((), (), values).chance == pytest.approx(expected, abs=1e-9)


NOISE = float(np.radians(0.05))
PRIORS = {"motor_time_constant": 0.1, "motor_gain": 0.15, "amplifier_gain": 0.05}
"""Standard deviations over the nominal values."""


def rig(half_width: float, kept: float) -> tuple[Fitter, Candidate]:
    """The linear servo with a dead zone, under steps of several sizes and a slow triangle."""
    nominal = model("sg90", "linear")
    times: Array = 0.02 * np.arange(3000.0)
    steps = np.repeat([0.0, 60.0, -60.0, 20.0, -20.0, 5.0], 300)
    triangle = 15.0 * (4.0 * np.abs(np.mod(times[:1200] / 12.0 + 0.25, 1.0) - 0.5) - 1.0)
    pulse = 1.5e-3 + 1e-5 * np.concatenate([steps, triangle])
    zone = {"drive_dead_zone.half_width": half_width, "drive_dead_zone.kept": kept}
    true = changed(nominal, {"motor_gain": 425.0, **zone})
    log = measured(true, times, {"pulse_width": pulse}, {"angle": NOISE}, seed=1)
    known = nominal.plant.parameters
    free = tuple(
        free_parameter(known[name], nominal.values[name], share * nominal.values[name])
        for name, share in PRIORS.items()
    )
    (one,) = [it for it in candidates(nominal, [log]) if it.name == "drive_dead_zone"]
    return Fitter(nominal, [log], free, {"angle": NOISE}).surveyed(), one


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("half_width", "kept"), [(0.55, 0.6), (0.55, 0.3), (0.3, 0.5), (0.8, 0.8), (0.4, 0.7)]
)
def test_a_fit_finds_the_part_that_is_kept(half_width: float, kept: float) -> None:
    """All that a fit is told of it is what is seen of dead zones that keep nothing."""
    fitter, one = rig(half_width, kept)
    first = fitter.fit((), ())
    ((_, own),) = starts_of(screen((first.linearised,), [one]))
    found = fit_with(fitter, first, own)
    assert found.values["drive_dead_zone.kept"] == pytest.approx(kept, abs=0.03)
    assert found.evidence.rms < 1.3
    assert first.evidence.rms > 50.0
