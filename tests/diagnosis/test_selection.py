"""A second effect beside a first one: which are tried, and from where."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import Candidate, candidates
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.joint_fits import best_start, fit_with
from servo_models.diagnosis.search.limit_cycle import unrepeatable
from servo_models.diagnosis.search.residuals import Residuals, unmodelled
from servo_models.diagnosis.search.screening import (
    VALUES_BESIDE,
    VALUES_SIMULATED,
    Screened,
    Screener,
    likeliest,
    moving,
    preselect,
    residual_beside,
    screen,
    survey,
)
from servo_models.diagnosis.search.selection import (
    SubsetSelection,
    promising,
    select_effects,
)
from servo_models.diagnosis.settings import Settings
from servo_models.diagnosis.stretches import held_out_scores
from servo_models.diagnosis.verdict import EFFECTS, OUTSIDE, decide
from servo_models.identification.doubts import NOT_DETERMINED, doubt
from servo_models.identification.linear_inference import Linearisation, spread
from servo_models.identification.problem import Free, Problem, free_parameter
from tests.support.diagnoses import made
from tests.support.logs import changed, measured

SHARED = {
    "drive_saturation": (0.5, 1.6),
    "rate_limit": (0.5, 1.6),
    "cogging": (-10.0, 10.0),
    "coulomb_friction": (0.0, 1.6),
}
"""Between which shares of what was simulated an effect may change the response."""
PAIR = {"coulomb_friction.level": 1.5e-3, "drive_saturation.limit": 15.0}


def selection_of(fitter: Fitter, every: Iterable[Candidate]) -> SubsetSelection:
    """A search that has fitted nothing yet, and screened every effect as it is."""
    return SubsetSelection(fitter, fitter.unfitted(), list(every), [], lambda _: None)


def test_effects_that_change_the_response_alike_take_one_place() -> None:
    fitter, every = made({"coulomb_friction.level": 2e-3})
    one = every["coulomb_friction"]
    twins = [one, replace(one, name="first twin"), replace(one, name="second twin")]
    seen = screen(
        (fitter.fit((), ()).linearised,), [*twins, every["cogging"], every["sensor_offset"]]
    )
    chosen = [name for name, _ in promising(seen, np.inf, 2)]
    assert len(chosen) == 2
    assert len({"coulomb_friction", "first twin", "second twin"} & set(chosen)) == 1
    alike = [name for name, _ in promising(seen, np.inf, 3, unlike=False)]
    assert set(alike) == {"coulomb_friction", "first twin", "second twin"}


def test_look_alikes_are_sought_whatever_is_left_to_explain() -> None:
    """Under a constant load, friction in proportion to it is Coulomb friction."""
    load = {"coulomb_friction.level": 1.5e-3, "constant_load.torque": 4e-3}
    fitter, every = made({**load, "cogging.torque": 3e-4, "cogging.count": 200.0})
    names = ("coulomb_friction", "constant_load")
    found = fitter.fit(names, [free for name in names for free in every[name].at(load)])
    assert not found.settled
    search = selection_of(fitter, every.values())
    search.exchange(found, rivals=True)
    twin = next(
        it for it in search.tried() if set(it.effects) == {"constant_load", "load_friction"}
    )
    assert twin.cost == pytest.approx(found.cost, rel=1e-3)


def test_a_single_effect_is_exchanged_for_what_was_never_fitted() -> None:
    """A constant torque shifts the rest of a spring."""
    load = {"constant_load.torque": 4e-3}
    fitter, every = made(load)
    found = fitter.fit(("constant_load",), every["constant_load"].at(load))
    search = selection_of(fitter, every.values())
    search.exchange(found)
    alone = {it.effects[0]: it.cost for it in search.tried() if len(it.effects) == 1}
    assert alone["null_shift"] == pytest.approx(found.cost, rel=0.01)


def test_a_staircase_is_sought_beside_a_single_effect() -> None:
    """Alone, a staircase of another size makes up for an offset."""
    causes = {"sensor_offset.value": 2e-3, "command_quantisation.step": 3.137}
    fitter, every = made(causes)
    offset, steps = (every[name.partition(".")[0]] for name in causes)
    search = selection_of(fitter, [offset, steps])
    both = ((offset.name, steps.name), [*offset.free, *steps.free])
    wrong = fitter.fit(*both, {"command_quantisation.step": 2.0})
    search.keep(fitter.fit((offset.name,), offset.free))
    search.keep(wrong)
    search.search_grids_beside()
    found = search.models[frozenset(both[0])]
    assert not wrong.settled
    assert found.values["command_quantisation.step"] == pytest.approx(3.137, rel=1e-3)
    assert found.settled


@pytest.mark.thorough
def test_the_best_pair_is_exchanged_until_none_does_better() -> None:
    """Neither of its effects is a cause, and noise is not all that it leaves."""
    causes = {"transport_delay.time": 1.1e-3, "drive_saturation.limit": 15.0}
    fitter, every = made(causes)
    wrong = ("coulomb_friction", "cogging")
    found = fitter.fit(wrong, [free for name in wrong for free in every[name].free])
    assert not found.settled
    search = selection_of(fitter, every.values())
    search.keep(found)
    search.exchange_best(2)
    best = search.best(2)[0]
    assert set(best.effects) == {parameter.partition(".")[0] for parameter in causes}
    assert best.settled


def test_a_fit_ends_early_only_where_it_cannot_reach_what_it_has_to() -> None:
    fitter, every = made(PAIR)
    name = "drive_saturation"
    start = every[name].at({"drive_saturation.limit": 25.0})
    whole = fitter.fit((name,), start)
    early = fitter.fit((name,), start, enough=0.1 * whole.cost)
    assert early.problem.memory.evaluations < 0.7 * whole.problem.memory.evaluations
    assert early.cost > 0.1 * whole.cost
    assert fitter.fit((name,), start, enough=1.1 * whole.cost).cost == whole.cost


def test_few_values_show_from_the_nominal_model_what_all_values_do() -> None:
    fitter, every = made({"coulomb_friction.level": 1.5e-3})
    retuned = fitter.fit((), ())
    nominal = fitter.at_values(
        (), (), {free.name: free.nominal for free in fitter.nominal}
    ).linearised
    results = moving(survey(retuned.linearised, [nominal], list(every.values())))
    few = [it for it in results if it.linearised is nominal]
    most = screen((nominal,), list(every.values()))
    best = [{it.candidate.name: it.left for it in reversed(seen)} for seen in (most, few)]
    assert best[1]["coulomb_friction"] == best[0]["coulomb_friction"]
    assert np.quantile([best[1][it] / best[0][it] for it in best[1]], 0.9) < 1.05
    assert len(few) < 0.5 * len(most)


def test_a_ripple_beside_friction_is_looked_for_at_every_count() -> None:
    """Alone it takes a count that imitates the friction as well."""
    true = {"cogging.torque": 1e-3, "cogging.count": 200.0, "cogging.phase": 1.0}
    fitter, every = made({**true, "stribeck_friction.excess": 4e-3, "stribeck_friction.speed": 0.1})
    results = screen((fitter.fit((), ()).linearised,), list(every.values()))
    near = preselect(every.values(), results)
    (ripple,) = [one for one in near if one.name == "cogging"]
    assert ripple.trial_values == every["cogging"].trial_values
    friction = every["stribeck_friction"].at({"stribeck_friction.excess": 2e-3})
    first = fitter.fit(("stribeck_friction",), friction)
    own = Screener([ripple], results).beside(first, [ripple])
    found = fit_with(fitter, first, own[:VALUES_SIMULATED]).values
    assert found["cogging.count"] == pytest.approx(200.0, rel=0.01)
    assert found["cogging.torque"] == pytest.approx(1e-3, rel=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("first", "second"),
    [
        ({"coulomb_friction.level": 1.5e-3}, {"sensor_offset.value": 2e-3}),
        ({"drive_saturation.limit": 15.0}, {"transport_delay.time": 1.1e-3}),
        (
            {"stribeck_friction.excess": 4e-3, "stribeck_friction.speed": 0.1},
            {"backlash.half_width": 1e-3},
        ),
    ],
)
def test_few_sizes_show_beside_an_effect_what_all_sizes_do(
    first: dict[str, float], second: dict[str, float]
) -> None:
    """None of these laws adds to another one, and the sizes are those that would do if they did."""
    fitter, every = made({**first, **second})
    results = screen((fitter.fit((), ()).linearised,), list(every.values()))
    near = preselect(every.values(), results)
    (name,), (cause,) = ({it.partition(".")[0] for it in part} for part in (first, second))
    fitted = fitter.fit((name,), every[name].at(first))
    few = Screener(every.values(), results).beside(fitted, every.values())
    most = screen((fitted.linearised,), [one for one in every.values() if one.name != name])
    smooth = [one.name for one in near if len(one.alone) > VALUES_BESIDE and one.name != name]
    assert len(smooth) > 10
    best = [{it.candidate.name: it.left for it in reversed(seen)} for seen in (most, few)]
    assert best[1][cause] == best[0][cause]
    apart = [best[1][it] / best[0][it] for it in smooth if it in best[0]]
    assert np.quantile(apart, 0.9) < 1.01
    assert (
        max(len([it for it in few if it.candidate.name == one]) for one in smooth) <= VALUES_BESIDE
    )


@pytest.fixture(scope="module")
def problem() -> Problem:
    return made({"coulomb_friction.level": 2e-3})[0].problem()


def test_effects_are_looked_at_once_beside_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    fitter, every = made({"coulomb_friction.level": 2e-3})
    first = fitter.fit(("coulomb_friction",), every["coulomb_friction"].free)
    others = [every[name] for name in ("cogging", "stribeck_friction", "dead_band")]
    asked: list[list[str]] = []
    screener = Screener(others, [])

    def counted(views: Any, wanted: Any, corrected: bool = True) -> Any:
        asked.append([one.name for one in wanted])
        return screen(views, wanted, corrected)

    monkeypatch.setattr("servo_models.diagnosis.search.screening.screen", counted)
    found = screener.beside(first, others[:2])
    again = screener.beside(first, others)
    assert asked == [["cogging", "stribeck_friction"], ["dead_band"]]
    assert {id(it) for it in found} <= {id(it) for it in again}
    assert [it.left for it in again] == sorted(it.left for it in again)
    best = min(it.left for it in Screener(others, []).beside(first, others))
    assert again[0].left == pytest.approx(best, rel=1e-9)


def test_a_fit_begins_with_several_shapes() -> None:
    """Slopes from a wrong one may lead to its bound: friction at 5 mrad/s for that at 100."""
    friction = {"stribeck_friction.excess": 4e-3, "stribeck_friction.speed": 0.1}
    fitter, every = made(friction)
    one = every["stribeck_friction"]
    results = screen((fitter.fit((), ()).linearised,), [one])
    tried = likeliest(results)
    speeds = [it.settings["stribeck_friction.speed"] for it in tried]
    assert len(set(speeds)) == len(speeds) == VALUES_SIMULATED
    assert tried[0] is results[0]
    wrong = sorted(tried, key=lambda it: it.settings["stribeck_friction.speed"])
    found = fit_with(fitter, fitter.fit((), ()), wrong[:2])
    assert found.values["stribeck_friction.speed"] == pytest.approx(0.1, rel=0.1)


@pytest.mark.thorough
@given(st.integers(0, 10**6), st.integers(1, 5), st.integers(1, 4))
def test_what_is_left_beside_another_effect_is_what_a_library_leaves(
    seed: int, count: int, others: int
) -> None:
    fitter, every = made({"coulomb_friction.level": 2e-3})
    problem = fitter.problem()
    random = np.random.default_rng(seed)
    m = problem.samples + len(problem.free)
    seen = Linearisation(
        problem, problem.nominal, random.standard_normal(m), random.standard_normal((m, 2))
    )

    def result(name: str) -> Screened:
        change = random.standard_normal(m) * random.uniform(0.1, 3.0)
        return Screened(seen, every[name], {}, 1.0, change, seen.without(change), 0.0)

    results = [result("sample_hold") for _ in range(count)]
    beside_them = [result(name) for name in list(SHARED)[:others]]
    found = residual_beside(results, beside_them)
    for one, left in zip(results, found):
        rest = seen.without(seen.errors + one.change)
        expected = min(
            2.0 * lsq_linear(it.difference[:, None], -rest, SHARED[it.candidate.name]).cost
            for it in beside_them
        )
        assert left == pytest.approx(expected, rel=1e-6)


@pytest.mark.long
def test_smooth_pairs_spare_the_search_for_staircases() -> None:
    """Thousands of their sizes are looked at only where nothing smooth leaves noise only."""
    heard: list[str] = []
    selection = select_effects(made(PAIR)[0], tell=heard.append)
    assert set(selection.taken.effects) == {name.partition(".")[0] for name in PAIR}
    assert not any("searching discontinuous" in it for it in heard)
    heard.clear()
    hold = {"coulomb_friction.level": 2e-3, "sample_hold.period": 2.43e-3}
    selection = select_effects(made(hold, 2e-4, sweep=50.0)[0], tell=heard.append)
    assert set(selection.taken.effects) == {"coulomb_friction", "sample_hold"}
    assert any("searching discontinuous" in it for it in heard)


@pytest.mark.parametrize("kept", [(), ("dead_band",), ("cogging",)])
def test_where_hardly_any_effect_is_left_the_gap_is_outside(kept: tuple[str, ...]) -> None:
    fitter, every = made(PAIR)
    selection = select_effects(fitter, left_out=[name for name in every if name not in kept])
    assert set(selection.taken.effects) <= set(kept)
    assert decide(selection).kind == OUTSIDE


THREE = {
    "coulomb_friction.level": 1.5e-3,
    "drive_saturation.limit": 15.0,
    "transport_delay.time": 1.1e-3,
}


@pytest.mark.long
def test_three_causes_are_named_and_no_fourth() -> None:
    fitter, _ = made(THREE)
    selection = select_effects(fitter)
    assert set(selection.taken.effects) == {name.partition(".")[0] for name in THREE}
    assert set(selection.alike[0].effects) == set(selection.taken.effects)
    assert all(len(one.effects) == 3 for one in selection.alike)
    assert decide(selection).kind == EFFECTS
    for name, value in THREE.items():
        assert selection.taken.values[name] == pytest.approx(value, rel=0.05)


def test_two_causes_are_not_joined_by_a_third() -> None:
    fitter, _ = made(dict(list(THREE.items())[:2]))
    selection = select_effects(fitter)
    assert set(selection.taken.effects) == {"coulomb_friction", "drive_saturation"}
    assert not selection.of_size(3)


@pytest.mark.parametrize("name", ["drive_saturation", "coulomb_friction", "gear_compliance"])
def test_a_fit_begins_where_no_more_is_left_than_with_the_effect_as_screened(name: str) -> None:
    fitter, every = made({"coulomb_friction.level": 1.5e-3, "drive_saturation.limit": 15.0})
    linear = fitter.fit((), ()).linearised
    for result in screen((linear,), [every[name]])[:5]:
        begin = best_start(result)
        as_screened = {**result.settings, **result.linearised.start(result.whole)}
        assert begin.cost <= linear.cost(as_screened)
        assert begin.cost <= linear.cost(result.settings)  # the others as they are
        own = {free.name: free.start for free in begin.free}
        assert begin.cost == linear.cost({**begin.values, **own})


@pytest.mark.thorough
def test_a_motion_that_the_effects_make_worse_is_named() -> None:
    """One held-out log is of the rig with its friction, the other of one without it, for which
    parameters alone are right."""
    fitter, _ = made({"coulomb_friction.level": 1.5e-3})
    (log,) = fitter.logs
    plain = replace(
        fitter.model, values={**fitter.model.values, **fitter.finish(fitter.fit((), ())).values}
    )
    noise = 1e-5 * np.random.default_rng(4).standard_normal(len(log.times))
    angle = simulate(plain, log.times, log.inputs)["angle"] + noise
    held = replace(log, name="as fitted", held_out=np.ones(len(log.times), dtype=bool))
    other = replace(held, name="without friction", outputs={"angle": angle})
    selection = select_effects(replace(fitter, logs=[log, held, other]))
    assert selection.taken.effects == ("coulomb_friction",)
    same, plain_one = held_out_scores(selection)
    assert (same.log, plain_one.log) == ("as fitted", "without friction")
    assert not same.worse
    assert same.after == pytest.approx(1.0, abs=0.1)
    assert same.retuned > 10.0
    assert plain_one.worse
    assert plain_one.retuned == pytest.approx(1.0, abs=0.1)
    assert plain_one.after > 10.0


def limit_cycle(effect: str, step: float) -> FittedModel:
    """The servo with a quantiser, its gain half a per cent off as after a fit."""
    nominal = model("sg90", "measured")
    rig = changed(nominal, {f"{effect}.step": step})
    times: Array = 1e-3 * np.arange(1500.0)
    pulse = 1.5e-3 + 1e-4 * np.repeat([0.0, 2.0, -1.0, 3.0, 0.5], 300)
    log = measured(rig, times, {"pulse_width": pulse}, {"angle": 1e-4}, 5)
    name = "amplifier_gain"
    free = free_parameter(
        nominal.plant.parameters[name], nominal.values[name], 0.05 * nominal.values[name]
    )
    fitter = Fitter(nominal, [log], (free,), {"angle": 1e-4})
    every = {one.name: one for one in candidates(nominal, [log])}
    extra = every[effect].at({f"{effect}.step": step})
    values = {name: 1.005 * nominal.values[name], f"{effect}.step": step}
    return fitter.at_values((effect,), extra, values)


def test_a_quantiser_in_the_loop_makes_it_hunt() -> None:
    """The effect's equation in a loop of such a gain has no equilibrium between two codes."""
    assert unrepeatable(limit_cycle("sensor_quantisation", 0.35)) > 1.0


