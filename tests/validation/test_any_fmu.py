"""Any FMU against a reference: right ones pass, planted faults are told by name or figure."""

from __future__ import annotations

import json
import re
import shutil
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.fmu.fmu import LIMITS, Limits
from servo_models.validation.any_fmu.comparison import Compared, Trace, allowed, compare
from servo_models.validation.any_fmu.experiment import Against, Experiment
from servo_models.validation.any_fmu.reference_check import ReferenceCheck, check_against
from servo_models.validation.runner import validate
from tests.conftest import Run
from tests.support.archives import with_description
from tests.support.foreign_faults import FAULTS, Fault
from tests.support.foreign_fmus import FOREIGN, Foreign, table

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)
QUICK = {
    *("gain", "delay5", "sign", "degrees", "initial", "drift", "noise", "nan", "refuses"),
    *("stuck", "per_step", "offset"),
}
"""Faults of the lag that the quick tests run."""


def judged(
    one: Foreign, folder: Path, fault: str = "", step: float | None = None
) -> ReferenceCheck:
    inputs, reference, tolerance = one.files(folder)
    against = Against(inputs, reference, tolerance, step=step)
    return check_against(one.write(folder, fault), against, LIMITS)


def notes(result: ReferenceCheck) -> list[str]:
    return [row.note for row in result.rows if row.passed is False and row.note]


@pytest.mark.parametrize("name", FOREIGN)
def test_a_right_fmu_passes(name: str, tmp_path: Path) -> None:
    result = judged(FOREIGN[name], tmp_path)
    assert notes(result) == []
    assert all(row.passed for row in result.rows)


@pytest.mark.thorough
@pytest.mark.parametrize(("finer", "every"), [(5, 1), (1, 4), (1, 25)])
@pytest.mark.parametrize("name", FOREIGN)
def test_points_of_the_reference_may_be_others(
    name: str, finer: int, every: int, tmp_path: Path
) -> None:
    one = FOREIGN[name]
    times = one.step / finer * np.arange(round(one.stop / one.step) * finer + 1)
    fed = {n: np.repeat(curve(one.times), finer)[: len(times)] for n, curve in one.inputs.items()}
    right = one.reference(times, fed)
    chosen = np.unique([*range(0, len(times), every), len(times) - 1])
    inputs, reference, tolerance = one.files(tmp_path)
    table(reference, times[chosen], {n: values[chosen] for n, values in right.items()})
    result = check_against(
        one.write(tmp_path), Against(inputs, reference, tolerance, step=one.step), LIMITS
    )
    assert notes(result) == []
    assert all(row.passed for row in result.rows)


def named(fault: Fault) -> str:
    return f"{fault.fmu}-{fault.fault}"


def test_there_are_enough_faults_of_every_kind() -> None:
    assert len({(one.fmu, one.fault) for one in FAULTS}) == len(FAULTS) >= 40
    assert {one.kind for one in FAULTS} >= {
        *("gain", "delay", "sign", "unit", "event", "initial state", "drift", "swapped", "noise"),
        "communication step",
    }


@pytest.mark.parametrize(
    "planted",
    [
        pytest.param(
            one,
            id=named(one),
            marks=[] if one.fmu == "lag" and one.fault in QUICK else pytest.mark.thorough,
        )
        for one in FAULTS
    ],
)
def test_a_planted_fault_is_told(planted: Fault, tmp_path: Path) -> None:
    told = notes(judged(FOREIGN[planted.fmu], tmp_path, planted.fault))
    assert any(planted.told in note for note in told), told


# The judgement alone


def step_response(times: Array, delay: float = 0.0) -> Array:
    return np.where(times < delay, 0.0, 1.0 - np.exp(-(times - delay) / 0.15))


TIMES = np.linspace(0.0, 1.0, 1001)


def beside(values: Array, right: Array, held: bool = False) -> Compared:
    reference = Trace(TIMES, right, held)
    limits = allowed(reference, 1e-3, exact=held)
    return compare("angle", "rad", reference, Trace(TIMES, values, held), limits, 1e-3)


