"""servo-models diagnose: what it prints and writes, and its exit codes."""

from __future__ import annotations

import contextlib
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
import numpy as np
import pytest
from jsonschema import ValidationError

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.cli import main
from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.data.parameters import read_parameters
from servo_models.diagnosis.search import fitting
from servo_models.identification.optimise import descend
from servo_models.identification.problem import Problem
from servo_models.validation.torque_motor.reference import DELAY, IDENTIFIED, Linear
from tests.conftest import Run
from tests.support.delayed_motor import DESCRIPTION, NOISE, RATE, describe
from tests.support.fmu_host import Host
from tests.support.html_page import Page
from tests.support.schemas import check_schema


class Session(NamedTuple):
    """A diagnosis of which the last fifth of the log is held out."""

    folder: Path
    code: int
    text: str
    document: dict[str, Any]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Session:
    folder = tmp_path_factory.mktemp("diagnosed")
    path = describe(folder, DESCRIPTION.format('held_out = { from = "0.4 s", to = "0.5 s" }'))
    words = ["diagnose", path, "--json", folder / "d.json", "--out", folder / "found.toml"]
    printed, complaints = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(complaints):
        code = main([str(word) for word in [*words, "--report", folder / "d.html"]])
    (line,) = complaints.getvalue().splitlines()
    assert re.fullmatch(r"first answer after .* s: transport_delay, gap .* floors; refining", line)
    document = json.loads((folder / "d.json").read_text())
    return Session(folder, code, printed.getvalue(), document)


def test_the_delay_of_the_paper_is_named_and_measured(session: Session) -> None:
    assert session.code == 1
    assert session.document["verdict"] == "effect"
    first = session.document["effects"][0]
    assert (first["name"], first["block"]) == ("transport_delay", "voltage")
    assert first["taken"]
    assert first["in_set"]
    (time,) = first["parameters"]
    assert time["unit"] == "s"
    assert abs(time["value"] - DELAY) < 4.0 * time["standard_error"]
    assert time["standard_error"] < 0.01 * DELAY


def test_the_gap_is_that_of_the_noise_once_it_is_closed(session: Session) -> None:
    """The noise is known here: neither the floor nor what is left is anything else."""
    gap = session.document["gap"]["outputs"]["angle"]
    assert gap["unit"] == "rad"
    assert gap["floor"] == pytest.approx(NOISE, rel=0.1)
    assert gap["after"] == pytest.approx(NOISE, rel=0.1)
    assert gap["intervals"]["after"][0] < gap["after"] < gap["intervals"]["after"][1]
    assert session.document["gap"]["before"] > 2.0 > session.document["gap"]["after"]


def test_the_gap_before_is_the_error_of_the_nominal_model(session: Session) -> None:
    (log,) = read_description(session.folder / "rig.toml").logs
    voltage = np.asarray(log.inputs["voltage"])
    inputs = {"voltage": voltage, "load_torque": np.zeros_like(voltage)}
    undelayed = Linear(IDENTIFIED.__class__(**{**vars(IDENTIFIED), "delay": 0.0}))
    error = (undelayed(log.times, inputs)["angle"] - log.outputs["angle"])[log.fitted]
    before = session.document["gap"]["outputs"]["angle"]["before"]
    assert before == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-3)


def test_the_audit_of_the_log_and_what_moved_without_effects_are_told(session: Session) -> None:
    (log,) = session.document["logs"]
    assert (log["samples"], log["gaps"]) == (0.5 * RATE, 0)
    assert log["step"] == pytest.approx(1.0 / RATE)
    assert log["readings"]["angle"]["floor"]["residual"] == pytest.approx(NOISE, rel=0.1)
    retuned = {one["name"]: one["retuned"] for one in session.document["parameters"]}
    assert retuned["transport_delay.time"] is None  # an effect is none of the parameters
    assert (
        retuned["torque_constant"] != model("torque_motor", "identified").values["torque_constant"]
    )


def test_the_json_keeps_to_its_schema(session: Session) -> None:
    check_schema(session.document)
    assert "NaN" not in (session.folder / "d.json").read_text()


def test_the_schema_refuses_another_document(session: Session) -> None:
    changed = {**session.document, "verdict": "perhaps"}
    lacking = {key: value for key, value in session.document.items() if key != "warnings"}
    for wrong in (changed, lacking):
        with pytest.raises(ValidationError):
            check_schema(wrong)