@pytest.mark.parametrize("effect", ["command_quantisation", "reading_quantisation"])
def test_a_quantiser_outside_the_loop_repeats_itself(effect: str) -> None:
    assert unrepeatable(limit_cycle(effect, 0.02)) == 0.0


def test_a_smooth_response_repeats_itself() -> None:
    fitter, _ = made({"drive_saturation.limit": 15.0})
    assert unrepeatable(fitter.fit((), ())) == 0.0


def test_what_cannot_be_repeated_is_taken_off_what_is_left() -> None:
    left = Residuals(structured=5.0, least=4.0, noise=1.0, total=5.1)
    assert left.without(0.0) == left
    assert left.without(3.0) == replace(left, structured=4.0, least=np.sqrt(7.0))
    assert left.without(6.0).structured == left.without(6.0).least == 0.0


@pytest.mark.parametrize("times_as_wrong", [1.0, 1e5])
def test_a_smooth_response_far_from_its_log_repeats_itself(times_as_wrong: float) -> None:
    """Standard errors of a model that is wrong are wide, and its moves end on bounds."""
    fitter, _ = made({"drive_saturation.limit": 15.0})
    fitted = fitter.fit((), ())
    evidence = replace(fitted.evidence, errors=times_as_wrong * fitted.evidence.errors)
    widths = np.full(len(fitted.problem.free), 1e-3)
    assert unrepeatable(replace(fitted, evidence=evidence, widths=widths)) == 0.0