def test_a_shift_of_5_ms_on_a_step_of_1_s_is_caught() -> None:
    found = beside(step_response(TIMES, 0.005), step_response(TIMES))
    assert found.fault == "output 'angle' is 5 ms late"
    assert beside(step_response(TIMES, 2e-4), step_response(TIMES)).passed


@pytest.mark.parametrize("gain", [0.99, 1.01])
def test_a_gain_error_of_1_percent_is_caught(gain: float) -> None:
    for right in (step_response(TIMES), np.sin(40.0 * TIMES)):
        found = beside(gain * right, right)
        assert f"gain of {gain}" in found.fault
    assert beside(1.001 * step_response(TIMES), step_response(TIMES)).passed


def test_a_missed_event_is_caught() -> None:
    right = np.floor(TIMES * 10.0 + 1e-9)
    got = right - (TIMES > 0.6999)
    found = beside(got, right, held=True)
    assert found.fault == "output 'angle' misses an event, the first at t = 0.7 s"
    pulse = np.where(np.abs(TIMES - 0.5) < 0.0011, 1.0, 0.0)  # of three samples
    assert not beside(np.zeros_like(TIMES), pulse, held=True).passed
    assert not beside(np.zeros_like(TIMES), pulse).passed


def test_an_event_may_come_a_sample_late_but_not_always() -> None:
    right = np.floor(TIMES * 10.0 + 1e-9)
    late = np.concatenate([[0.0], right[:-1]])
    assert "1 ms late" in beside(late, right, held=True).fault
    once = np.where(np.abs(TIMES - 0.5) < 1e-6, right - 1.0, right)
    assert beside(once, right, held=True).passed


def switched(edges: Array, times: Array) -> Array:
    """A Boolean that turns at each of the edges."""
    return np.searchsorted(edges, times, side="right") % 2.0


@given(st.integers(0, 10**6), st.sampled_from([2, 5, 10, 25]), st.booleans(), st.floats(0.0, 1.0))
@settings(max_examples=150)
def test_a_boolean_is_right_up_to_the_coarser_of_row_and_step(
    seed: int, finer: int, of_response: bool, late: float
) -> None:
    """Its pulses between two points of the coarser one are on neither; two rows late is wrong."""
    draw = np.random.default_rng(seed)
    coarse = 0.01
    row, step = (coarse, coarse / finer) if of_response else (coarse / finer, coarse)
    rows, steps = (each * np.arange(round(2.0 / each) + 1) for each in (row, step))

    def judged_at(edges: Array, delay: float) -> bool:
        reference = Trace(rows, switched(edges, rows), held=True)
        response = Trace(steps, switched(edges + delay, steps), held=True)
        limits = allowed(reference, step, exact=True)
        return compare("on", "1", reference, response, limits, step).passed

    short = np.sort(draw.uniform(0.0, 2.0, draw.integers(1, 40)))
    assert judged_at(short, 0.0)
    apart = np.arange(0.1, 1.9, 0.1) + draw.uniform(0.0, 0.05, 18)
    edges = apart[: draw.integers(1, 19)]
    assert judged_at(edges, late * row)
    assert not judged_at(edges, 2.1 * coarse + row)


@given(st.integers(0, 10**6), st.booleans(), st.integers(1, 400))
@settings(max_examples=60)
def test_a_curve_equals_itself(seed: int, held: bool, smooth: int) -> None:
    """Also one whose steps are just about steps."""
    draw = np.random.default_rng(seed)
    steps = draw.standard_normal(1001) * (draw.random(1001) < 1.0 / smooth)
    drift = draw.random() * np.sin(draw.uniform(1.0, 300.0) * TIMES)
    right = np.cumsum(steps) + drift
    found = beside(right, right.copy(), held)
    assert found.passed
    assert all(figure.passed for figure in found.figures)


def test_tolerances_that_are_asked_for_are_kept() -> None:
    right = step_response(TIMES)
    reference, response = Trace(TIMES, right), Trace(TIMES, right + 0.01)
    for atol, passes in ((0.011, True), (0.009, False)):
        limits = allowed(reference, 1e-3, atol=atol)
        assert compare("y", "1", reference, response, limits, 1e-3).passed == passes
    shifted = Trace(TIMES, step_response(TIMES, 0.005))
    for time, passes in ((0.0055, True), (0.0045, False)):
        limits = allowed(reference, 1e-3, time=time)
        assert compare("y", "1", reference, shifted, limits, 1e-3).passed == passes