def test_an_fmu_of_the_parameter_file_leaves_what_the_json_says(
    session: Session, run: Run, tmp_path: Path
) -> None:
    """Built by another command, run by another host, judged here: the loop is closed."""
    assert run("build", "--params", session.folder / "found.toml", "--out", tmp_path)[0] == 0
    fmu = sorted(tmp_path.glob("*.fmu"))[-1]  # the native one, where there is a compiler
    folder = fmpy.extract(str(fmu), str(tmp_path / "fmu"))
    (log,) = read_description(session.folder / "rig.toml").logs
    times = np.concatenate([[0.0], log.times + log.settle]) if log.settle else log.times
    inputs = np.zeros((len(times), 2))
    inputs[-len(log.times) :, 0] = log.inputs["voltage"]
    inputs[0, 0] = log.inputs["voltage"][0]
    with Host(Path(folder)) as host:
        error = host.simulate(times, inputs)[-len(log.times) :, 0] - log.outputs["angle"]
    told = session.document["confirmation"]["outputs"]["angle"]
    for part, mask in (("fit", log.fitted), ("held_out", log.held_out)):
        assert told[part]["after"] == pytest.approx(np.sqrt(np.mean(error[mask] ** 2)), rel=1e-12)
        if part == "held_out":
            held = session.document["held_out_outputs"]["angle"]
            assert [held["before"], held["after"]] == pytest.approx([*told[part].values()])
    assert session.document["confirmation"]["difference"] == 0.0


def test_the_parameter_file_says_where_its_values_are_from(session: Session) -> None:
    found = read_parameters(session.folder / "found.toml")
    (log,) = session.document["logs"]
    assert found.logs == {"log.csv": f"sha256:{log['sha256']}"}
    assert found.method.startswith("diagnosis")
    estimates = {estimate.name: estimate for estimate in found.estimates}
    for told in session.document["parameters"]:
        assert estimates[told["name"]].value == told["value"]
        assert estimates[told["name"]].standard_error == told["standard_error"]


