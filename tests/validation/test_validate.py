"""The validation: right FMUs pass, wrong ones fail, broken ones are refused in one line."""

from __future__ import annotations

import errno
import json
import math
import re
import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.build import build
from servo_models.catalogue import actuator, actuators, model
from servo_models.core.flat import Chunk
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.report.interchange import conditions
from servo_models.validation.cases import Case, all_cases, grid, schedule
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.implementation import (
    LIMIT,
    implementation_rows,
    input_signals,
    irregular,
)
from servo_models.validation.responses import cost_curve, response_rows
from servo_models.validation.rows import (
    IMPLEMENTATION,
    MODEL,
    PAPER,
    CostCurve,
    Validation,
    judged,
)
from servo_models.validation.runner import validate
from servo_models.validation.sg90 import reference as sg90
from tests.conftest import Run
from tests.support.archives import with_description
from tests.support.own_actuators import WITH_A_FLAG, write

FmuFile = Callable[[str], Path]


def in_process(chosen: Model, times: Array, inputs: Array) -> Array:
    return chosen.run(times, inputs)


def named(case: Case) -> str:
    return f"{case.variant}-{case.name}"


@pytest.mark.parametrize("case", all_cases(), ids=named)
def test_the_model_meets_the_bars(case: Case) -> None:
    chosen = model(case.actuator, case.variant, case.parameters)
    rows = response_rows(case, chosen, in_process)
    assert {row.quantity: row.value for row in rows if not row.passed} == {}


@pytest.mark.parametrize("name", actuators())
def test_every_published_set_has_a_case(name: str) -> None:
    covered = {case.variant for case in all_cases() if case.actuator == name}
    assert {variant.name for variant in actuator(name).variants} <= covered


def case_of(variant: str, name: str) -> Case:
    return next(c for c in all_cases() if c.variant == variant and c.name.startswith(name))


@pytest.mark.parametrize(
    ("parameters", "failing"),
    [
        ({"feedback_coefficient": 0.1001}, "angle: error of the overshoot"),
        ({"transport_delay.time": 0.001}, "angle: error of the delay (50 %)"),
        ({"motor_gain": 484.6}, "angle: largest error"),
    ],
)
def test_a_model_that_is_slightly_wrong_misses_the_bars(
    parameters: dict[str, float], failing: str
) -> None:
    case = case_of("linear_kf018" if "feedback_coefficient" in parameters else "linear", "step")
    rows = response_rows(case, model("sg90", case.variant, parameters), in_process)
    assert failing in {row.quantity for row in rows if row.passed is False}


def test_a_reference_that_is_slightly_wrong_misses_the_bars() -> None:
    case = replace(case_of("printed", "step"), reference=sg90.Printed(k_f=0.1001))
    rows = response_rows(case, model("sg90", "printed"), in_process)
    assert "points outside the tube" in {row.quantity for row in rows if row.passed is False}


def test_a_coarse_internal_step_misses_the_bars() -> None:
    case = case_of("identified", "40 V")
    coarse = model("torque_motor", "identified", {**case.parameters, "internal_step": 4e-4})
    rows = response_rows(case, coarse, in_process)
    assert "angle: largest error" in {row.quantity for row in rows if row.passed is False}


def test_schedules_hold_and_grids_end() -> None:
    times = grid(0.3, 0.1)
    assert len(times) == 4
    assert times[-1] == pytest.approx(0.3)
    assert schedule(times, (0.0, 5.0), (0.2, 7.0)).tolist() == [5.0, 5.0, 7.0, 7.0]


def test_what_is_compared_of_an_fmu_equals_its_simulation(fmu_file: FmuFile) -> None:
    """Of a right one; ``tests/fmu/test_executors.py`` compares every kind of every actuator."""
    subject = Subject(fmu_file("torque_motor"))
    rows = implementation_rows(subject)
    subject.close()
    assert len(rows) == 9
    assert all(row.passed and row.value is not None and row.value <= LIMIT for row in rows)


def test_single_steps_and_whole_rows_of_an_fmu_may_take_turns(fmu_file: FmuFile) -> None:
    """Inputs that were set before the rows are set anew after them."""
    subject = Subject(fmu_file("dc_motor"))
    times = np.linspace(0.0, 0.004, 5)
    inputs = np.zeros((5, len(subject.model.plant.inputs)))
    inputs[[0, 3], 0], inputs[[1, 2], 0] = 5.0, -5.0
    expected = subject.model.run(times, inputs)
    with subject.instance(subject.model.values, 0.0, inputs[0]) as one:
        one.step(times[0], times[1] - times[0], inputs[0])
        rows = one.drive(times[:4], inputs[:4], first=1)
        one.step(times[3], times[4] - times[3], inputs[3])
        last = one.outputs()
    subject.close()
    np.testing.assert_allclose(np.vstack([rows, last]), expected[1:], rtol=1e-9, atol=1e-12)