# What is refused

LAG = FOREIGN["lag"]


@pytest.fixture
def ground(tmp_path: Path) -> Path:
    LAG.files(tmp_path)
    LAG.write(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("reference", "told"),
    [
        ("time,y\n", "has no rows of numbers"),
        ("time,y\n0,0\n", "has 1 row(s), no run"),
        ("time,y\n0,0\n1,nan\n", "row 3, column 'y': 'nan' is not finite"),
        ("time,y\n0,0\n1,\n", "row 3, column 'y' is empty"),
        ("time\n0\n1\n", "no column beside time"),
        ("time,u\n0,0\n1,1\n", "has no column for an output of the FMU: y"),
        ("time,yy\n0,0\n1,1\n", "has no variable 'yy'; did you mean 'y'?"),
        ("time,y [m]\n0,0\n1,1\n", "unit 'm' does not convert to 'rad'"),
        ("y,time\n0,0\n1,1\n", "the first column is 'y'; name it 'time'"),
        ("time,y\n0,0\n1,1\n0.5,1\n", "time runs backward"),
        ("time,y,y\n0,0,0\n1,1,1\n", "has two columns 'y'"),
        ("time,y\n0,0\n5e-324,1\n1,1\n", "row 3, column 'time': time moves from 0.0 s to 5e-324 s"),
        ("time,y\n-1.7e308,0\n1.7e308,1\n", "as no clock does; correct one of the two rows"),
    ],
)
def test_a_reference_that_says_nothing_is_refused(ground: Path, reference: str, told: str) -> None:
    (ground / "bad.csv").write_text(reference)
    with pytest.raises(UserError) as refused:
        check_against(ground / "lag.fmu", Against(ground / "in.csv", ground / "bad.csv"), LIMITS)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("tolerance", "told"),
    [
        ("rtl = 0.1", "unknown key 'rtl'; did you mean 'rtol'?"),
        ("rtol = -0.1", "-0.1 is no tolerance; write a number from 0 on"),
        ("time = '2 mm'", "unit 'mm' does not convert to 's'"),
        ("[outputs.z]\nrtol = 0.1", "unknown output 'z'"),
        ("[outputs.y]\natol = '1 m'", "unit 'm' does not convert to 'rad'"),
        ("[outputs.y]\natol = true", "write for example"),
        ("atol = '1 deg'", "a unit for all outputs"),
        ("start = { gian = 1.0 }", "did you mean 'gain'?"),
        ("start = { gain = 'a' }", "no value of a variable of type Real"),
    ],
)
def test_a_wrong_tolerance_is_refused_with_the_cure(
    ground: Path, tolerance: str, told: str
) -> None:
    (ground / "tol.toml").write_text(tolerance)
    against = Against(ground / "in.csv", ground / "ref.csv", ground / "tol.toml")
    with pytest.raises(UserError) as refused:
        check_against(ground / "lag.fmu", against, LIMITS)
    assert told in str(refused.value)
    assert "tol.toml" in str(refused.value) or "start.gain" in str(refused.value)


def test_tolerances_by_output_have_units(ground: Path) -> None:
    fmu = LAG.write(ground, "offset")  # 0.01 rad is 0.573 deg
    for degrees, passes in ((0.58, True), (0.56, False)):
        (ground / "tol.toml").write_text(f"[outputs.y]\natol = '{degrees} deg'\n")
        against = Against(ground / "in.csv", ground / "ref.csv", ground / "tol.toml")
        assert all(row.passed for row in check_against(fmu, against, LIMITS).rows) == passes


def test_units_of_columns_are_converted(ground: Path) -> None:
    right = LAG.reference(LAG.times, {"u": np.ones_like(LAG.times)})["y"]
    table(ground / "deg.csv", 1e3 * LAG.times, {"y [deg]": np.degrees(right)})
    text = (ground / "deg.csv").read_text().replace("time,", "time [ms],")
    (ground / "deg.csv").write_text(text)
    result = check_against(
        ground / "lag.fmu", Against(ground / "in.csv", ground / "deg.csv"), LIMITS
    )
    assert all(row.passed for row in result.rows)


