"""Diagnosis: what it needs, how it speaks, and laws of its figures."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs
from threadpoolctl import threadpool_info

import servo_models as sm
from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuators, model
from servo_models.core.types import Array
from servo_models.core.workers import Workers
from servo_models.data.description import read_description
from servo_models.data.sensor import Floor
from servo_models.diagnosis import summary
from servo_models.diagnosis.confirm import Confirmation, confirm
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.gap import gaps, whole_gap
from servo_models.diagnosis.preconditions import slowest_time_constant
from servo_models.diagnosis.ranking import probabilities
from servo_models.diagnosis.search.crossval import CrossValidation, blocks
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.selection import FIRST_ANSWER
from servo_models.diagnosis.stretches import HeldOut, held_out_outputs, held_out_scores
from servo_models.diagnosis.verdict import EFFECTS, PARAMETERS, Verdict, decide
from servo_models.identification.problem import Free, Problem, free_parameter
from servo_models.validation.torque_motor.reference import EQ_12
from tests.support.compilers import in_c_only
from tests.support.delayed_motor import describe
from tests.support.logs import changed, log_of


class Told(list[str]):
    """What a diagnosis says while it runs."""


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> tuple[Diagnosis, Told]:
    told = Told()
    path = describe(tmp_path_factory.mktemp("case"), seconds=0.2)
    return diagnose(path, tell=told.append), told


def test_progress_tells_effect_by_effect_with_the_best_so_far(case: tuple[Diagnosis, Told]) -> None:
    found, told = case
    fitted = [text for text in told if text.startswith("fitting ")]
    for effect in found.ranking:
        assert any(text.split(";")[0].endswith(effect.name) for text in fitted) or effect.taken
    assert any("best so far transport_delay" in text for text in fitted)
    first = next(i for i, text in enumerate(told) if "best so far" in text)
    rest = [text for text in told[first:] if not text.startswith(FIRST_ANSWER)]
    assert len(rest) == len(told) - first - 1
    assert all("best so far" in text and "noise floors" in text for text in rest)


def test_what_is_told_comes_from_the_model_with_its_own_step(
    case: tuple[Diagnosis, Told],
) -> None:
    selection = case[0].selection
    for one in (selection.retuned, selection.taken):
        found = one.problem
        plain = Problem(found.model, found.logs, found.free, sigma=found.sigma)
        errors = plain.errors_with(one.values)
        np.testing.assert_array_equal(one.linearised.errors, errors)
        np.testing.assert_array_equal(one.evidence.errors, errors[: plain.samples])


@pytest.mark.thorough
def test_an_effect_left_out_is_not_named(case: tuple[Diagnosis, Told]) -> None:
    told = read_description(case[0].logs[0].path.parent / "rig.toml")
    found = diagnose(told, left_out=["transport_delay"])
    assert "transport_delay" not in {effect.name for effect in found.ranking}
    assert "transport_delay" not in summary.ruled_out(found)


def test_a_confirmation_does_not_hang_on_the_effects_alone(case: tuple[Diagnosis, Told]) -> None:
    """A log that fixes a load torque is run with it, in the FMU as in the simulation."""
    found, _ = case
    (log,) = found.logs
    held = replace(log, constants={"load_torque": 0.01})
    problem = Problem(found.model, [held], found.selection.taken.problem.free, dict(found.floors))
    plain = Problem(found.model, [log], [], dict(found.floors))
    selection = replace(
        found.selection,
        taken=replace(found.selection.taken, problem=problem),
        retuned=replace(found.selection.retuned, problem=plain),
    )
    loaded = confirm(found.fitted, selection, (held,))
    assert loaded.difference == 0.0
    plainly = confirm(found.fitted, found.selection, found.logs)
    assert loaded.rows[0].after > 10.0 * plainly.rows[0].after


def test_what_is_read_after_its_command_is_confirmed_at_rows(case: tuple[Diagnosis, Told]) -> None:
    """No host reads an output at a command: its error is that of the simulation."""
    found, _ = case
    (log,), taken = found.logs, found.selection.taken
    angle = replace(log.channels["angle"], after_command=2e-3)
    later = replace(log, channels={**log.channels, "angle": angle})
    problem = Problem(found.model, [later], taken.problem.free, dict(found.floors))
    selection = replace(found.selection, taken=replace(taken, problem=problem))
    confirmed = confirm(found.fitted, selection, (later,))
    assert confirmed.difference == 0.0
    left = problem.runs[0].outputs(taken.values)[:, 0] - log.outputs["angle"]
    assert confirmed.rows[0].after == pytest.approx(np.sqrt(np.mean(left[log.counted] ** 2)))


SAID = {
    "no-gap": "No gap",
    "parameters": "Re-tuned parameters explain the gap",
    "effect": "transport_delay on 'voltage' explains the gap",
    "outside-catalogue": "Outside the catalogue",
    "not-identifiable": "These logs cannot tell which effect it is: transport_delay, backlash",
}


@pytest.mark.parametrize("kind", SAID)
def test_every_verdict_is_one_sentence(case: tuple[Diagnosis, Told], kind: str) -> None:
    found, verdict = case[0], Verdict(kind, {}, ("transport_delay", "backlash"), ())
    if kind == "parameters":  # as if these had closed the gap
        selection = replace(found.selection, retuned=found.selection.taken)
        found = replace(found, selection=selection)
    text = summary.sentence(replace(found, verdict=verdict))
    assert text.startswith(SAID[kind])
    assert text.endswith(".")
    assert "\n" not in text
    if kind == "effect":
        assert "cannot be told apart from backlash" in text


def test_a_held_out_log_that_is_missed_is_part_of_the_verdict(
    case: tuple[Diagnosis, Told],
) -> None:
    """Of the same rig with a friction that no sample that is judged has shown.  Errors held out are
    those of simulations of the three models, of all logs together, and no blocks."""
    found, _ = case
    (log,) = found.logs
    rubbing = changed(found.fitted, {"coulomb_friction.level": 0.01})
    run = simulate(rubbing, log.times, log.inputs)
    everything = np.ones(len(log.times), dtype=bool)
    measured = {name: run[name] for name in ("angle", "current")}
    other = replace(log, name="rubbing", outputs=measured, held_out=everything)
    ends = log.times > 0.7 * log.times[-1]
    late = replace(log, name="late", held_out=ends, skipped=~ends)
    logs, selection = (log, other, late), found.selection
    floors = {**found.floors, "current": 0.01}
    both, alone = (
        replace(one, problem=Problem(found.model, logs, one.problem.free, floors))
        for one in (selection.taken, selection.retuned)
    )
    selection = replace(selection, taken=both, retuned=alone)
    scores = held_out_scores(selection)
    told = replace(found, selection=selection, logs=logs, held_out=scores, floors=floors)
    retuned = changed(found.model, selection.retuned.values)
    runs = [simulate(it, log.times, log.inputs) for it in (found.model, retuned, found.fitted)]
    seen = {"angle": logs[1:], "current": logs[1:2]}
    errors = {
        name: [
            np.concatenate([(run[name] - it.outputs[name])[it.held_out] for it in held])
            for run in runs
        ]
        for name, held in seen.items()
    }
    sizes = {name: [np.sqrt(np.mean(it**2)) for it in each] for name, each in errors.items()}
    for name, one in held_out_outputs(told.held_out).items():
        assert [one.before, one.retuned, one.after] == pytest.approx(sizes[name], rel=1e-6)
    angle = " -> ".join(f"{math.degrees(size):.3g}" for size in sizes["angle"])
    current = " -> ".join(f"{1e3 * size:.3g}" for size in sizes["current"])
    text = summary.sentence(told)
    first = f": held out, angle {angle} deg, current {current} mA (before, re-tuned, with effect);"
    assert first in text.partition("on blocks that a fit left out")[0]
    assert first[2:].partition(",")[2].strip(" ;") in str(told)
    missed, kept = told.held_out
    assert kept.after < 1.5
    assert missed.after > 3.0 * told.gap.rms["after"]
    assert (
        f"; of log 'rubbing', held out, it leaves {missed.after:.3g} noise floors."
        in summary.sentence(told)
    )
    assert any("'rubbing'" in text and "judge that log" in text for text in summary.warnings(told))
    text = summary.sentence(found)
    assert "held out" not in text
    assert "on blocks that a fit left out" in text


@pytest.mark.parametrize(("rubs", "asserted"), [(0.01, True), (0.0, False)])
def test_a_second_effect_that_is_useless_where_it_is_held_out_is_possible(
    case: tuple[Diagnosis, Told], rubs: float, asserted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a strong first one: of a rig that rubs as the log that is held out, or does not."""
    found, _ = case
    (log,), first, size = found.logs, found.selection.taken, rubs or 1e-4
    run = simulate(changed(found.fitted, {"coulomb_friction.level": rubs}), log.times, log.inputs)
    unseen = np.ones(len(log.times), dtype=bool)
    other = replace(log, name="other", outputs={"angle": run["angle"]}, held_out=unseen)

    def on_both(fitted: FittedModel, *more: Free) -> FittedModel:
        problem = Problem(found.model, (log, other), (*fitted.problem.free, *more), found.floors)
        vector = np.append(fitted.evidence.vector, [size / one.scale for one in more])
        evidence = replace(fitted.evidence, vector=vector)
        return replace(fitted, problem=problem, evidence=evidence, searched=None)

    level = free_parameter(found.model.plant.parameters["coulomb_friction.level"], 0.0, None)
    pair = replace(on_both(first, level), effects=(*first.effects, "coulomb_friction"))
    tried = [pair, on_both(first)]
    selection = replace(
        found.selection, taken=pair, tried=tried, retuned=on_both(found.selection.retuned)
    )
    verdict = replace(found.verdict, kind=EFFECTS)
    scores = held_out_scores(selection)
    told = replace(found, selection=selection, verdict=verdict, held_out=scores)
    monkeypatch.setattr(summary, "undetermined", lambda _: ())
    assert told.contradicted == (() if asserted else ("coulomb_friction",))
    why = "against the model without coulomb_friction the error held out falls by less than 10 %"
    assert (why in summary.not_asserted(told)) is not asserted
    less = probabilities(selection, verdict, told.contradicted)
    sure = probabilities(selection, verdict, ())
    assert less["transport_delay"] == sure["transport_delay"]


