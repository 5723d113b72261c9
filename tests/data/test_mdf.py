"""MDF4 files, written by ``asammdf``: rasters, units, what is invalid or damaged."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.data.readers import read_columns, read_tables
from servo_models.errors import UserError
from tests.conftest import Run

asammdf = pytest.importorskip("asammdf")

SLOW = 0.02 * np.arange(100)
FAST = 0.003 + 0.005 * np.arange(390)
LATE = 0.03  # s, by which readings follow commands
COLUMNS_OF_A_GROUP_EACH = {"version": "4.20", "column_storage": True}


def goal(times: Array) -> Array:
    return 30.0 * np.sin(2.0 * times)


def bench(path: Path, compression: int = 0, **kind: Any) -> Path:
    """A goal every 20 ms; an angle in counts, a torque and a state every 5 ms."""
    file, of = asammdf.MDF(**kind), asammdf.Signal
    file.append([of(goal(SLOW), SLOW, name="Servo.goal", unit="deg")], acq_name="20ms")
    counts = np.round(100.0 * goal(FAST - LATE)).astype("<i2")
    state = {"val_0": 0, "text_0": "off", "val_1": 1, "text_1": "on", "default": b""}
    signals = [
        of(counts, FAST, name="Servo.angle", unit="deg", conversion={"a": 0.01, "b": 1.0}),
        of(np.cos(FAST), FAST, name="Servo.torque", unit="Nm"),
        of((FAST > 1.0).astype("u1"), FAST, name="state", conversion=state),
        of(np.full(len(FAST), b"text"), FAST, name="note", encoding="utf-8"),
        of(np.ones(len(FAST), dtype=[("field", "<f8", (3,))]), FAST, name="field"),
        of(np.ones(len(FAST), dtype=[("x", "<f8"), ("y", "<f4")]), FAST, name="pose"),
    ]
    file.append(signals, acq_name="5ms", common_timebase=True)
    stream = io.BytesIO()
    file.save(stream, compression=compression)
    path.write_bytes(stream.getvalue())
    return path


@pytest.mark.parametrize("compression", [0, 2])
@pytest.mark.parametrize("kind", [{"version": "4.00"}, {}, COLUMNS_OF_A_GROUP_EACH], ids=str)
def test_a_raster_is_a_table_of_physical_values(
    tmp_path: Path, kind: dict[str, Any], compression: int
) -> None:
    path = bench(tmp_path / "bench.mf4", compression, **kind)
    assert list(read_tables(path)) == ["20ms", "5ms"]
    columns = read_columns(path, "5ms")
    names = ("time [s]", "Servo.angle [deg]", "Servo.torque [Nm]", "state")
    assert columns.names == (*names, *(f"field[{i}]" for i in range(3)), "x", "y")
    assert columns.numbers("time [s]") == pytest.approx(FAST, abs=1e-12)
    angle = np.round(100.0 * goal(FAST - LATE)) / 100.0 + 1.0
    assert columns.numbers("Servo.angle") == pytest.approx(angle, abs=1e-12)
    assert list(columns.numbers("state")) == list(FAST > 1.0)
    assert set(columns.numbers("field[2]")) == set(columns.numbers("y")) == {1.0}
    with pytest.raises(UserError, match=r"has no table '5 ms'; did you mean '5ms'"):
        read_columns(path, "5 ms")


def test_a_draft_takes_the_units_over_and_holds_a_slower_goal(run: Run, tmp_path: Path) -> None:
    path = bench(tmp_path / "bench.mf4")
    code, _, err = run("check", path, "--init", "--actuator", "smart_servo")
    assert (code, err) == (0, "")
    text = path.with_suffix(".toml").read_text()
    assert text.count("# guessed") == 1  # the supply, which is no channel
    (log,) = read_description(path.with_suffix(".toml")).logs
    log = log.readings
    assert log.times == pytest.approx(FAST - FAST[0], abs=1e-9)
    sent = goal(0.02 * np.floor(FAST / 0.02 + 1e-9))
    assert np.degrees(log.inputs["goal"]) == pytest.approx(sent, abs=1e-9)
    assert np.degrees(log.outputs["angle"]) == pytest.approx(goal(FAST - LATE) + 1.0, abs=0.006)


def test_what_is_invalid_is_an_empty_cell(tmp_path: Path) -> None:
    file, path = asammdf.MDF(), tmp_path / "log.mf4"
    invalid = asammdf.InvalidationArray(np.arange(100) % 10 == 7)
    for values in (SLOW, -SLOW):
        file.append([asammdf.Signal(values, SLOW, name="angle", invalidation_bits=invalid)])
    file.save(path)
    columns = read_columns(path, "group.1")
    assert list(columns.empty("angle")) == list(np.arange(100) % 10 == 7)
    assert columns.numbers("angle", slice(7)) == pytest.approx(-SLOW[:7])
    with pytest.raises(UserError, match="row 8, column 'angle' is empty: fill the gap"):
        columns.numbers("angle")


def changed(content: bytes, block: bytes, at: int, value: int) -> bytes:
    """The file with 8 bytes in the first block of a kind replaced."""
    begin = content.index(block) + at
    return content[:begin] + struct.pack("<Q", value) + content[begin + 8 :]


def test_damaged_files_are_told(tmp_path: Path) -> None:
    """A number of records that are not there, and a chain of blocks that never ends, too.

    Source: ASAM MDF 4.1: links begin at byte 24 of a block; a ##CG has six, then a record's number
    and how many of them there are.
    """
    path = bench(tmp_path / "log.mf4")
    whole = path.read_bytes()
    again = whole.index(b"##CN")
    damaged = [
        *(b"", whole[:50], whole[:-100], whole[: len(whole) // 2], b"PK\3\4" + whole),
        *(changed(whole, b"##CG", 24 + 6 * 8 + 8, rows) for rows in (101, 1 << 24)),
        changed(whole, b"##CN", 24, again),
        changed(changed(whole, b"##DG", 24, len(whole)), b"##DG", 24, whole.index(b"##DG")),
        whole.replace(b"MDF     4.10", b"MDF     3.30"),
    ]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(UserError, match=r"log\.mf4' is damaged or no MDF4 file: write it aga"):
            read_columns(path)
    path.write_bytes(changed(whole, b"##CG", 24 + 6 * 8 + 8, 1 << 40))
    with pytest.raises(UserError, match=r"log\.mf4' would take .*--largest"):
        read_columns(path)
