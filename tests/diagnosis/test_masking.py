"""What re-tuned parameters imitate: effects that one log cannot show, and the next one does."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.diagnosis.search.masking import masked_effects
from servo_models.diagnosis.search.screening import screening_results
from servo_models.diagnosis.sections import tables
from servo_models.diagnosis.verdict import Verdict
from servo_models.identification.problem import prior_parameters
from studies.masked_inertia import listed
from studies.masked_inertia import rig as rig_with_inertia
from tests.conftest import Run
from tests.support.logs import changed
from tests.support.schemas import check_schema
from tests.support.two_levels import DEAD_ZONE, STEP, TWO_LEVELS, record

MANY = np.repeat([0.0, 3.0, 10.0, -6.0, -1.0, 14.0, -14.0, 1.0, -4.0, 0.0], 120)
HEAD = """
actuator = "torque_motor"
variant = "measured"
parameters.end_stops.half_range = 0
[uncertainty]
torque_constant = "25 %"
resistance = "1 %"
stiffness = "1 %"
rotor_inertia = "1 %"
"""

STEP_SHARE = 2e-3  # what the longer internal step of a search may change, far below the noise


def rig(effects: dict[str, float]) -> Model:
    values = {"end_stops.half_range": 0.0, "torque_constant": 5.5, **effects}
    return model("torque_motor", "measured", values)


def described(folder: Path, effects: dict[str, float], volts: Array) -> Path:
    path = folder / "rig.toml"
    times = STEP * np.arange(float(len(volts)))
    path.write_text(HEAD + record(folder / "first.csv", rig(effects), times, volts, 1))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("masked")


@pytest.fixture(scope="module")
def found(folder: Path) -> Diagnosis:
    """A dead zone, of which two levels show nothing that a torque constant does not."""
    return diagnose(described(folder, DEAD_ZONE, TWO_LEVELS), jobs=1)


def masked(found: Diagnosis) -> dict[str, float]:
    return {one.name: one.moved for one in found.masked}


def test_the_cause_is_among_what_parameters_imitate(found: Diagnosis) -> None:
    assert found.verdict.kind == "parameters"
    assert {"drive_dead_zone", "drive_saturation", "direction_asymmetry"} <= masked(found).keys()
    assert {"drive_dead_zone"} <= {name for it in found.undecided for name in it.effects}


def test_the_set_of_parameters_is_what_they_mask(found: Diagnosis) -> None:
    assert set(found.verdict.members) == masked(found).keys()
    ranked = {one.name: one.in_set for one in found.ranking}
    assert all(ranked[name] for name in masked(found).keys() & ranked.keys())


def test_an_imitated_effect_moves_much_and_shows_little(found: Diagnosis) -> None:
    """By plain simulations: parameters as they were, and as they were re-tuned beside it."""
    (log,) = found.logs
    noise = 3.0 * np.sqrt(found.selection.retuned.evidence.dispersion)

    def response(values: dict[str, float]) -> Array:
        whole = changed(found.model, values)
        return simulate(whole, log.times, log.inputs)["angle"] / found.floors["angle"]

    parameters = found.selection.retuned.values
    without = response(parameters)
    measured = log.outputs["angle"] / found.floors["angle"]
    for one in found.masked:
        own = one.fitted_model.problem.model.values
        effect = {k: v for k, v in own.items() if k.startswith(f"{one.name}.")}
        moved = response({**parameters, **effect}) - without
        assert np.sqrt(np.mean(moved**2)) == pytest.approx(one.moved, rel=STEP_SHARE)
        errors = response({**one.fitted_model.values, **effect}) - measured
        more = np.sum(errors**2) - np.sum((without - measured) ** 2)
        assert more < noise**2
        assert one.moved > found.tolerance


def most_by_scipy(found: Diagnosis, name: str, sizes: Array) -> float:
    """How far the largest of some sizes moves the outputs beside which parameters, fitted by a
    library, leave no more than noise does and go no further than their priors allow."""
    (log,) = found.logs
    retuned = found.selection.retuned
    free = [one for one in retuned.problem.free if one.prior is not None]
    floor, measured = found.floors["angle"], log.outputs["angle"]

    def errors(values: dict[str, float]) -> Array:
        whole = changed(found.model, values)
        return (simulate(whole, log.times, log.inputs)["angle"] - measured) / floor

    def strain(values: dict[str, float]) -> Array:
        return np.array([(values[one.name] - one.nominal) / float(one.prior or 1) for one in free])

    start = {one.name: retuned.values[one.name] for one in free}
    plain, before = errors(start), strain(start)
    largest = 0.0
    for size in sizes:
        effect = {name: float(size)}

        def at(vector: Array, effect: dict[str, float] = effect) -> dict[str, float]:
            return {**{one.name: v * one.scale for one, v in zip(free, vector)}, **effect}

        fit = least_squares(
            lambda v: np.concatenate([errors(at(v)), strain(at(v))]),
            [start[one.name] / one.scale for one in free],
            x_scale="jac",
        )
        more = np.sum(errors(at(fit.x)) ** 2) - np.sum(plain**2)
        strained = np.sum(strain(at(fit.x)) ** 2) - np.sum(before**2)
        if more <= 9.0 * retuned.evidence.dispersion and strained <= 9.0:
            moved = float(np.sqrt(np.mean((errors({**start, **effect}) - plain) ** 2)))
            largest = max(largest, moved)
    return largest


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("gain_error.error", np.linspace(-0.35, -0.05, 13)),
        ("drive_saturation.limit", np.linspace(3.0, 10.0, 15)),
        ("drive_dead_zone.half_width", np.linspace(0.5, 3.0, 6)),
    ],
)
def test_no_much_larger_size_is_imitated(name: str, sizes: Array, found: Diagnosis) -> None:
    """By a library, over a grid up to the largest size that is looked at."""
    told = masked(found)[name.partition(".")[0]]
    most = most_by_scipy(found, name, sizes)
    assert 0.7 * most < told < 1.1 * most


@pytest.mark.thorough
def test_many_sizes_show_what_two_levels_do_not(found: Diagnosis, tmp_path: Path) -> None:
    """But for what is another parameter by another name."""
    rich = diagnose(described(tmp_path, {}, MANY), jobs=1)
    assert rich.verdict.kind == "parameters"
    assert "drive_dead_zone" not in masked(rich)
    assert masked(rich)["gain_error"] > 0.5 * masked(found)["gain_error"]


@pytest.mark.long
def test_the_next_experiment_shows_what_was_imitated(
    found: Diagnosis, folder: Path, run: Run
) -> None:
    """Played on the rig, its table and the first log name the cause."""
    code, out, _ = run("diagnose", str(folder / "rig.toml"), "--json", str(folder / "rig.json"))
    assert code == 1
    assert "would not show in these logs, and do in the next experiment." in " ".join(out.split())
    told = json.loads((folder / "rig.json").read_text())
    check_schema(told)
    assert {it["name"]: it["up_to"] for it in told["masked"]} == masked(found)
    planned, *_ = found.next_experiments
    assert planned.explanations[0] == ()
    # another torque constant, but for the current
    assert planned.rules_out((), ("gain_error",)) == ("current" in planned.floors)
    assert planned.rules_out((), ("drive_dead_zone",))
    times, voltage = np.loadtxt(folder / "rig_next_1.csv", delimiter=",", skiprows=1).T
    second = record(folder / "second.csv", rig(DEAD_ZONE), times, voltage, 2)
    (folder / "both.toml").write_text((folder / "rig.toml").read_text() + second)
    both = diagnose(folder / "both.toml", jobs=1)
    assert both.verdict.members == ("drive_dead_zone",)
    assert both.masked == ()


def test_what_is_imitated_is_told_with_what_shows_it(found: Diagnosis) -> None:
    planned: Any = SimpleNamespace(
        explanations=((), ("drive_dead_zone",)),
        rules_out=lambda model, right: (model, right) == ((), ("drive_dead_zone",)),
        steps=("Play.",),
        file="a",
        telling=True,
    )
    told = replace(found, written=(planned,))
    assert summary.sentence(told).endswith(
        "; drive_dead_zone would not show in these logs, and does in the next experiment."
    )
    rows = tables.masked(told).rows
    assert {row[0] for row in rows} == masked(found).keys()
    assert {name for name, _, _, shown in rows if shown == "yes"} == {"drive_dead_zone"}


def test_what_parameters_imitate_is_not_ruled_out(found: Diagnosis) -> None:
    assert not summary.ruled_out(found).keys() & masked(found).keys()


@pytest.mark.thorough
def test_the_order_of_looks_decides_nothing(found: Diagnosis) -> None:
    told = read_description(found.logs[0].path.parent / "rig.toml")
    fitter = Fitter(told.model, told.logs, prior_parameters(told), found.floors)
    retuned = fitter.finish(fitter.fit((), ()))
    results = screening_results([retuned.linearised], candidates(fitter.model, fitter.logs))
    one, other = (masked_effects(fitter, retuned, it, 2.0) for it in (results, results[::-1]))
    assert {it.name: it.moved for it in one} == {it.name: it.moved for it in other}


def test_codes_in_the_loop_hide_no_added_inertia() -> None:
    """It is the servo's own inertia by another name, whatever jumps with the codes."""
    assert listed(rig_with_inertia("xl330", 0.5, seed=20264455))