NOMINAL = {
    "gain": 100.0,
    "sample_hold.period": 2e-3,
    "torque_constant": 1.67523,
    "resistance": 19.9453,
    "inertia": 0.0100622,
    "loop_factor": 0.0137795,
    "coulomb_friction.level": 0.090952,
}
PRIORS = {
    "torque_constant": 0.1,
    "resistance": 0.1,
    "inertia": 0.15,
    "loop_factor": 0.05,
    "coulomb_friction.level": 0.3,
}  # of the nominal value
SIDES = {
    "torque_constant": 1.0,
    "resistance": -1.0,
    "inertia": -1.0,
    "loop_factor": -1.0,
    "coulomb_friction.level": -1.0,
}
"""To which side of its nominal value each parameter of the rig is."""


def firmware_loop() -> Fitter:
    """A servo with a 12 bit encoder and a held command, parameters off by two deviations."""
    nominal = changed(model("smart_servo", "xl330"), NOMINAL)
    times: Array = 4e-3 * np.arange(1142.0)
    moments, goals = (
        [0.0, 0.3, 1.08, 1.7, 2.52, 3.3, 3.93],
        [0.0, 17.4, 29.1, -29.1, -14.5, 7.3, 2.9],
    )
    goal = np.radians(goals)[np.searchsorted(moments, times, side="right") - 1]
    true = {n: NOMINAL[n] * (1.0 + 2.0 * SIDES[n] * part) for n, part in PRIORS.items()}
    log = measured(changed(nominal, true), times, {"goal": goal}, {"angle_reading": 0.0})
    known = nominal.plant.parameters
    free = tuple(
        free_parameter(known[name], nominal.values[name], part * nominal.values[name])
        for name, part in PRIORS.items()
    )
    return Fitter(nominal, [log], free, {"angle_reading": 1e-4}).surveyed()