def test_elements_of_arrays_have_their_names(tmp_path: Path) -> None:
    """In the reference, the inputs, the tolerances and with a unit."""
    one = FOREIGN["lag"]
    names = {"u": "motor.u[2,1]", "y": "a[1,2]"}
    renamed = [replace(v, name=names.get(v.name, v.name)) for v in one.variables]
    fmu = replace(one, variables=tuple(renamed)).write(tmp_path)
    fed = np.ones_like(one.times)
    right = one.reference(one.times, {"u": fed})["y"] + 0.01
    inputs = table(tmp_path / "in.csv", one.times, {'"motor.u[2,1]"': fed})
    reference = table(tmp_path / "ref.csv", one.times, {'"a[1,2] [deg]"': np.degrees(right)})
    for limit, passes in ((0.011, True), (0.009, False)):
        (tmp_path / "tol.toml").write_text(f'[outputs."a[1,2]"]\natol = {limit}\n')
        result = check_against(fmu, Against(inputs, reference, tmp_path / "tol.toml"), LIMITS)
        assert all(row.passed for row in result.rows) == passes


def test_outputs_without_a_column_are_named(tmp_path: Path) -> None:
    one = FOREIGN["motor"]
    inputs, reference, _ = one.files(tmp_path)
    right = one.reference(one.times, {"u": np.ones_like(one.times)})
    table(reference, one.times, {"angle": right["angle"]})
    result = check_against(one.write(tmp_path), Against(inputs, reference), LIMITS)
    assert [row.case for row in result.rows if row.passed is None] == ["speed", "current"]


def test_a_step_that_an_fmu_cannot_take_is_refused(tmp_path: Path) -> None:
    one = FOREIGN["lag of fixed steps"]
    inputs, reference, _ = one.files(tmp_path)
    with pytest.raises(UserError, match=r"no whole number of steps of 0\.4 s"):
        check_against(one.write(tmp_path), Against(inputs, reference, step=0.4), LIMITS)
    uneven = np.array([0.0, 0.1, 0.15, 1.5])
    table(reference, uneven, {"y": np.zeros(4)})
    with pytest.raises(UserError, match="takes steps of one size"):
        check_against(one.write(tmp_path), Against(None, reference), LIMITS)


def test_times_may_be_rounded(tmp_path: Path) -> None:
    """A step of 1/300 s in six decimals, and an FMU that takes steps of one size."""
    one = replace(FOREIGN["lag of fixed steps"], step=1.0 / 300.0)
    inputs, reference, _ = one.files(tmp_path)
    assert inputs
    for path in (inputs, reference):
        header, *rows = path.read_text().splitlines()
        cells = (row.split(",", 1) for row in rows)
        lines = [f"{float(time):.6f},{rest}" for time, rest in cells]
        path.write_text("\n".join([header, *lines]))
    result = check_against(one.write(tmp_path), Against(inputs, reference), LIMITS)
    assert all(row.passed for row in result.rows)


@pytest.mark.parametrize(
    ("step", "times"),
    [(0.5, [2.0, 2.5, 3.0, 3.5, 4.0]), (0.8, [2.0, 2.8, 3.6, 4.0])],
)
def test_a_run_is_stepped_from_its_own_start_to_its_end(step: float, times: list[float]) -> None:
    run = Experiment("ref.csv", {"y": Trace(np.array([2.0, 4.0]), np.zeros(2))}, step=step)
    np.testing.assert_allclose(run.times(any_step=True), times)


def test_inputs_have_to_reach_the_start(ground: Path) -> None:
    table(ground / "late.csv", np.array([0.5, 1.0]), {"u": np.ones(2)})
    with pytest.raises(UserError, match=r"input 'u' begins at 0\.5 s, the run at 0 s"):
        check_against(ground / "lag.fmu", Against(ground / "late.csv", ground / "ref.csv"), LIMITS)