@pytest.mark.parametrize("after", [math.nan, 3.0])
def test_no_effect_is_blamed_where_parameters_alone_cannot_be_simulated(
    case: tuple[Diagnosis, Told], after: float
) -> None:
    found = replace(case[0])
    found.__dict__["held_out"] = (
        HeldOut("light", 9, math.nan, math.nan, after, worse=False, outputs={}),
    )
    (text,) = [text for text in summary.warnings(found) if "'light'" in text]
    assert "with parameters alone" in text
    assert "something else is missing" not in text


def test_parameters_that_close_little_are_not_said_to_explain_a_gap(
    case: tuple[Diagnosis, Told],
) -> None:
    found = replace(case[0], verdict=Verdict("parameters", {}, (), ()))
    little = replace(found.gap, closed=(0.49, 0.0, 0.6))
    text = "The gap cannot be told from noise, no effect is needed"
    assert summary.headline(replace(found, gap=little)) == text
    assert summary.headline(replace(found, moved=())) == text
    outside = replace(found, verdict=Verdict("outside-catalogue", {}, (), ()), moved=())
    bare = replace(found.selection, taken=found.selection.retuned)
    assert "with the nominal model" in summary.headline(replace(outside, selection=bare))


def test_an_effect_that_every_explanation_names_is_told_as_sure(
    case: tuple[Diagnosis, Told],
) -> None:
    found, _ = case
    taken = found.selection.taken
    pair = [replace(taken, effects=("transport_delay", it)) for it in ("backlash", "sensor_lag")]
    members = ("transport_delay", "backlash", "sensor_lag")
    text = summary.headline(
        replace(found, verdict=Verdict("not-identifiable", {}, members, tuple(pair)))
    )
    assert text == (
        "It is transport_delay on 'voltage', and these logs cannot tell which other effect:"
        " backlash, sensor_lag leave much the same"
    )