def test_a_fit_of_the_smooth_twin_leads_out_of_a_dent() -> None:
    """A quantiser and a hold in the loop give the response dents in which a search ends."""
    fitter = firmware_loop()
    assert set(fitter.smooth) == {"sensor_quantisation.step", "sample_hold.period"}
    assert not any(fitter.smooth.values())
    alone = replace(fitter, smooth={}).fit((), ())
    assert fitter.fit((), ()).cost < 0.2 * alone.cost


def test_standard_errors_do_not_depend_on_what_was_simulated_before() -> None:
    fitter = firmware_loop()
    fresh, used = fitter.problem(), fitter.problem()
    for share in (0.9, 1.0, 1.1):
        used.residuals(share * used.nominal)
    first, second = (spread(it, it.nominal).standard_errors for it in (fresh, used))
    np.testing.assert_array_equal(first, second)


def test_no_effect_is_named_where_parameters_leave_noise() -> None:
    """An offset of a third of the noise would earn its place in a long log."""
    fitter, _ = made({"sensor_offset.value": 3e-6})
    selected = select_effects(fitter)
    assert selected.taken.effects == ()
    assert 1.0 < selected.retuned.evidence.rms < 1.1
    assert len(select_effects(fitter, tolerance=0.9).taken.effects) == 1  # who asks for less
    fitter = replace(fitter, settings=Settings(enough_floors=0.0))
    assert len(select_effects(fitter).taken.effects) == 1


