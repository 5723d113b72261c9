"""Staircases: the first parts of logs, and the sizes on which they and all logs agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import (
    GRID_SPACING_IN_PERIODS,
    LARGEST_RELATIVE_GRID_SPACING,
    on_grid,
)
from servo_models.diagnosis.search.fitting import shifted
from servo_models.diagnosis.search.grid_search import shortened, shortlist
from servo_models.diagnosis.search.joint_fits import fit_with
from servo_models.diagnosis.search.screening import screen
from servo_models.identification.problem import Problem, free_parameter
from tests.support.diagnoses import made
from tests.support.logs import changed, measured


@pytest.mark.thorough
@given(st.lists(st.integers(2, 1200), min_size=1, max_size=4), st.integers(50, 1500))
def test_first_parts_are_the_same_share_of_each_log(lengths: list[int], samples: int) -> None:
    (log,) = made({})[0].logs
    logs = [shortened([log], it)[0] if it < len(log.times) else log for it in lengths]
    parts = shortened(logs, samples)
    share = min(samples / sum(len(it.times) for it in logs), 1.0)
    for whole, part in zip(logs, parts):
        n = len(part.times)
        assert abs(n - share * len(whole.times)) <= 2.0
        assert np.array_equal(part.times, whole.times[:n])
        assert np.array_equal(part.inputs["voltage"], whole.inputs["voltage"][:n])
        assert np.array_equal(part.outputs["angle"], whole.outputs["angle"][:n])
        assert len(part.rows) == len(part.held_out) == n


def test_logs_whose_first_part_is_held_out_are_taken_whole() -> None:
    (log,) = made({})[0].logs
    late = replace(log, held_out=np.arange(len(log.times)) < 600)
    assert shortened([late], 400)[0] is late


def test_of_a_log_with_few_samples_that_count_more_is_taken() -> None:
    (log,) = made({})[0].logs
    sparse = replace(log, held_out=np.arange(len(log.times)) % 3 > 0)
    (part,) = shortened([sparse], 300)
    assert part.fitted.sum() > 150
    assert len(part.times) < len(log.times)
    (plenty,) = shortened([log], 300)
    assert len(plenty.times) < len(part.times)


def test_an_effect_that_moves_nothing_is_not_on_the_list() -> None:
    fitter, every = made({"command_quantisation.step": 3.0})
    retuned = fitter.fit((), ())
    stairs = [every["command_quantisation"], every["sample_hold"]]
    seen = screen((retuned.linearised,), stairs)
    other = [it for it in seen if it.candidate.name == "sample_hold"]
    assert [it.name for it in shortlist(fitter, retuned, stairs, other)] == ["sample_hold"]


@given(st.sampled_from(["sample_hold", "command_quantisation", "dead_band"]), st.floats(1e-3, 1e3))
def test_between_two_sizes_the_last_stair_moves_by_a_part_of_one(name: str, stairs: float) -> None:
    """Or they are as near each other as is worth it: with n stairs, n times the change."""
    plant = model("torque_motor").plant
    grid = plant.main(name).effect.hints.grid
    assert grid
    (switch,) = [it for it in plant.parameters.values() if it.owner == name and it.param.switch]
    whole = stairs * switch.param.typical
    sizes = np.array([max(it.values()) for it in on_grid(grid, switch, whole)])
    low, high = (share * switch.param.typical for share in (grid.low, grid.high))
    assert sizes[0] == min(high, switch.param.high)
    assert low <= sizes[-1] < low * (1.0 + 2.0 * LARGEST_RELATIVE_GRID_SPACING)
    change = 1.0 - sizes[1:] / sizes[:-1]
    stair = change * whole / sizes[:-1]
    fine = change < 1.01 * grid.least_spacing
    assert np.all((stair < 1.01 * GRID_SPACING_IN_PERIODS) | fine)
    assert np.all(change < 1.01 * LARGEST_RELATIVE_GRID_SPACING)


SECONDS = {
    "coulomb_friction": {"coulomb_friction.level": 2e-3},
    "drive_saturation": {"drive_saturation.limit": 15.0},
    "transport_delay": {"transport_delay.time": 1e-3},
}


@pytest.mark.parametrize("period", [1.7e-3, 2.43e-3, 3.11e-3])
@pytest.mark.parametrize("second", SECONDS)
def test_a_fit_from_the_size_of_a_hold_does_not_leave_it(second: str, period: float) -> None:
    """While the other parameters are wrong, another size may leave less."""
    fitter, every = made({"sample_hold.period": period, **SECONDS[second]}, 2e-4, sweep=50.0)
    begin = {name: 0.6 * value for name, value in SECONDS[second].items()}
    begin["sample_hold.period"] = 1.0002 * period
    names = (second, "sample_hold")
    found = fitter.fit(names, [free for name in names for free in every[name].at(begin)])
    assert found.values["sample_hold.period"] == pytest.approx(period, rel=1e-3)
    assert found.evidence.rms == pytest.approx(1.0, abs=0.05)


@pytest.mark.thorough
@pytest.mark.parametrize("period", [1.7e-3, 2.43e-3, 3.11e-3])
def test_a_hold_is_seen_beside_another_effect(period: float) -> None:
    """Its needle is narrower than the sizes that are looked at first are apart."""
    truth = {"sample_hold.period": period, **SECONDS["coulomb_friction"]}
    fitter, every = made(truth, 2e-4, sweep=50.0)
    retuned = fitter.finish(fitter.fit((), ()))
    friction = screen((retuned.linearised,), [every["coulomb_friction"]])
    first = fit_with(fitter, retuned, friction[:2])
    others = [one for one in every.values() if not one.grid]
    both = [*others, every["sample_hold"]]
    known = screen((first.linearised,), both)
    seen = screen((first.linearised,), shortlist(fitter, first, both, known))
    best = [it.settings["sample_hold.period"] for it in seen[:4]]
    assert min(abs(it / period - 1.0) for it in best) < 2.5e-4


def test_a_staircase_is_fitted_without_any_other_parameter() -> None:
    fitter, every = made({"command_quantisation.step": 3.137})
    known = changed(fitter.model, {"torque_constant": 5.5})
    name = "command_quantisation"
    extra = every[name].at({f"{name}.step": 3.13})
    found = replace(fitter, nominal=(), model=known).fit((name,), extra)
    assert found.values[f"{name}.step"] == pytest.approx(3.137, rel=1e-3)


def test_a_delay_before_a_hold_is_moved_by_parts_of_its_period() -> None:
    """Between two ticks nothing depends on it, so slopes say nothing."""
    truth = {"transport_delay.time": 1e-3, "sample_hold.period": 4e-3}
    fitter, every = made(truth, sweep=50.0)
    extra = [free for name in ("transport_delay", "sample_hold") for free in every[name].at(truth)]
    problem = fitter.problem(extra)
    true = {**fitter.model.values, **truth, "torque_constant": 5.5}
    late = {**true, "transport_delay.time": 2.2e-3}
    found, begin = (np.array([it[f.name] for f in problem.free]) for it in (true, late))
    least, before = problem.costs([found / problem.scales, begin / problem.scales])
    assert before > 10.0 * least
    vector: Array | None = begin / problem.scales
    while vector is not None:
        (after,) = problem.costs([vector])
        vector = shifted(problem, vector)
    assert after < 1.1 * least


@pytest.mark.parametrize("order", [1, -1])
def test_a_delay_is_moved_by_samples_of_every_log_that_jumps(order: int) -> None:
    """Those of the slow log are too coarse for what the fast one shows."""
    name, nominal = "transport_delay.time", model("sg90", "linear")
    inputs = {"pulse_width": np.repeat([1.5e-3, 1.6e-3, 1.4e-3, 1.7e-3], 60)}
    logs = [
        measured(
            changed(nominal, {name: 0.01}), step * np.arange(240), inputs, {"motor_voltage": 0}
        )
        for step in (0.02, 0.0025)
    ][::order]
    free = free_parameter(nominal.plant.parameters[name], 0.0175, None)
    problem = Problem(nominal, logs, [free])
    vector: Array | None = problem.start
    while vector is not None:
        found, vector = vector, shifted(problem, vector)
    assert problem.values(found)[name] == pytest.approx(0.01, abs=1e-4)


def test_only_a_staircase_has_many_sizes_to_be_searched() -> None:
    _, every = made({})
    searched = {one.name for one in every.values() if one.grid}
    assert searched == {"sample_hold", "dead_band", "command_quantisation"}
    assert {one.name for one in every.values() if one.discontinuous} == {
        *searched,
        "sensor_quantisation",
    }


def test_a_correction_that_leads_astray_is_not_followed() -> None:
    """Slopes of a ripple's phase promise too much: one size may not spoil those looked at after."""
    true = {"cogging.torque": 4e-3, "cogging.phase": 1.5, "sample_hold.period": 4e-3}
    fitter, every = made(true)
    ripple = every["cogging"].at({"cogging.torque": 3e-3, "cogging.phase": 0.5})
    begin = {it.name: it.start for it in (*fitter.nominal, *ripple)}
    seen = fitter.at_values(("cogging",), ripple, begin).linearised
    sizes = tuple({"sample_hold.period": 4e-3 * (1.0 + k / 500.0)} for k in range(-40, 41))
    hold = replace(every["sample_hold"], trial_values=sizes)

    def left(corrected: bool) -> Array:
        results = screen((seen,), [hold], corrected)
        found = {it.settings["sample_hold.period"]: it.change for it in results}
        return np.array(
            [np.sum(seen.without(seen.errors + found[it]) ** 2) for it in sorted(found)]
        )

    assert np.all(left(corrected=True) <= np.maximum(left(corrected=False), seen.left))
