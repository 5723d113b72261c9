"""Logs without a file: what is measured in memory is what a file of it says."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import servo_models as sm
from servo_models.errors import UserError
from tests.support.document import ROOT

EXAMPLE = ROOT / "examples" / "two_csv_files"
COLUMNS = {
    "time": ("time_ms", "ms"),
    "pulse_width": ("pulse_us", "us"),
    "angle": {"column": "angle_deg", "unit": "deg"},
}
FREE = (
    "motor_time_constant",
    "motor_gain",
    "amplifier_gain",
    "potentiometer_gain",
    "transport_delay.time",
)


def frame(name: str) -> pl.DataFrame:
    return pl.read_csv(EXAMPLE / f"{name}.csv")


def described(
    table: Callable[[pl.DataFrame], Any] = lambda frame: frame, **options: Any
) -> sm.Description:
    options = {"free": FREE, "each": {"flight": {"held_out": True}}} | options
    logs = {name: table(frame(name)) for name in ("steps", "flight")}
    return sm.describe(sm.model("sg90", "measured"), logs, COLUMNS, **options)


def arrays(table: pl.DataFrame) -> dict[str, np.ndarray[Any, Any]]:
    return {name: table[name].to_numpy() for name in table.columns}


def pandas(table: pl.DataFrame) -> Any:
    return pytest.importorskip("pandas").DataFrame(arrays(table))


@pytest.mark.parametrize("table", [lambda frame: frame, arrays, pandas])
def test_a_table_is_read_as_its_file(table: Callable[[pl.DataFrame], Any]) -> None:
    own, other = described(table), sm.read_description(EXAMPLE / "description.toml")
    assert own.free == other.free
    assert own.uncertainty == other.uncertainty
    assert own.model.values == other.model.values
    for log, same in zip(own.logs, other.logs, strict=True):
        assert log.name == same.name
        np.testing.assert_array_equal(log.times, same.times)
        np.testing.assert_array_equal(log.inputs["pulse_width"], same.inputs["pulse_width"])
        np.testing.assert_array_equal(log.outputs["angle"], same.outputs["angle"])
        np.testing.assert_array_equal(log.held_out, same.held_out)
        assert (log.settle, log.begin) == (same.settle, same.begin)
    assert own.logs[0].sha256 != own.logs[1].sha256


def test_an_identification_is_that_of_the_file() -> None:
    found = sm.identify(described(free=["motor_gain"])).result
    other = sm.identify(EXAMPLE / "description.toml", free=["motor_gain"]).result
    assert found.values == other.values
    assert found.standard_errors == other.standard_errors


def test_a_diagnosis_is_that_of_the_file(tmp_path: Path) -> None:
    """No effect is left to try, so that it ends soon."""
    chosen = sm.model("torque_motor", "measured")
    times = np.arange(0.0, 0.4, 1e-3)
    command = np.where(times < 0.05, 0.0, np.where(times < 0.2, 10.0, -10.0))
    angle = 1.05 * sm.simulate(chosen, times, {"voltage": command})["angle"]
    noise = 1e-5 * np.random.default_rng(3).standard_normal(len(times))
    log = {"t": times, "u": command, "angle": angle + noise}
    pl.DataFrame(log).write_csv(tmp_path / "log.csv")
    (tmp_path / "log.toml").write_text(
        'actuator = "torque_motor"\nvariant = "measured"\n'
        'uncertainty = { torque_constant = "10 %" }\n'
        '[[logs]]\nfile = "log.csv"\ntime = "t"\n'
        'inputs.voltage = "u"\noutputs.angle = "angle"\n'
    )
    own = sm.describe(
        chosen,
        {"log": log},
        {"time": "t", "voltage": "u", "angle": "angle"},
        uncertainty={"torque_constant": "10 %"},
    )
    none = tuple(chosen.plant.placements)
    found, other = (sm.diagnose(it, left_out=none) for it in (own, tmp_path / "log.toml"))
    assert found.verdict.kind == other.verdict.kind
    assert found.gap == other.gap
    assert found.moved == other.moved


def test_one_log_may_state_more_than_the_others() -> None:
    chosen = sm.model("torque_motor", "measured")
    times = np.arange(0.0, 1.0, 1e-2)
    log = {"t": times, "u": np.sin(times), "angle": times}
    found = sm.describe(
        chosen,
        {"bare": log, "loaded": log},
        {"time": "t", "voltage": {"column": "u", "sign": -1}, "angle": ("angle", "deg")},
        each={"loaded": {"constants": {"load_torque": "5 mN.m"}, "window": (0.2, np.float64(0.8))}},
        bounds={"inductance": (25.0, "40 H")},
    )
    bare, loaded = found.logs
    np.testing.assert_array_equal(bare.inputs["voltage"], -np.sin(times))
    assert bare.constants == {}
    assert loaded.constants == {"load_torque": 5e-3}
    assert loaded.begin == pytest.approx(0.2)
    assert loaded.duration == pytest.approx(0.6)
    assert found.bounds == {"inductance": (25.0, 40.0)}


def complaint(table: Any = None, columns: Any = None, **options: Any) -> str:
    times = np.arange(0.0, 1.0, 1e-2)
    log = {"t": times, "u": np.sin(times), "angle": times} | (table or {})
    chosen = {"time": "t", "voltage": "u", "angle": "angle"} | (columns or {})
    with pytest.raises(UserError) as caught:
        sm.describe("torque_motor", {"bare": log}, chosen, **options)
    return str(caught.value)


def test_faults_name_log_row_and_column() -> None:
    rows = np.arange(0.0, 1.0, 1e-2)
    gap = np.where(rows == rows[7], np.nan, rows)
    assert "'bare', row 7, column 'angle'" in complaint({"angle": gap})
    assert "'bare' has no column 'angel'; did you mean 'angle'" in complaint(
        columns={"angle": "angel"}
    )
    assert "unknown signal 'angel' in columns; did you mean 'angle'" in complaint(
        columns={"angel": "angle"}
    )
    assert "columns, 'angle': give a header and a unit" in complaint(columns={"angle": ("a",)})
    assert "column 'angle' has shape (100, 1)" in complaint({"angle": rows[:, None]})
    assert "'bare', column 'u' has 99 rows, the time 100" in complaint({"u": rows[:99]})
    assert "'torque_motor', logs[1].outputs.angle.unit" in complaint(
        columns={"angle": ("angle", "V")}
    )
    assert "unknown log 'bear' in each; did you mean 'bare'" in complaint(each={"bear": {}})
    assert "'torque_motor', logs[1].held: unknown key 'held'" in complaint(
        each={"bare": {"held": True}}
    )
    assert "'torque_motor', uncertainty.inertai: unknown parameter" in complaint(
        uncertainty={"inertai": 1.0}
    )


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"each": {"bare": 3}}, "each, 'bare': give a mapping of keys to values, {'bench': {"),
        ({"each": {"bare": None}}, "and not of type NoneType"),
        ({"each": {"bare": "held_out"}}, "each, 'bare': give a mapping"),
        ({"each": ["bare"]}, "each: give a mapping of logs to their keys, {'bench': {'held_out'"),
        ({"uncertainty": np.ones(2)}, "'torque_motor', uncertainty: no table"),
        ({"bounds": np.ones(2)}, "'torque_motor', bounds: no table"),
        ({"each": {"bare": {3: 4}}}, "logs[1].3: unknown key '3'"),
        (
            {"each": {"bare": {"start": np.array([1.0, 2.0])}}},
            "logs[1].start: no text; write for ex",
        ),
        ({"each": {"bare": {"held_out": np.zeros(100, bool)}}}, "logs[1].held_out"),
        ({"each": {"bare": {"start": {"angle": np.zeros(2)}}}}, "logs[1].start.angle: no number"),
    ],
)
def test_what_is_of_another_type_is_refused_by_name(given: Any, said: str) -> None:
    assert said in complaint(**given)


def test_columns_are_a_mapping() -> None:
    with pytest.raises(UserError, match="columns: give a mapping of names to headers"):
        sm.describe("sg90", {"bench": arrays(frame("steps"))}, ["t", "angle"])  # type: ignore[arg-type]


def test_arrays_are_lists_and_numbers_in_what_is_said_of_a_log() -> None:
    each = {"steps": {"window": np.array([0.2, 0.8]), "start": np.array("rest"), "settle": None}}
    log = described(each=each).logs[0]
    assert log.begin == pytest.approx(0.2, abs=0.05)
    assert log.settle == 0.0


def test_keys_of_the_table_are_no_further_keys_of_a_log() -> None:
    """They were dropped without a word: a log of the other sign was read as the others."""
    other = {"steps": {"outputs": {"angle": {"column": "angle_deg", "unit": "deg", "sign": -1}}}}
    with pytest.raises(UserError, match=r"each, 'steps': 'outputs' is of the table"):
        described(each=other)


def test_what_is_masked_was_not_measured() -> None:
    log = arrays(frame("steps"))
    log["angle_deg"] = np.ma.masked_equal(
        np.where(np.arange(480) == 7, 0.25, log["angle_deg"]), 0.25
    )
    with pytest.raises(UserError, match="row 7"):
        sm.describe("sg90", {"bench": log}, COLUMNS)


def test_a_header_that_is_a_number_is_no_position() -> None:
    log = arrays(frame("steps"))
    numbered = {0: log["time_ms"], 1: log["pulse_us"], 2: log["angle_deg"]}
    columns = {"time": (0, "ms"), "pulse_width": (1, "us"), "angle": (2, "deg")}
    same, own = (
        sm.describe("sg90", {"bench": log}, COLUMNS),
        sm.describe("sg90", {0: numbered}, columns),
    )
    np.testing.assert_array_equal(own.logs[0].outputs["angle"], same.logs[0].outputs["angle"])
    np.testing.assert_array_equal(
        own.logs[0].inputs["pulse_width"], same.logs[0].inputs["pulse_width"]
    )


@pytest.mark.parametrize("logs", [[{}], {"t": np.zeros(3)}, {"bench": "log.csv"}, {"bench": None}])
def test_what_is_no_table_is_refused_in_one_sentence(logs: Any) -> None:
    with pytest.raises(UserError, match="give a"):
        sm.describe("sg90", logs, COLUMNS)


def test_an_actuator_is_a_name_or_a_model() -> None:
    with pytest.raises(UserError, match="no name and no model"):
        sm.describe(sm.actuator("sg90"), {"bench": arrays(frame("steps"))}, COLUMNS)  # type: ignore[arg-type]


def test_tables_of_all_logs_are_handed_out() -> None:
    tables = sm.check(described()).tables()
    readings = [frame for title, frame in tables.items() if "Readings" in title]
    floors = sorted(
        round(float(frame[name][0]), 2)
        for frame in readings
        for name in frame.columns
        if "noise floor" in name
    )
    assert floors == [0.25, 0.29]


def test_what_a_diagnosis_cannot_take_is_refused() -> None:
    with pytest.raises(UserError, match="unknown effect 'backlsh'"):
        sm.diagnose(described(), left_out="backlsh")
    for tolerance in (np.nan, -1.0):
        with pytest.raises(UserError, match="number of noise floors"):
            sm.diagnose(described(), tolerance=tolerance)


def test_what_a_notebook_shows_is_one_line() -> None:
    shown = repr(described())
    assert shown == "<Description of sg90, variant measured: logs 'steps', 'flight'>"
    changed = sm.model("sg90", "measured", {"backlash.half_width": "0.5 deg"})
    assert repr(changed) == "<Model of sg90, variant measured: 1 values changed>"
