"""The next experiment: played on the true rig, it tells apart what the first log could not."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.actuators.wiring import AMMETER
from servo_models.analysis.experiment import in_time
from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.sensor import REPEATS, RESIDUAL
from servo_models.data.tables import read_inputs
from servo_models.diagnosis import design
from servo_models.diagnosis.design import (
    Experiment,
    ExperimentDesigner,
    next_experiments,
    repeats_wanted,
)
from servo_models.diagnosis.design.commands import FAMILIES, Command
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.grid_search import shortened
from servo_models.diagnosis.search.residuals import Residuals
from servo_models.diagnosis.search.selection import Selection, select_effects
from servo_models.diagnosis.verdict import Verdict, decide
from servo_models.identification.problem import Problem, free_parameter
from tests.conftest import Run
from tests.support.logs import changed, measured
from tests.support.two_levels import DEAD_ZONE, FLOOR, HEAD, STEP, TWO_LEVELS, record

SECOND_LOG = Path(__file__).parents[2] / "docs" / "studies" / "second_log.md"
KNOWN = {"resistance": 36.3, "stiffness": 0.011, "rotor_inertia": 7e-9}
"""Standard deviations: the constants of Table 1 to 1 %."""


def nominal() -> Model:
    return model("torque_motor", "measured", {"end_stops.half_range": 0.0})


def played(effects: Mapping[str, float], times: Array, voltage: Array, seed: int) -> Log:
    """The rig with effects, measured with white noise."""
    rig, inputs = changed(nominal(), effects), {"voltage": voltage}
    return measured(rig, times, inputs, {"angle": FLOOR}, seed, name=f"log {seed}")


def selection_on(*logs: Log) -> Selection:
    chosen = nominal()
    parameters = chosen.plant.parameters
    free = tuple(
        free_parameter(parameters[name], chosen.values[name], prior)
        for name, prior in KNOWN.items()
    )
    return select_effects(Fitter(chosen, logs, free, {"angle": FLOOR}))


def verdict_on(*logs: Log) -> Verdict:
    return decide(selection_on(*logs))


STATIC = {"drive_dead_zone", "drive_saturation", "gain_error"}  # all make 10 V into 8.5 V


@pytest.fixture(scope="module")
def first() -> Log:
    times = STEP * np.arange(float(len(TWO_LEVELS)))
    return played(DEAD_ZONE, times, TWO_LEVELS, 1)


@pytest.fixture(scope="module")
def verdict(first: Log) -> Verdict:
    return verdict_on(first)


def designed(rivals: Sequence[FittedModel]) -> Experiment:
    """The experiment for fitted models that are equally likely."""
    return next_experiments(rivals, (1.0,) * len(rivals))[0]


def stage_of(rivals: Sequence[FittedModel]) -> ExperimentDesigner:
    return ExperimentDesigner(rivals, (1.0,) * len(rivals), 0)


def as_logged(stage: ExperimentDesigner, command: Command) -> Log:
    (play,) = stage.plays(command, ())
    return stage.plan(play)


@pytest.fixture(scope="module")
def planned(verdict: Verdict) -> Experiment:
    return designed(verdict.rivals)


@pytest.mark.thorough
def test_the_set_shrinks_to_the_truth(first: Log, verdict: Verdict, planned: Experiment) -> None:
    assert set(verdict.members) >= STATIC
    assert planned.telling
    second = played(DEAD_ZONE, planned.times, planned.command, 2)
    both = verdict_on(first, second)
    assert both.members == ("drive_dead_zone",)


@pytest.mark.long
def test_the_table_that_the_command_wrote_closes_the_loop(run: Run, tmp_path: Path) -> None:
    """From a description to a table, from the rig that plays it to a second log of the same."""
    rig, found = tmp_path / "rig.toml", tmp_path / "d.json"
    true = model("torque_motor", "estimated", {"end_stops.half_range": 0.0, **DEAD_ZONE})
    times = STEP * np.arange(float(len(TWO_LEVELS)))
    text = HEAD + record(tmp_path / "first.csv", true, times, TWO_LEVELS, 1)
    rig.write_text(text)
    assert run("diagnose", rig, "--json", found)[0] == 1
    document = json.loads(found.read_text())
    assert document["verdict"] == "not-identifiable"
    assert {one["name"] for one in document["effects"] if one["in_set"]} >= STATIC
    told, *_ = document["next_experiments"]
    times, inputs = read_inputs(tmp_path / told["file"], nominal().plant)
    rig.write_text(text + record(tmp_path / "second.csv", true, times, inputs["voltage"], 2))
    assert run("diagnose", rig, "--json", found)[0] == 1
    document = json.loads(found.read_text())
    assert document["verdict"] == "effect"
    (one,) = [one for one in document["effects"] if one["in_set"]]
    assert (one["name"], one["taken"]) == ("drive_dead_zone", True)
    width, kept = (value["value"] for value in one["parameters"])
    assert (1.0 - kept) * width == pytest.approx(1.5, rel=0.01)  # lost beyond the zone


def test_the_instruction_can_be_followed(verdict: Verdict, planned: Experiment) -> None:
    assert planned.explanations == tuple(rival.effects for rival in verdict.rivals[: design.MOST])
    names = {name for effects in planned.explanations for name in effects}
    for word in (*names, "on voltage for", " V", "log angle at 2000 Hz"):
        assert word in planned.text
    (table,) = re.findall(r"^\| all \|.*$", SECOND_LOG.read_text("utf-8"), re.MULTILINE)
    right, rigs = re.findall(r"\*\*([\d.]+)\*\* \(.*?\) of (\d+)", table)[0]
    assert int(rigs) >= 60
    assert f"Of withheld rigs {float(right):.0%} ended with the right one alone" in planned.text
    assert np.all(np.abs(planned.command) <= 30.0)  # the actuator's standard step


def test_the_table_is_ready_to_play(planned: Experiment, tmp_path: Path) -> None:
    replace(planned, file="next.csv").write(tmp_path, [nominal().plant.wire["angle"]])
    file = tmp_path / "next.csv"
    assert file.read_text().splitlines()[0] == "time [s],voltage [V]"
    times, inputs = read_inputs(file, nominal().plant)
    np.testing.assert_array_equal(times, planned.times)
    np.testing.assert_array_equal(inputs["voltage"], planned.command)


@pytest.mark.parametrize(("samples", "lasts"), [(600, 1.0), (41, 0.1)])
def test_an_experiment_is_as_long_as_a_response_or_a_log(
    samples: int, lasts: float, verdict: Verdict
) -> None:
    """A description may name a variant far slower than what its logs have shown."""
    rival = verdict.rivals[0]
    problem = rival.problem
    brief = Problem(problem.model, shortened(problem.logs, samples), problem.free, problem.sigma)
    stage = stage_of([replace(rival, problem=brief)] * 2)
    assert stage.times[-1] == pytest.approx(lasts * nominal().stop_time, rel=1e-6)


def test_what_parameters_imitate_does_not_count(first: Log) -> None:
    """A gain of the voltage is nothing but another torque constant."""
    chosen = nominal()
    parameters = chosen.plant.parameters
    free = (free_parameter(parameters["torque_constant"], 6.432, 1.6),)
    fitter = Fitter(chosen, [first], free, {"angle": FLOOR})
    # the back EMF tells them apart; without it they are one model
    still = changed(chosen, {"back_emf_constant": 0.0})
    fitter = replace(fitter, model=still)
    retuned = fitter.fit((), ())
    gain = free_parameter(parameters["gain_error.error"], 0.0, None)
    other = fitter.fit(("gain_error",), [gain])
    stage = stage_of((other, retuned))
    assert max(stage.separations(command, ()).max() for command in stage.commands) < 0.1
    (first, *_) = stage.best()
    assert [one.how for one in first.needs] == [AMMETER[0].how]  # a gain changes the current


def test_identical_models_are_told_as_inseparable(verdict: Verdict) -> None:
    rival = verdict.rivals[0]
    found = designed((rival, replace(rival, effects=("transport_delay",))))
    assert not found.telling
    assert f"tells {rival.effects[0]} or transport_delay apart" in found.text


LAG = 1e-3


def test_models_that_differ_above_a_frequency_get_a_command_above_it() -> None:
    """A lag of 1 ms, and a delay of as much that imitates it far below 1 / (2 pi lag)."""
    parameters, rivals = nominal().plant.parameters, []
    times = STEP * np.arange(float(len(TWO_LEVELS)))
    for name in ("sensor_lag.time_constant", "transport_delay.time"):
        log = played({name: LAG}, times, TWO_LEVELS, 1)
        fitter = Fitter(nominal(), [log], (), {"angle": FLOOR})
        effect = free_parameter(parameters[name], 0.0, None)
        rivals.append(fitter.at_values((name.partition(".")[0],), [effect], {name: LAG}))
    found = designed(rivals)
    assert found.telling
    power = np.abs(np.fft.rfft(found.command)) ** 2
    frequency = np.fft.rfftfreq(len(found.command), STEP)
    fast = frequency > 0.2 / LAG / (2.0 * np.pi)
    slow = frequency < 0.2 / found.times[-1]
    assert power[fast].sum() > 0.05 * power[~slow].sum()


@pytest.mark.parametrize(
    ("structured", "least", "origin", "wanted"),
    [
        (0.8, 0.1, RESIDUAL, True),
        (0.8, 0.7, RESIDUAL, False),  # surely no noise
        (0.1, 0.0, RESIDUAL, False),  # too little to matter
        (0.8, 0.1, REPEATS, False),  # known from repeats
    ],
)
def test_repeats_are_wanted_where_noise_and_structure_cannot_be_told_apart(
    structured: float, least: float, origin: str, wanted: bool, first: Log
) -> None:
    text = repeats_wanted(Residuals(structured, least, 1.0, 1.2), [origin], [first])
    assert bool(text) is wanted
    assert not wanted or "command of log 'log 1' 4 times" in text


@pytest.mark.thorough
@pytest.mark.parametrize("recorded", [False, True])
def test_conditions_of_the_log_are_part_of_the_instruction(recorded: bool, first: Log) -> None:
    """A load that was recorded is a condition like one that the description gives."""
    load = np.full(len(first.times), 2e-4)
    inputs = {**first.inputs, "load_torque": load}
    held = replace(first, inputs=inputs) if recorded else None
    loaded = selection_on(held or replace(first, constants={"load_torque": 2e-4}))
    told = designed(loaded.of_size(1)[:2])
    assert told.plans[0].constants == {"load_torque": 2e-4}
    assert "Meanwhile, as in log 'log 1', constants = { load_torque = 0.0002 }." in told.text


def test_an_experiment_begins_at_rest_where_its_limits_allow_that(verdict: Verdict) -> None:
    """Else the motor is held at the first value for as long as a step takes."""
    stage = stage_of(verdict.rivals[:2])
    away = Command("triangle", 5.0, 2.0, 0.01, 0)
    plan = as_logged(stage, away)
    assert plan.settle == 0.0
    assert plan.inputs["voltage"][0] == 0.0
    np.testing.assert_array_equal(plan.inputs["voltage"][1:], away.values(stage.times)[1:])
    stage.low = 1.0
    plan = as_logged(stage, away)
    assert plan.settle == pytest.approx(nominal().stop_time)
    assert plan.inputs["voltage"][0] == away.values(stage.times)[0]


@pytest.mark.thorough
def test_a_played_table_is_read_as_it_was_meant(verdict: Verdict, planned: Experiment) -> None:
    """Its first row says that the rig rests, so that nobody takes what follows for settled."""
    assert planned.plans[0].settle == 0.0
    assert planned.command[0] == 0.0
    assert "Hold its first value" not in planned.text
    stage = stage_of(verdict.rivals[:2])
    stage.low = 10.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "ExperimentDesigner", lambda *_: stage)
        away = designed(verdict.rivals[:2])
    held = in_time(away.plans[0].settle)
    assert f"Hold its first value for {held} before a log begins." in away.text
    assert away.command[0] != 0.0


def test_a_model_that_runs_away_promises_nothing(first: Log) -> None:
    """Twice the gain is told at once, unless both leave by far what the log has ever measured."""
    gain = free_parameter(nominal().plant.parameters["gain_error.error"], 0.0, None)
    told = {}
    for size in (1.0, 1e-5):
        log = replace(first, outputs={"angle": size * first.outputs["angle"]})
        fitter = Fitter(nominal(), [log], (), {"angle": FLOOR})
        other = fitter.at_values(("gain_error",), [gain], {"gain_error.error": 1.0})
        stage = stage_of((fitter.at_values((), (), {}), other))
        told[size] = stage.differences(Command("triangle", 0.0, 10.0, 0.05, 0), ["angle"]).max()
    assert told[1.0] > 100.0
    assert told[1e-5] == 0.0


def test_what_parameters_imitate_is_no_separation_however_far_they_have_to_go(first: Log) -> None:
    """A spring half as stiff again, of which a log at rest says nothing and its prior little."""
    still = replace(first, inputs={"voltage": 0.0 * TWO_LEVELS})
    spring = nominal().plant.parameters["stiffness"]
    value = nominal().values["stiffness"]
    fitter = Fitter(
        nominal(), [still], (free_parameter(spring, value, 10.0 * value),), {"angle": FLOOR}
    )
    rivals = [fitter.at_values((), (), {"stiffness": by * value}) for by in (1.0, 1.5)]
    stage = stage_of(rivals)
    command = Command("triangle", 0.0, 10.0, 0.05, 0)
    assert stage.differences(command, ["angle"]).max() > 50.0
    linear = stage.separations(command, ())
    assert linear.max() > 0.3  # slopes are those of another spring
    assert stage.masked(command, (), linear).max() < 0.1


def test_a_refit_leaves_no_more_than_there_was(verdict: Verdict) -> None:
    stage = stage_of(verdict.rivals[:2])
    for family in ("triangle", "chirp"):
        command = Command(family, 0.0, 10.0, 0.05, 0)
        most = stage.differences(command, ["angle"])
        assert np.all(stage.masked(command, (), most) <= most)


def test_what_is_played_does_not_hold_meanwhile(verdict: Verdict, first: Log) -> None:
    """Where the first log holds the input that another one moves."""
    held = replace(
        first, inputs={"load_torque": 1e-6 * first.inputs["voltage"]}, constants={"voltage": 5.0}
    )
    rivals = verdict.rivals[:2]
    rivals = tuple(replace(it, problem=replace_logs(it.problem, [held, first])) for it in rivals)
    stage = stage_of(rivals)
    plan = as_logged(stage, Command("triangle", 0.0, 2.0, 0.05, 0))
    assert list(plan.inputs) == ["voltage"]
    assert set(plan.constants) == {"load_torque"}


def replace_logs(problem: Problem, logs: list[Log]) -> Problem:
    return Problem(problem.model, logs, problem.free, sigma=problem.sigma)


def test_a_log_too_coarse_for_every_pace_gets_slower_ones(verdict: Verdict, first: Log) -> None:
    """Eight samples of 25 ms in the 0.2 s of a step of the motor."""
    times = 0.025 * np.arange(float(len(TWO_LEVELS)))
    coarse = played(DEAD_ZONE, times, TWO_LEVELS, 1)
    rivals = tuple(
        replace(it, problem=replace_logs(it.problem, [coarse])) for it in verdict.rivals[:2]
    )
    action, *_ = stage_of(rivals).best()
    assert np.all(action.separations >= 0.0)
    assert action.command.pace >= 5.0 * 0.025


def test_nothing_to_separate() -> None:
    assert next_experiments((), ()) == ()


@given(
    family=st.sampled_from(sorted(FAMILIES)),
    middle=st.floats(-1.0, 1.0),
    size=st.floats(1e-3, 2.0),
    pace=st.floats(0.01, 0.5),
    seed=st.integers(0, 9),
)
def test_a_command_keeps_its_limits(
    family: str, middle: float, size: float, pace: float, seed: int
) -> None:
    times = 1e-3 * np.arange(1001.0)
    values = Command(family, middle, size, pace, seed).values(times)
    assert np.abs(values - middle).max() <= size * (1.0 + 1e-9)
    np.testing.assert_array_equal(values, Command(family, middle, size, pace, seed).values(times))


def test_a_chirp_ends_at_the_frequency_that_it_says() -> None:
    times = 1e-5 * np.arange(100_001.0)
    values = Command("chirp", 0.0, 1.0, 0.02, 0).values(times)
    crossings = times[1:][np.diff(np.sign(values)) != 0.0]
    assert 2.0 * (crossings[-1] - crossings[-2]) == pytest.approx(0.02, rel=0.05)


def test_a_ladder_grows_from_the_step_that_it_says() -> None:
    command = Command("ladder", 5.0, 2.0, 0.01, 0)
    steps = np.abs(command.values(0.005 + 0.01 * np.arange(400.0)) - 5.0)
    text = command.text(nominal().plant.wire["voltage"], 4.0)
    told = [float(step) for step in re.findall(r"(?:from|to) ([\d.]+) V", text)]
    assert told == pytest.approx([5.0, steps[steps > 0.0].min(), steps.max()], rel=0.02)