def test_held_inputs_keep_their_value(ground: Path) -> None:
    """Two rows are a ramp to FMI; held, they are a step."""
    table(ground / "in.csv", np.array([0.0, 1.0]), {"u": np.array([1.0, 5.0])})
    (ground / "tol.toml").write_text("hold = true\n")
    ramp = check_against(ground / "lag.fmu", Against(ground / "in.csv", ground / "ref.csv"), LIMITS)
    assert notes(ramp)
    against = Against(ground / "in.csv", ground / "ref.csv", ground / "tol.toml")
    assert not notes(check_against(ground / "lag.fmu", against, LIMITS))


# Other layouts


def test_a_cross_check_is_written_and_read(ground: Path) -> None:
    fmu, folder = ground / "lag.fmu", ground / "cross"
    files = Against(ground / "in.csv", ground / "ref.csv", write_cross_check=folder)
    first = check_against(fmu, files, LIMITS)
    assert {path.name for path in folder.iterdir()} == {
        *("lag_in.csv", "lag_out.csv", "lag_ref.csv", "lag_ref.opt"),
    }
    options = (folder / "lag_ref.opt").read_text().split()
    assert options == ["StartTime,0.0", "StopTime,1.0", "StepSize,0.001", "RelTol,0.0001"]
    again = check_against(fmu, Against(cross_check=folder), LIMITS)
    assert [row.value for row in again.rows] == [row.value for row in first.rows]


def test_a_cross_check_has_to_reach_its_stop_time(ground: Path) -> None:
    folder = ground / "cross"
    files = Against(ground / "in.csv", ground / "ref.csv", write_cross_check=folder)
    check_against(ground / "lag.fmu", files, LIMITS)
    options = folder / "lag_ref.opt"
    options.write_text(options.read_text().replace("StopTime,1.0", "StopTime,2.0"))
    with pytest.raises(UserError, match="give a reference of the whole run"):
        check_against(ground / "lag.fmu", Against(cross_check=folder), LIMITS)
    options.write_text("StopTime,soon\n")
    with pytest.raises(UserError, match="row 1: 'soon' is no number"):
        check_against(ground / "lag.fmu", Against(cross_check=folder), LIMITS)


OWN = "extra/org.fmi-standard.fmi-ls-ref"
EXPERIMENT = (
    '<Experiment name="step" startTime="0" stopTime="1" stepSize="0.001">'
    '<Parameters source="parameters.ssv"/><Stimuli source="in.csv"/>'
    '<References source="../ref.csv"/></Experiment>'
)
PARAMETERS = (
    '<p:ParameterSet xmlns:p="http://ssp-standard.org/SSP1/SystemStructureParameterValues"'
    ' version="1.0" name="fast"><p:Parameters><p:Parameter name="tau">'
    '<p:Real value="100" unit="ms"/></p:Parameter></p:Parameters></p:ParameterSet>'
)


def with_its_own(ground: Path, manifest: str, fault: str = "") -> Path:
    path = LAG.write(ground, fault)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(f"{OWN}/fmi-ls-manifest.xml", f"<fmiReferences>{manifest}</fmiReferences>")
        archive.writestr(f"{OWN}/tests.xml", f"<Experiments>{EXPERIMENT}</Experiments>")
        archive.writestr(f"{OWN}/parameters.ssv", PARAMETERS)
        archive.write(ground / "in.csv", f"{OWN}/in.csv")
        archive.write(ground / "ref.csv", "extra/ref.csv")
    return path


@pytest.mark.parametrize(
    "manifest", [EXPERIMENT, '<Related source="tests.xml" role="experiment/smoke-test"/>']
)
def test_the_reference_that_an_fmu_carries_is_used(ground: Path, manifest: str) -> None:
    right = validate([with_its_own(ground, manifest)])
    assert right.passed
    assert {row.variant for row in right.rows} == {"experiment 'step' of the FMU"}
    wrong = validate([with_its_own(ground, manifest, "delay5")])
    assert "output 'y' is 5 ms late" in [row.note for row in wrong.failures]