def test_what_moved_beyond_its_prior_is_warned_of(case: tuple[Diagnosis, Told]) -> None:
    found, _ = case
    assert not any("prior deviations" in text for text in summary.warnings(found))
    value = found.found[0]
    spread = {one.name: one.prior for one in found.selection.taken.problem.free}[value.name]
    assert spread
    found.__dict__["found"] = (replace(value, value=value.nominal + 5.0 * spread),)
    try:
        assert summary.moves(found) == {value.name: pytest.approx(5.0)}
        (text,) = [it for it in summary.warnings(found) if "prior deviations" in it]
        assert f"'{value.name}' by +5" in text
    finally:
        del found.__dict__["found"]


@pytest.mark.parametrize(("share", "warned"), [(0.4, False), (0.6, True)])
def test_motion_that_counts_as_noise_is_warned_of(
    case: tuple[Diagnosis, Told], share: float, warned: bool
) -> None:
    found, _ = case
    (gap,) = found.gaps
    assert gap.motion < 0.1 * gap.floor
    seen = replace(found, gaps=(replace(gap, motion=share * gap.floor),))
    assert any("contains motion" in text for text in summary.warnings(seen)) == warned


@pytest.mark.parametrize(
    ("times", "tolerance", "said"),
    [(2.0, 2.0, ""), (4.0, 2.0, "counts as noise"), (4.0, 1e9, "a smaller --tolerance")],
)
def test_repeats_that_differ_by_more_than_noise_are_warned_of(
    case: tuple[Diagnosis, Told], times: float, tolerance: float, said: str
) -> None:
    found, _ = case
    (gap,), (audit,) = found.gaps, found.audits
    (reading,) = audit.readings
    spread = times * max(reading.floor.quantum, reading.floor.residual)
    seen = replace(reading, floor=structs.replace(reading.floor, repeats=spread))
    told = replace(
        found,
        audits=(replace(audit, readings=(seen,)),),
        gaps=(replace(gap, floor=spread, origin=seen.floor.origin),),
        verdict=decide(found.selection, tolerance),
    )
    about = [text for text in summary.warnings(told) if "between repeats" in text]
    assert bool(about) == bool(said)
    assert all(said in text for text in about)
    assert all(("--tolerance" in text) == told.within_tolerance for text in about)