def test_the_reach_of_an_effect_is_that_of_its_largest_size(found: Diagnosis) -> None:
    """Of a ripple as well, though looks share it out over two phases."""
    (log,) = found.logs
    parameters = {**found.model.values, **found.selection.retuned.values}

    def response(effect: Mapping[str, float]) -> Array:
        own = replace(found.model, values={**parameters, **effect})
        return simulate(own, log.times, log.inputs)["angle"] / found.floors["angle"]

    plain = response({})
    every = {one.name: one for one in candidates(found.model, found.logs)}
    load = [response(size) - plain for size in every["constant_load"].trial_values]
    most = max(float(np.sqrt(np.mean(it**2))) for it in load)
    assert found.selection.detectability["constant_load"].moved == pytest.approx(
        most, rel=STEP_SHARE
    )
    ripples = [
        response({**size, "cogging.phase": phase}) - plain
        for size in every["cogging"].trial_values
        for phase in (0.0, 0.5 * np.pi)
    ]
    most = 10.0 * max(float(np.sqrt(np.mean(it**2))) for it in ripples)
    assert found.selection.detectability["cogging"].moved == pytest.approx(most, rel=STEP_SHARE)
    for reach in found.selection.detectability.values():
        assert reach.shown <= reach.moved * (1.0 + 1e-9)