def test_the_same_seed_gives_the_same_bytes_whatever_the_jobs(
    session: Session, run: Run, tmp_path: Path
) -> None:
    rig = session.folder / "rig.toml"
    run("diagnose", rig, "--jobs", "1", "--json", tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (session.folder / "d.json").read_bytes()


@pytest.mark.thorough
def test_another_seed_changes_intervals_and_nothing_else(
    session: Session, run: Run, tmp_path: Path
) -> None:
    run("diagnose", session.folder / "rig.toml", "--seed", "7", "--json", tmp_path / "d.json")
    other = json.loads((tmp_path / "d.json").read_text())
    for key in ("verdict", "effects", "ruled_out", "parameters", "warnings"):
        assert other[key] == session.document[key]
    gap, before = other["gap"], session.document["gap"]
    assert gap["after"] == before["after"]
    assert gap["intervals"]["after"] != before["intervals"]["after"]
    assert gap["intervals"]["after"] == pytest.approx(before["intervals"]["after"], rel=0.05)


def test_the_report_is_one_file_that_needs_no_other(session: Session) -> None:
    page = Page((session.folder / "d.html").read_text(encoding="utf-8"))
    page.assert_stands_alone()
    assert any("explains the gap" in text for text in page.text)
    assert session.document["logs"][0]["sha256"] in page.source


def test_text_tells_it_in_one_screen(session: Session) -> None:
    out = session.text
    assert "transport_delay on 'voltage' explains the gap" in out
    for heading in ("Gap, RMS", "Effects", "Parameters", "held out", "Where"):
        assert heading in out
    assert len(out.splitlines()) < 70


@pytest.mark.thorough
def test_a_gap_inside_the_tolerance_is_none(session: Session, run: Run) -> None:
    rig = session.folder / "rig.toml"
    before = session.document["gap"]["before"]
    file = session.folder / "as it was.toml"
    words = ("diagnose", rig, "--format", "json", "--out", file)
    code, out, _ = run(*words, "--tolerance", str(1.01 * before))
    assert code == 0
    document = json.loads(out)
    check_schema(document)
    assert document["verdict"] == "no-gap"
    assert not any(one["taken"] for one in document["effects"])
    nominal = read_description(rig).model.values
    assert read_parameters(file).model().values == pytest.approx(nominal, rel=1e-14, abs=0.0)
    code, out, _ = run("diagnose", rig, "--tolerance", str(0.99 * before), "--format", "github")
    assert code == 1
    assert out.startswith("::error title=servo-models%3A torque_motor::transport_delay")
    assert all(line.startswith("::") for line in out.splitlines())


def test_an_effect_that_the_log_cannot_show_is_said_to_be_so(session: Session) -> None:
    """At three times their typical sizes they stay below the noise that was added."""
    said = {one["name"]: one["reason"] for one in session.document["ruled_out"]}
    nominal = model("torque_motor", "identified", {"transport_delay.time": 0.0})
    (log,) = read_description(session.folder / "rig.toml").logs
    plain = simulate(nominal, log.times, log.inputs)["angle"]
    for name in ("thermal_drift", "load_friction"):
        switches = {
            p.name: 3.0 * p.param.typical
            for p in nominal.plant.parameters.values()
            if p.owner == name and p.param.switch
        }
        with_it = simulate(
            model("torque_motor", "identified", {"transport_delay.time": 0.0, **switches}),
            log.times,
            log.inputs,
        )["angle"]
        assert np.sqrt(np.mean((with_it - plain) ** 2)) < NOISE
        assert said[name].startswith("these logs cannot show it")


def test_what_closes_of_the_only_signal_is_what_closes_of_the_gap(session: Session) -> None:
    by = {one["dimension"]: one["bins"] for one in session.document["localisation"]}
    (signal,) = by["signal"]
    assert signal["closed"] == pytest.approx(session.document["gap"]["closed"], rel=1e-9)
    assert all(one["closed"] is None for one in by.pop("frequency"))
    for one in (it for bins in by.values() for it in bins):
        assert (one["closed"] is None) == (one["rms_before"] <= 1.1)  # the floor, and 10 % of it


@pytest.mark.thorough
def test_a_fit_that_does_not_converge_is_marked_and_the_rest_goes_on(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every search with a backlash ends after a step, far from its tolerance."""

    def hindered(problem: Problem, start: Array, tolerance: float, limit: int, *rest: Any) -> Any:
        stuck = any(free.name.startswith("backlash.") for free in problem.free)
        return descend(problem, start, *((0.0, 1) if stuck else (tolerance, limit)), *rest)

    monkeypatch.setattr(fitting, "descend", hindered)
    code, out, _ = run("diagnose", describe(tmp_path, seconds=0.2), "--format", "json")
    document = json.loads(out)
    assert code == 1
    assert document["verdict"] == "effect"
    assert [one["name"] for one in document["effects"] if one["taken"]] == ["transport_delay"]
    marked = {one["name"] for one in document["effects"] if not one["converged"]}
    jumping = {"stiction"}  # its search ends at its limit of steps
    assert marked - jumping == {"backlash"}
    told = {one["name"]: "did not converge" in one["reason"] for one in document["ruled_out"]}
    assert {name for name, holds in told.items() if holds} - jumping == {"backlash"}
    assert not any("did not converge" in text for text in document["warnings"])


def resting(folder: Path, angle: Callable[[Array], Array], more: str = "") -> Path:
    """A log whose command is 0 V all along, with this reading [deg] over time."""
    path = describe(folder, DESCRIPTION.format(more))
    times = np.arange(0.0, 0.5, 1.0 / RATE)
    noise = 3e-3 * np.random.default_rng(6).standard_normal(len(times))
    rows = np.column_stack([times, np.zeros_like(times), angle(times) + noise])
    np.savetxt(folder / "log.csv", rows, "%.9g", delimiter=",", header="t,u,angle", comments="")
    return path


@pytest.mark.thorough
def test_a_command_that_rests_is_no_obstacle(run: Run, tmp_path: Path) -> None:
    """A release shows a motion; there are no amplitudes to split the error by."""
    started = 'start = { angle = "1 deg", rate = 0 }'
    path = resting(tmp_path, lambda times: np.exp(-times / 0.05), started)
    file = tmp_path / "d.json"
    code, _, _ = run("diagnose", path, "--json", file)
    told = json.loads(file.read_text())
    check_schema(told)
    assert code == 1
    assert "command amplitude" not in [one["dimension"] for one in told["localisation"]]


def frozen(folder: Path) -> Path:
    """A description without uncertainties."""
    text = DESCRIPTION.format("").replace("[uncertainty]", "")
    return describe(folder, text.replace('torque_constant = "5 %"\ninductance = "5 %"\n', ""))


@pytest.mark.thorough
def test_frozen_parameters_are_warned_of(run: Run, tmp_path: Path) -> None:
    code, out, _ = run("diagnose", frozen(tmp_path))
    assert code == 1
    assert "a wrong value looks like an effect" in out


def test_github_is_told_of_no_gap_as_a_notice_and_of_doubts_as_warnings(
    run: Run, tmp_path: Path
) -> None:
    words = ("--tolerance", "1e6", "--format", "github")
    code, out, _ = run("diagnose", frozen(tmp_path), *words)
    notice, *warnings = out.splitlines()
    assert code == 0
    assert notice.startswith("::notice title=servo-models%3A torque_motor::No gap")
    assert any("a wrong value looks like an effect" in text for text in warnings)
    assert all(text.startswith("::warning title=servo-models") for text in warnings)