def test_repeats_of_readings_that_do_not_scatter_are_told_without_a_ratio(
    case: tuple[Diagnosis, Told],
) -> None:
    """A reading of a simulation that rests most of the time: its differences are 0."""
    found, _ = case
    (gap,), (audit,) = found.gaps, found.audits
    (reading,) = audit.readings
    still = replace(reading, floor=Floor(0.0, gap.floor, 0.0))
    told = replace(
        found,
        audits=(replace(audit, readings=(still,)),),
        gaps=(replace(gap, origin=still.floor.origin),),
    )
    assert any("far more than it scatters by" in text for text in summary.warnings(told))


@pytest.mark.parametrize(("off", "warned"), [(0.0, False), (1e-3, True)])
def test_an_fmu_that_differs_from_the_simulation_is_warned_of(
    case: tuple[Diagnosis, Told], off: float, warned: bool
) -> None:
    seen = replace(case[0], unconfirmed=Confirmation((), off).doubt)
    about = [text for text in summary.warnings(seen) if "FMU" in text]
    assert len(about) == warned
    assert all("0.001 of full scale" in text for text in about)


def test_the_parameter_file_is_the_fitted_model(case: tuple[Diagnosis, Told]) -> None:
    found, _ = case
    assert found.parameter_set().model().values == found.fitted.values


def test_linear_algebra_keeps_to_one_thread_and_gets_the_others_back() -> None:
    import scipy.linalg  # noqa: F401

    def threads() -> list[int]:
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    before = threads()
    assert before
    with Workers(1):
        assert set(threads()) == {1}
    assert threads() == before


def test_the_slowest_time_constant_is_that_of_the_slowest_pole() -> None:
    poles = np.roots(EQ_12[1])
    expected = 1.0 / np.min(-poles.real)
    assert slowest_time_constant(model("torque_motor", "identified")) == pytest.approx(
        expected, rel=1e-4
    )


@given(st.lists(st.floats(1e-3, 1e3), min_size=1, max_size=4), st.booleans(), st.booleans())
def test_poles_of_known_time_constants(times: list[float], clocked: bool, free: bool) -> None:
    """Decays of known length, with and without a clock, beside an integrator or not."""
    period = 0.3 * min(times) if clocked else 0.0
    rates = [1.0 / time for time in times] + [0.0] * free
    diagonal = [np.exp(-rate * period) if clocked else -rate for rate in rates]
    n = len(rates)
    linear = LinearModel(
        np.diag(diagonal), np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0)),
        tuple("x" * n), (), (), (), {}, {}, {}, period,
    )  # fmt: skip
    assert linear.slowest() == pytest.approx(max(times), rel=1e-6)
    assert linear.integrates() is free


def test_nothing_that_decays_has_no_slowest_time_constant() -> None:
    none = np.zeros((1, 0)), np.zeros((0, 1)), np.zeros((0, 0))
    linear = LinearModel(np.zeros((1, 1)), *none, ("x",), (), (), (), {}, {}, {})
    assert linear.slowest() == 0.0


def two_outputs(count: int) -> Problem:
    times = 1e-3 * np.arange(count)
    random = np.random.default_rng(2)
    outputs = {"angle": random.normal(size=count), "current": random.normal(size=count)}
    log = log_of(times, {"voltage": np.zeros(count)}, outputs)
    return Problem(model("torque_motor"), [log], [], {"angle": 0.2, "current": 3.0})