@pytest.mark.thorough
def test_no_effect_joins_a_model_that_leaves_noise() -> None:
    fitter, _ = made({"coulomb_friction.level": 1.5e-3, "sensor_offset.value": 3e-6})
    assert select_effects(fitter).taken.effects == ("coulomb_friction",)
    fitter = replace(fitter, settings=Settings(enough_floors=0.0))
    assert set(select_effects(fitter).taken.effects) == {"coulomb_friction", "sensor_offset"}


@pytest.mark.thorough
@pytest.mark.parametrize(("offset_in_floors", "effects"), [(1.75, 0), (3.5, 1)])
def test_a_first_effect_takes_a_tenth_of_what_parameters_leave(
    offset_in_floors: float, effects: int
) -> None:
    """Noise of five floors and an offset leave hypot(5, offset) floors, and without it five."""
    floor = 1e-5
    fitter, _ = made({"sensor_offset.value": offset_in_floors * floor}, 5.0 * floor)
    selected = select_effects(replace(fitter, floors={"angle": floor}))
    assert len(selected.taken.effects) == effects


@pytest.mark.parametrize("ticks", [-1.0, 1.0])
def test_a_delay_one_tick_off_before_a_hold_is_found(ticks: float) -> None:
    """Commands wait for the next tick, so that no slope leads from one tick to another."""
    period, delay, floor = 8e-3, 24.3e-3, 1e-4
    nominal = changed(model("smart_servo", "xl330"), {**NOMINAL, "sample_hold.period": period})
    times: Array = 2e-3 * np.arange(750.0)
    moments, goals = [0.0, 0.103, 0.511, 1.004], np.radians([0.0, 17.4, -29.1, 7.3])
    inputs = {"goal": goals[np.searchsorted(moments, times, side="right") - 1]}
    late = changed(nominal, {"transport_delay.time": delay})
    log = measured(late, times, inputs, {"angle_reading": floor})
    own = next(it for it in candidates(nominal, [log]) if it.name == "transport_delay")
    begun = [replace(it, start=delay + ticks * period) for it in own.free]
    fitter = Fitter(nominal, [log], (), {"angle_reading": floor}).surveyed()
    assert fitter.fit((own.name,), begun).evidence.rms < 1.1


@pytest.mark.parametrize(
    ("structured", "gap", "lacks"),
    [(4.0, 200.0, False), (6.0, 200.0, True), (2.0, 12.0, False), (3.0, 12.0, True)],
)
def test_a_fifth_of_the_gap_or_five_floors_are_lacking(
    structured: float, gap: float, lacks: bool
) -> None:
    left = Residuals(structured, 0.9 * structured, 1.0, math.hypot(structured, 1.0))
    assert unmodelled(left, gap) == lacks


@pytest.mark.parametrize(("low", "said"), [(-1.0, ""), (0.0, NOT_DETERMINED)])
def test_an_offset_near_zero_may_be_well_known(low: float, said: str) -> None:
    free = Free("offset", low, 1.0, start=0.05, scale=0.05, nominal=0.0)
    assert doubt(free, 1e-3, 2e-3) == said