def test_excitation_moves_every_input_within_its_bounds() -> None:
    chosen = model("sg90")
    columns = input_signals(chosen, irregular(241))
    for column, wire in zip(columns.T, chosen.plant.inputs):
        assert len(np.unique(column)) > 5
        assert wire.low is not None
        assert wire.high is not None
        assert wire.low <= column.min()
        assert column.max() <= wire.high


def with_wrong_slave(chosen: Model) -> Model:
    """A model one of whose equations has a slightly wrong factor."""

    def spoilt(chunk: Chunk) -> Chunk:
        lines = [
            line.replace("resistance * current", "1.0001 * resistance * current")
            for line in chunk.lines
        ]
        return chunk._replace(lines=lines)

    stage = [spoilt(chunk) for chunk in chosen.flat.stage]
    assert stage != chosen.flat.stage
    return replace(chosen, flat=replace(chosen.flat, stage=stage))


@pytest.mark.thorough
def test_an_fmu_with_a_wrong_description_fails(tmp_path: Path, fmu_file: FmuFile) -> None:
    """Initial unknowns are what a stock pythonfmu leaves out and simulation never misses."""
    wrong = with_description(
        fmu_file("torque_motor"),
        tmp_path / "wrong.fmu",
        lambda text: re.sub(rb"(?s)<InitialUnknowns>.*</InitialUnknowns>", b"", text),
    )
    subject = Subject(wrong)
    rows = implementation_rows(subject)
    subject.close()
    assert [row.passed for row in rows] == [False, *(True for _ in rows[1:])]


CURES: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "a rule of FMI": (partial(re.sub, rb'unit="A"', b'unit="Ampere"'), "('Ampere')"),
    "other names": (
        partial(re.sub, rb'name="current"', b'name="amperes"'),
        "has not the variables",
    ),
}


@pytest.mark.parametrize("wrong", CURES)
@pytest.mark.parametrize("ours", [True, False])
def test_only_an_fmu_of_ours_is_to_be_built_again(
    wrong: str, ours: bool, tmp_path: Path, fmu_file: FmuFile, run: Run
) -> None:
    spoil, told = CURES[wrong]
    bad = with_description(
        fmu_file("torque_motor"),
        tmp_path / "any.fmu",
        lambda text: spoil(text if ours else text.replace(b'Tool="servo-models', b'Tool="Other')),
    )
    code, *said = run("validate", bad)
    text = " ".join("".join(said).split())
    assert code in (1, 2), text
    assert told in text
    assert ("build it again" in text) == ours, text


def test_a_file_that_is_no_fmu_names_no_builder(tmp_path: Path, run: Run) -> None:
    with zipfile.ZipFile(tmp_path / "text.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription>")
    (tmp_path / "half.fmu").write_bytes(b"PK\x03\x04 and no more")
    for name in ("half.fmu", "text.fmu"):
        code, _, err = run("validate", tmp_path / name)
        assert (code, "tool that made it" in err, "build it" in err) == (2, True, False), err