@given(st.integers(0, 2**32 - 1), st.floats(0.1, 10.0))
def test_gaps_of_outputs_make_up_the_gap_of_all(seed: int, size: float) -> None:
    """In noise floors, squares of equally long outputs average to that of all of them."""
    problem = two_outputs(200)
    random = np.random.default_rng(seed)
    parts = blocks(problem)

    def stage(scale: float) -> CrossValidation:
        errors = scale * random.normal(size=len(parts)) * np.where(parts % 2, 1.0, 3.0)
        return CrossValidation(np.empty(0), errors, errors, parts)

    before, retuned, after = stage(5.0 * size), stage(2.0 * size), stage(size)
    selection: Any = SimpleNamespace(
        before=before,
        retuned=SimpleNamespace(problem=problem, evidence=retuned),
        taken=SimpleNamespace(evidence=after),
    )
    floors = dict(problem.sigma)
    whole = whole_gap(selection, 0)
    single = gaps(selection, floors, dict.fromkeys(floors, ""), 0)
    for name, evidence in (("before", before), ("retuned", retuned), ("after", after)):
        squares = [(gap.rms[name] / gap.floor) ** 2 for gap in single]
        assert whole.rms[name] ** 2 == pytest.approx(np.mean(squares))
        assert whole.rms[name] == pytest.approx(evidence.rms)
        low, high = whole.intervals[name]
        assert low <= whole.rms[name] * 1.05
        assert high >= whole.rms[name] * 0.95


@pytest.mark.parametrize(
    ("names", "read"), [(["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c")]
)
def test_names_are_listed_as_one_reads_them(names: list[str], read: str) -> None:
    assert summary.listed(iter(names)) == read


def test_every_effect_is_told_on_a_declared_wire_the_first_that_it_is_placed_on() -> None:
    for actuator in actuators().values():
        plant = actuator.plant
        for name, placements in plant.placements.items():
            if plant.main(name).effect.hints.learnt:
                continue  # it acts on one of three wires, and is told on that
            wires = [wire for link in placements for wire in link.on]
            wire = plant.main_wire(name)
            assert wire in plant.wire
            before = {it for it in wires[: wires.index(wire)] if it in plant.wire}
            # a play divides the inertia before its output is another one
            assert before <= {"shaft_inertia", "coasting_inertia"}


@pytest.mark.thorough
@in_c_only
def test_a_diagnosis_loads_no_library_that_takes_longer_than_its_search(tmp_path: Path) -> None:
    path = describe(tmp_path, seconds=0.1)
    code = f"import servo_models, sys; servo_models.diagnose({str(path)!r}); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    heavy = {"scipy.stats", "scipy.signal", "scipy.optimize", "scipy.linalg", "matplotlib", "numba"}
    assert not heavy & set(loaded.stdout.decode().split())


def limited_servo(times: Array, goal: Array) -> Array:
    """A servo of 25 rad/s that turns at most 120 deg/s, 30 ms late, in Euler steps of 0.2 ms."""
    fine, angle, speed = np.arange(0.0, times[-1] + 2e-4, 2e-4), 0.0, 0.0
    late = goal[np.clip(np.searchsorted(times, fine - 0.03, side="right") - 1, 0, None)]
    angles = np.empty_like(fine)
    for k, reference in enumerate(late):
        angles[k] = angle
        drive = min(max(25.0 / 1.6 * (reference - angle), -120.0), 120.0)
        speed += 40.0 * (drive - speed) * 2e-4
        angle += speed * 2e-4
    return np.interp(times, fine, angles)


@pytest.mark.thorough
def test_no_effect_is_blamed_where_re_tuning_had_stopped_short() -> None:
    times, random = np.arange(0.0, 14.0, 0.02), np.random.default_rng(3)
    goal = np.zeros_like(times)
    levels = [(1.0, -16.1), (2.5, 16.1), (4.0, -3.2), (5.0, 0.6), (5.7, -5.8), (7.0, 0.0)]
    for begin, level in levels:
        goal[times > begin] = level
    since = np.clip(times - 7.0, 0.0, None)
    goal -= 16.1 * np.sin(2.0 * np.pi * (0.3 * since + 0.06 * since**2)) * np.clip(2 * since, 0, 1)
    angle = limited_servo(times, goal) + random.normal(0.0, 0.05, len(times))
    description = sm.describe(
        sm.model("second_order_servo", "bus"),
        logs={"flight": {"t": times, "goal": goal, "angle": angle}},
        columns={"time": "t", "goal": ("goal", "deg"), "angle": ("angle", "deg")},
    )

    found = sm.diagnose(description)

    assert found.verdict.kind == PARAMETERS
    assert found.selection.taken.values["transport_delay.time"] == pytest.approx(0.03, abs=1e-3)