@pytest.mark.parametrize("kind", ["effect", "no-gap", "outside-catalogue"])
def test_only_parameters_imitate_effects(kind: str, found: Diagnosis) -> None:
    other = replace(found, verdict=Verdict(kind, {}, (), ()))
    assert other.masked == ()
    assert other.undecided == ()


def test_parameters_that_explain_little_imitate_nothing(found: Diagnosis) -> None:
    """The gap cannot be told from noise then, and whatever they do is no reason to doubt that."""
    judged = found.selection.retuned.evidence
    left = 3.0 / judged.rms  # 3 noise floors of the 3.5 before are left: a fifth is closed
    evidence = replace(judged, unseen=left * judged.unseen)
    selection = replace(
        found.selection,
        before=replace(found.selection.before, unseen=3.5 / judged.rms * judged.unseen),
        retuned=replace(found.selection.retuned, evidence=evidence),
    )
    little = replace(found, selection=selection)
    assert "cannot be told from noise" in summary.headline(little)
    assert little.masked == ()
    assert little.undecided == ()


def test_parameters_that_cannot_move_imitate_nothing(folder: Path) -> None:
    """Frozen ones imitate nothing, so every effect that moves the outputs shows."""
    told = read_description(folder / "rig.toml")
    frozen = diagnose(replace(told, uncertainty={}), jobs=1)
    assert frozen.masked == ()
    assert all(
        it.shown == pytest.approx(it.moved) for it in frozen.selection.detectability.values()
    )