@pytest.mark.parametrize("full", ["file", "folder", "everywhere"])
def test_a_full_disk_is_no_fault_of_the_fmu(
    full: str, tmp_path: Path, fmu_file: FmuFile, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    fmu = fmu_file("torque_motor")

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    def nowhere() -> str:
        raise FileNotFoundError(errno.ENOENT, "No usable temporary directory found in ['/tmp']")

    opened = Path.open
    if full == "file":
        writes = {"xb": refuse}

        def instead(path: Path, mode: str = "r", *rest: Any, **more: Any) -> Any:
            return writes.get(mode, opened)(path, mode, *rest, **more)

        monkeypatch.setattr(Path, "open", instead)
    elif full == "folder":
        monkeypatch.setattr("tempfile.mkdtemp", refuse)
    else:
        monkeypatch.setattr("tempfile.gettempdir", nowhere)
        monkeypatch.setattr("tempfile.tempdir", None)
    for words in ((), ("--static-only",)):
        code, _, err = run("validate", fmu, *words)
        assert (code, err.count("\n")) == (2, 1), err
        assert "make room there, or set TMPDIR to a folder on another disk" in err
        assert not re.search("build it|write it again", err)


def test_an_fmu_that_is_too_large_has_one_cure(tmp_path: Path, run: Run) -> None:
    with zipfile.ZipFile(tmp_path / "large.fmu", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/map.bin", bytes(2 << 20))
    code, _, err = run("validate", tmp_path / "large.fmu", "--unpacked", "1")
    assert (code, err.rstrip().endswith("raise it with --unpacked if you trust the file")) == (2, 1)


@pytest.mark.thorough
def test_an_fmu_with_a_wrong_slave_fails(tmp_path: Path) -> None:
    right = model("torque_motor")
    subject = Subject(build(with_wrong_slave(right), tmp_path / "wrong.fmu"))
    implementation = implementation_rows(subject)
    case = case_of("identified", "40 V")
    chosen = model(case.actuator, case.variant, case.parameters)
    responses = response_rows(case, chosen, subject.run, subject.name)
    subject.close()
    assert implementation[0].passed  # its description is that of the right one
    assert {row.passed for row in implementation[1:]} == {False}
    assert "current: largest error" in {row.quantity for row in responses if not row.passed}
    assert {row.subject for row in (*implementation, *responses)} == {"wrong.fmu"}


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("actuator", "variant", "parameters"),
    [
        ("sg90", "linear_kf018", {}),
        ("sg90", "oscillatory_motor", {}),
        ("sg90", "printed", {"feedback_coefficient": 0.123, "backlash.half_width": 0.01}),
        ("torque_motor", "measured", {}),
    ],
)
def test_an_fmu_says_which_model_it_is(
    actuator: str, variant: str, parameters: dict[str, float], tmp_path: Path
) -> None:
    wanted = model(actuator, variant, parameters)
    subject = Subject(build(wanted, tmp_path / "some name.fmu"))
    subject.close()
    assert subject.model.variant == variant
    assert subject.model.values == wanted.values


def test_an_fmu_that_stops_says_why(fmu_file: FmuFile) -> None:
    subject = Subject(fmu_file("torque_motor"))
    inputs = np.array([[0.0, 0.0], [math.nan, 0.0], [0.0, 0.0]])
    with pytest.raises(UserError, match=r"torque_motor.fmu.*t = 0.001 s.*voltage"):
        subject.run(subject.model, 1e-3 * np.arange(3), inputs)
    subject.close()


@pytest.mark.thorough
def test_a_validation_of_a_model_tells_its_progress(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servo_models.validation.sg90.cases._steps", list)
    monkeypatch.setattr("servo_models.validation.responses.FACTORS", (1.0,))
    told: list[tuple[Any, ...]] = []
    result = validate([model("sg90")], lambda *now: told.append(now))
    jobs = told[-1][2]
    assert told[-1] == ("", jobs, jobs)
    assert [done for _, done, _ in told] == list(range(jobs + 1))
    assert all(label.startswith("sg90") for label, _, _ in told[:-1])
    assert {row.claim for row in result.rows} == {IMPLEMENTATION, MODEL, PAPER}
    assert result.passed
    assert all(row.seconds > 0.0 for row in result.rows)
    assert "seconds" not in result.document()["rows"][0]  # the same figures, the same document
    again = json.loads(json.dumps(result.document(), allow_nan=False))
    assert again["passed"] is True
    assert len(again["rows"]) == len(result.rows)
    assert {"numpy", "fmpy", "Python"} <= set(again["conditions"])


def test_rows_are_judged_and_failures_decide() -> None:
    where = ("sg90", "linear", "case")
    good, none = judged(MODEL, where, "q", 1.0, 1.0), judged(MODEL, where, "q", 1.0)
    bad, never = judged(MODEL, where, "q", 1.1, 1.0), judged(MODEL, where, "q", None, 1.0)
    broken = judged(MODEL, where, "q", math.nan, 1.0)
    assert [row.passed for row in (good, none, bad, never, broken)] == [
        True,
        None,
        False,
        False,
        False,
    ]
    assert [row.verdict for row in (good, none, bad)] == ["passed", "for information", "failed"]
    assert Validation((good, none)).passed
    assert Validation((good, bad, broken)).failures == (bad, broken)
    shown = Validation((broken,)).document()["rows"][0]
    assert shown["value"] is None
    assert conditions()["Python"]


def slope(curve: CostCurve, output: str) -> float:
    """Order of convergence over the whole curve."""
    first, last = curve.points[0], curve.points[-1]
    by = math.log(last.internal_step / first.internal_step)
    return math.log(last.error[output] / first.error[output]) / by


def test_cost_curve_shows_the_order_of_the_method() -> None:
    curve = cost_curve(next(c for c in all_cases() if c.actuator == "torque_motor" and c.cost))
    assert curve.default_step in {point.internal_step for point in curve.points}
    assert slope(curve, "angle") == pytest.approx(4.0, abs=0.4)
    assert all(point.seconds > 0.0 for point in curve.points)


@pytest.mark.thorough
def test_an_actuator_of_ones_own_is_validated_with_its_file(tmp_path: Path, run: Run) -> None:
    mine = write(tmp_path, name="mine.py", changes=WITH_A_FLAG)
    params, folder = tmp_path / "P.toml", tmp_path / "fmus"
    params.write_text(
        'actuator = "mine.py"\n[parameters.time_constant]\nvalue = 0.35\nunit = "s"\n'
    )
    code, out, err = run("validate", "--params", params)
    assert (code, err) == (0, "")
    assert "joint" in out
    assert run("build", "--params", params, "--out", folder)[0] == 0
    fmu = folder / "joint.fmu"
    assert run("validate", fmu, "--actuator", mine)[0] == 0
    code, _, err = run("validate", fmu)
    assert code == 2
    assert "unknown actuator 'joint'" in err
    assert "--actuator" in err
    code, _, err = run("validate", "--actuator", mine)
    assert code == 2
    assert "name them as well" in err
