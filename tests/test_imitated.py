"""What re-tuned parameters imitate: effects that one log cannot show, and the next one does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Run

from servo_models.description import read_description
from servo_models.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.experiments.experiment import next_experiments
from servo_models.diagnosis.telling import words
from servo_models.diagnosis.telling.sheet import diagnosis_sheet
from servo_models.diagnosis.verdict import Verdict
from servo_models.report.diagnosis.ruled_out import section
from servo_models.simulate import Array, Model, model, simulate

FLOOR = 2e-5
DEAD_ZONE = {"drive_dead_zone.half_width": 1.5}
TWO_LEVELS = np.repeat([0.0, 10.0, 0.0], 200)
"""Of a static law nothing but its value at one voltage shows."""
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
LOG = """
[[logs]]
file = "{}"
time = {{ column = "t", unit = "s" }}
inputs.voltage = {{ column = "u", unit = "V" }}
outputs.angle = {{ column = "angle", unit = "rad" }}
"""


def rig(effects: dict[str, float]) -> Model:
    values = {"end_stops.half_range": 0.0, "torque_constant": 5.5, **effects}
    return model("torque_motor", "measured", values)


def record(file: Path, effects: dict[str, float], volts: Array, seed: int, step: float) -> str:
    """Play a command on a rig; returns the lines that describe its log."""
    times = step * np.arange(float(len(volts)))
    noise = FLOOR * np.random.default_rng(seed).standard_normal(len(times))
    angle = simulate(rig(effects), times, {"voltage": volts})["angle"] + noise
    rows = np.column_stack([times, volts, angle])
    np.savetxt(file, rows, "%.12g", delimiter=",", header="t,u,angle", comments="")
    return LOG.format(file.name)


def described(folder: Path, effects: dict[str, float], volts: Array) -> Path:
    path = folder / "rig.toml"
    path.write_text(HEAD + record(folder / "first.csv", effects, volts, 1, 5e-4))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("imitated")


@pytest.fixture(scope="module")
def found(folder: Path) -> Diagnosis:
    """A dead zone, of which two levels show nothing that a torque constant does not."""
    return diagnose(described(folder, DEAD_ZONE, TWO_LEVELS), jobs=1)


def test_the_cause_is_among_what_parameters_imitate(found: Diagnosis) -> None:
    assert found.verdict.kind == "parameters"
    suspects = [one.name for one in found.suspects]
    assert {"drive_dead_zone", "drive_saturation", "direction_asymmetry"} <= set(suspects)
    said = words.sentence(found)
    assert f"; these logs do not tell that from {suspects[0]}" in said


def test_an_imitated_effect_moves_much_and_shows_little(found: Diagnosis) -> None:
    """By plain simulations: parameters as they were, and as they were re-tuned beside it."""
    (log,) = found.logs
    noise = 3.0 * np.sqrt(found.causes.retuned.evidence.dispersion)

    def response(values: dict[str, float]) -> Array:
        whole = replace(found.model, values={**found.model.values, **values})
        return simulate(whole, log.times, log.inputs)["angle"] / found.floors["angle"]

    parameters = found.causes.retuned.values
    without = response(parameters)
    measured = log.outputs["angle"] / found.floors["angle"]
    for one in found.imitated:
        own = one.explanation.problem.model.values
        effect = {k: v for k, v in own.items() if k.startswith(f"{one.name}.")}
        moved = response({**parameters, **effect}) - without
        assert np.sqrt(np.mean(moved**2)) == pytest.approx(one.moved, rel=1e-6)
        errors = response({**one.explanation.values, **effect}) - measured
        more = np.sum(errors**2) - np.sum((without - measured) ** 2)
        assert more < noise**2
        assert one.moved > found.tolerance


def test_many_sizes_show_what_two_levels_do_not(found: Diagnosis, tmp_path: Path) -> None:
    """And as before what is another parameter by another name."""
    rich = diagnose(described(tmp_path, {}, MANY), jobs=1)
    assert rich.verdict.kind == "parameters"
    now = {one.name: one.moved for one in rich.imitated}
    poor = {one.name: one.moved for one in found.imitated}
    assert "drive_dead_zone" not in now
    assert now["gain_error"] > 0.5 * poor["gain_error"]


def test_the_next_experiment_shows_what_was_imitated(
    found: Diagnosis, folder: Path, run: Run
) -> None:
    """Played on the rig, its table and the first log name the cause."""
    assert run("diagnose", str(folder / "rig.toml"), "--json", str(folder / "rig.json"))[0] == 1
    planned = next_experiments(found.undecided)
    assert all(one.one == () and one.telling for one in planned)
    assert ("gain_error",) not in {one.other for one in planned}  # another torque constant
    (row,) = (
        it for it in diagnosis_sheet(found, None, (), planned).tables if "shown by" in it.columns
    )
    shown = {name: by for name, _, _, by in row.rows}
    assert shown["gain_error"] == "no command that was tried"
    number = [one.other for one in planned].index(("drive_dead_zone",))
    assert planned[number].telling
    assert shown["drive_dead_zone"] == f"experiment {number + 1}"
    table = np.loadtxt(folder / f"rig_next_{number + 1}.csv", delimiter=",", skiprows=1)
    step = float(np.median(np.diff(table[:, 0])))
    second = record(folder / "second.csv", DEAD_ZONE, table[:, 1], 2, step)
    (folder / "both.toml").write_text((folder / "rig.toml").read_text() + second)
    both = diagnose(folder / "both.toml", jobs=1)
    assert both.verdict.members == ("drive_dead_zone",)
    assert both.imitated == ()


def test_what_parameters_imitate_is_not_said_to_do_nothing(found: Diagnosis) -> None:
    reasons = words.ruled_out(found)
    assert reasons["drive_dead_zone"].startswith("re-tuned parameters imitate it: up to")
    tables = {table.heading: table.rows for table in diagnosis_sheet(found, None).tables}
    told = tables["Not ruled out: re-tuned parameters imitate them"]
    assert [row[0] for row in told] == [one.name for one in found.imitated]
    out = " ".join(names for _, names in tables["Ruled out without a fit"])
    assert "drive_dead_zone" not in out
    part = section(found)
    assert part
    imitated, *others = part.tables
    assert imitated.caption.startswith("Not ruled out")
    assert "drive dead zone" in {line.cells[0] for line in imitated.lines}
    assert "drive dead zone" not in {line.cells[0] for table in others for line in table.lines}


def test_the_reach_of_an_effect_is_that_of_a_simulation(found: Diagnosis) -> None:
    """Of a ripple as well, though looks share it out over two phases."""
    (log,) = found.logs
    parameters = found.causes.retuned.values

    def response(effect: dict[str, float]) -> Array:
        whole = {**found.model.values, **parameters, **effect}
        own = replace(found.model, values=whole)
        return simulate(own, log.times, log.inputs)["angle"] / found.floors["angle"]

    plain = response({})
    for name, settings in {
        "constant_load": {"constant_load.torque": 3e-3},
        "cogging": {"cogging.torque": 3e-5, "cogging.count": 100.0},
    }.items():
        moved = float(np.sqrt(np.mean((response(settings) - plain) ** 2)))
        reach = found.causes.reach[name]
        assert reach.moved > 0.3 * moved > 0.0
        assert reach.shown <= reach.moved * (1.0 + 1e-9)


@pytest.mark.parametrize("kind", ["effect", "no-gap", "outside-catalogue"])
def test_only_parameters_imitate_effects(kind: str, found: Diagnosis) -> None:
    other = replace(found, verdict=Verdict(kind, {}, (), ()))
    assert other.imitated == ()
    assert words.stand_ins(other) == ""
    assert other.undecided == ()


def test_parameters_that_cannot_move_imitate_nothing(folder: Path) -> None:
    """Frozen ones imitate nothing, so every effect that moves the outputs shows."""
    told = read_description(folder / "rig.toml")
    frozen = diagnose(replace(told, uncertainty={}), jobs=1)
    assert frozen.imitated == ()
    assert all(it.shown == pytest.approx(it.moved) for it in frozen.causes.reach.values())