@pytest.mark.parametrize(
    ("manifest", "told"),
    [
        (EXPERIMENT.replace("../ref.csv", "../../../../ref.csv"), "a file '../../../../ref.csv'"),
        (EXPERIMENT.replace('ref.csv"', 'ref.csv" type="application/hdf5"'), "CSV is read"),
        ("", "names no experiment with references"),
        (EXPERIMENT.replace('stopTime="1"', 'stopTime="soon"'), "could not convert"),
        (EXPERIMENT.replace("parameters.ssv", "in.csv"), "is no XML"),
        (
            "<Experiment>",
            "lag.fmu': extra/org.fmi-standard.fmi-ls-ref cannot be read (fmi-ls-manifest.xml is no"
            " XML: mismatched tag: line 1, column 29): give a reference with --reference ref.csv",
        ),
    ],
)
def test_a_reference_of_its_own_that_is_none_is_refused(
    ground: Path, manifest: str, told: str
) -> None:
    with pytest.raises(UserError) as refused:
        validate([with_its_own(ground, manifest)])
    assert told in str(refused.value)


def test_an_fmu_without_reference_is_refused_with_the_cure(ground: Path, run: Run) -> None:
    code, out, err = run("validate", ground / "lag.fmu")
    assert (code, out) == (2, "")
    assert "--reference ref.csv, or --static-only" in err


def test_an_fmu_for_model_exchange_alone_is_refused(ground: Path) -> None:
    def exchange(content: bytes) -> bytes:
        return re.sub(rb"<CoSimulation [^>]*>", b'<ModelExchange modelIdentifier="lag"/>', content)

    fmu = with_description(ground / "lag.fmu", ground / "exchange.fmu", exchange)
    with pytest.raises(UserError, match="names no library for co-simulation"):
        check_against(fmu, Against(ground / "in.csv", ground / "ref.csv"), LIMITS)


# The command


@pytest.mark.thorough
@pytest.mark.parametrize(("fault", "code"), [("", 0), ("delay5", 1)])
def test_the_command_tells_all_readers(fault: str, code: int, ground: Path, run: Run) -> None:
    fmu = LAG.write(ground, fault)
    words = ("--inputs", ground / "in.csv", "--reference", ground / "ref.csv", "--format", "github")
    files = {name: ground / name for name in ("junit.xml", "report.html", "summary.md")}
    files["summary.md"].write_text("before\n")
    options = [word for name, path in files.items() for word in (f"--{name.split('.')[0]}", path)]
    got, out, err = run("validate", fmu, *words, *options)
    assert (got, err) == (code, "")
    errors = [line for line in out.splitlines() if line.startswith("::error")]
    assert len(errors) == code
    summary = files["summary.md"].read_text()
    page = files["report.html"].read_text()
    junit = ElementTree.parse(files["junit.xml"]).getroot()
    assert summary.startswith("before\n## ")
    assert page.count("<svg") == 1
    assert [suite.get("name") for suite in junit] == ["reference"]
    for text in (errors[0] if errors else "", summary, page):
        assert ("5 ms late" in text) == bool(code)
    assert (junit[0].get("failures") != "0") == bool(code)


def test_json_is_whole(ground: Path, run: Run) -> None:
    fmu = LAG.write(ground, "nan")
    words = ("--reference", ground / "ref.csv", "--inputs", ground / "in.csv", "--format", "json")
    code, out, _ = run("validate", fmu, *words)
    assert code == 1
    document = json.loads(out, parse_constant=pytest.fail)
    assert document["passed"] is False
    assert {row["claim"] for row in document["rows"]} == {"reference"}


def test_limits_are_kept(ground: Path) -> None:
    """An FMU that steps for ever is ended, and told once."""
    against = Against(ground / "in.csv", ground / "ref.csv", step=1e-6)
    rows = check_against(ground / "lag.fmu", against, Limits(seconds=0.05)).rows
    assert ["does not answer within 0.05 s" in row.note for row in rows] == [True]


@pytest.mark.long
def test_an_fmu_of_ours_is_compared_as_well(tmp_path: Path, fmu_file: object, run: Run) -> None:
    assert callable(fmu_file)
    step = ("--step", "voltage=1V", "--stop", "0.5", "--out", tmp_path / "ref.csv")
    assert run("simulate", "torque_motor", *step)[0] == 0
    text = (tmp_path / "ref.csv").read_text()
    result = validate(
        [fmu_file("torque_motor")], against=Against(tmp_path / "ref.csv", tmp_path / "ref.csv")
    )
    assert {"implementation", "reference"} <= {row.claim for row in result.rows}, text[:80]
    assert result.passed, result.failures
