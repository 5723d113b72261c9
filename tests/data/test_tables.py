"""Tables of signals: the same numbers back, and every fault named where it is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuator, model
from servo_models.data.tables import read_inputs, read_signals, write_signals
from servo_models.errors import UserError

SERVO = actuator("sg90").plant
MOTOR = actuator("torque_motor").plant
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


def table(folder: Path, content: str | bytes, name: str = "in.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def complaint(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        read_inputs(path, MOTOR)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@settings(deadline=None, max_examples=60)
@given(rows=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=20))
def test_what_is_written_is_read_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, rows: list[tuple[float, float, float]]
) -> None:
    path = tmp_path_factory.getbasetemp() / f"round{suffix}"
    columns = np.array(rows)
    times = np.sort(columns[:, 0])
    signals = {"voltage": columns[:, 1], "angle": columns[:, 2]}
    write_signals(path, times, signals, MOTOR.wire)
    back_times, back = read_signals(path, list(MOTOR.wire.values()))
    assert np.array_equal(back_times, times)
    assert {name: list(values) for name, values in back.items()} == {
        name: list(values) for name, values in signals.items()
    }


def test_a_simulation_fed_with_its_own_table_repeats_itself(tmp_path: Path) -> None:
    chosen = model("torque_motor")
    times = np.linspace(0.0, 0.05, 41)
    first = simulate(chosen, times, {"voltage": 20.0 * np.sin(300.0 * times)})
    path = tmp_path / "run.csv"
    write_signals(path, times, {**first.inputs, **first.outputs}, chosen.plant.wire)
    second = simulate(chosen, *read_inputs(path, chosen.plant))
    for name, values in first.outputs.items():
        assert np.array_equal(second[name], values), name


def test_units_in_headers_are_converted(tmp_path: Path) -> None:
    content = "time [ms],pulse_width [us],load_torque [mN.m]\n0,1500,0\n20,2000,5\n"
    times, inputs = read_inputs(table(tmp_path, content), SERVO)
    assert times == pytest.approx([0.0, 0.02], rel=1e-14)
    assert inputs["pulse_width"] == pytest.approx([1.5e-3, 2.0e-3], rel=1e-14)
    assert inputs["load_torque"] == pytest.approx([0.0, 5e-3], rel=1e-14)


def test_written_headers_carry_their_units(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    signals = {"angle": np.zeros(1), "current": np.zeros(1), "at_stop": np.zeros(1)}
    write_signals(path, np.zeros(1), signals, MOTOR.wire)
    assert path.read_text().splitlines()[0] == "time [s],angle [rad],current [A],at_stop"


@pytest.mark.parametrize(
    "content",
    [
        b"time,voltage\n0,1\n1,2",
        b"time,voltage\r\n0,1\r\n1,2\r\n",
        b"\xef\xbb\xbftime,voltage\n0,1\n1,2\n\n",
        b'"time", "voltage"\n0,"1"\n 1 , 2.0e0 \n',
    ],
)
def test_the_dialects_of_editors(tmp_path: Path, content: bytes) -> None:
    times, inputs = read_inputs(table(tmp_path, content), MOTOR)
    assert list(times) == [0.0, 1.0]
    assert list(inputs["voltage"]) == [1.0, 2.0]


def json_table(folder: Path) -> Path:
    rows = [{"time": 0, "pulse_width [us]": 1500}, {"time": 1.5, "pulse_width [us]": 2000.5}]
    return table(folder, json.dumps(rows), "in.json")


def mat_table(folder: Path) -> Path:
    savemat(folder / "in.mat", {"time": [0.0, 1.5], "pulse_width": [1.5e-3, 2.0005e-3]})
    return folder / "in.mat"


def parquet_table(folder: Path) -> Path:
    frame = pl.DataFrame({"time": [0.0, 1.5], "pulse_width [us]": [1500.0, 2000.5]})
    frame.write_parquet(folder / "in.parquet")
    return folder / "in.parquet"


@pytest.mark.parametrize(
    "write",
    [
        lambda folder: table(folder, "time;pulse_width [us]\n0;1500\n1,5;2000,5\n"),
        lambda folder: table(folder, "time\tpulse_width [us]\n0\t1500\n1,5\t2000,5\n", "in.tsv"),
        lambda folder: table(folder, "# a rig\ntime; pulse_width [us]\n0;1500\n1.5;2000.5\n"),
        json_table,
        mat_table,
        parquet_table,
    ],
)
def test_inputs_are_read_from_whatever_logs_are_read_from(
    write: Callable[[Path], Path], tmp_path: Path
) -> None:
    times, inputs = read_inputs(write(tmp_path), SERVO)
    assert list(times) == [0.0, 1.5]
    assert inputs["pulse_width"] == pytest.approx([1.5e-3, 2.0005e-3], rel=1e-14)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", ["empty"]),
        ("\n\n", ["empty"]),
        ("time,voltage\n", ["no rows"]),
        ("voltage\n1\n", ["no column 'time'"]),
        ("time\n0\n", ["no column for an input", "voltage", "load_torque"]),
        ("time,angle\n0,0\n", ["no column for an input"]),
        ("time,voltag\n0,1\n", ["'voltag'", "did you mean 'voltage'"]),
        ("time,time,voltage\n0,0,1\n", ["two columns 'time'"]),
        ("time [s],time [ms],voltage\n0,0,1\n", ["two columns 'time'"]),
        ("time,voltage [A]\n0,1\n", ["column 'voltage'", "'A' does not convert to 'V'"]),
        ("time,voltage [volks]\n0,1\n", ["column 'voltage'", "unknown unit 'volks'"]),
        ("time,voltage [V\n0,1\n", ["write it as 'name' or 'name [unit]'"]),
        ("time,voltage\n0,1\n\n1,2\n", ["row 3", "empty"]),
        ("time,voltage\n0,1\n1,2,5\n", ["row 3 has 3 cells"]),
        ("time,voltage\n0,1\n1,\n", ["row 3", "'voltage'", "empty"]),
        ("time,voltage\n0,1\n1,x1\n", ["row 3", "'voltage'", "'x1' is not a number"]),
        ("time,voltage\n0,1\n1,nan\n", ["row 3", "'voltage'", "not finite"]),
        ("time,voltage\n0,-inf\n", ["row 2", "'voltage'", "not finite"]),
        ("time,voltage\n0,1\n2,1\n1,1\n", ["row 4", "backward from 2 s to 1 s"]),
        (b"time,voltage\n0,1\n1,\xe9\n", ["row 3", "0xe9", "UTF-8"]),
    ],
)
def test_a_fault_is_named_with_its_place(
    tmp_path: Path, content: str | bytes, said: list[str]
) -> None:
    message = complaint(table(tmp_path, content))
    for words in said:
        assert words in message


@settings(deadline=None, max_examples=40)
@given(data=st.data(), rows=st.integers(1, 30))
def test_a_bad_cell_is_found_wherever_it_is(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, rows: int
) -> None:
    row = data.draw(st.integers(0, rows - 1))
    column = data.draw(st.sampled_from(["time", "voltage", "load_torque"]))
    cell = data.draw(st.sampled_from(["", "volt", "NaN", "1e", "--1", "1_000"]))
    cells = [dict(time=str(i), voltage="1.5", load_torque="0") for i in range(rows)]
    cells[row][column] = cell
    lines = ["time,voltage,load_torque", *(",".join(line.values()) for line in cells)]
    path = table(tmp_path_factory.getbasetemp(), "\n".join(lines))
    message = complaint(path)
    assert f"row {row + 2}," in message
    assert f"column '{column}'" in message


def test_a_date_is_no_number(tmp_path: Path) -> None:
    path = tmp_path / "in.parquet"
    days = pl.Series([0, 1]).cast(pl.Date)
    pl.DataFrame({"time": days, "voltage": [1.0, 2.0]}).write_parquet(path)
    assert "column 'time' holds Date" in complaint(path)


def test_a_missing_file_and_another_kind(tmp_path: Path) -> None:
    assert "cannot read" in complaint(tmp_path / "absent.csv")
    assert ".csv, .db3, .json, .jsonl, .mat" in complaint(table(tmp_path, "time\n0\n", "in.xlsx"))
    with pytest.raises(UserError, match=r"\.csv or \.parquet"):
        write_signals(tmp_path / "out.xlsx", np.zeros(1), {}, MOTOR.wire)


def test_an_unwritable_place_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="cannot write"):
        write_signals(tmp_path / "file" / "out.csv", np.zeros(1), {}, MOTOR.wire)


def test_a_crash_while_writing_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = table(tmp_path, "precious", "out.csv")

    def half_a_file(frame: pl.DataFrame, part: Path) -> None:
        part.write_text("time")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pl.DataFrame, "write_csv", half_a_file)
    with pytest.raises(UserError, match="No space left"):
        write_signals(path, np.zeros(1), {"angle": np.zeros(1)}, MOTOR.wire)
    assert [file.name for file in tmp_path.iterdir()] == ["out.csv"]
    assert path.read_text() == "precious"
