"""Columns whose first cells are empty: the log begins where each has a value, and says so."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

from servo_models.core.simulate import model
from servo_models.data.arrays import describe as described
from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from servo_models.data.scaffold import draft
from tests.support.descriptions import HEAD, LOG, TABLE, complaint, describe, text_of

ROWS: list[tuple[float, float | None, float | None]] = [
    (time, None if k < 1 else u, None if k < 3 else angle)
    for k, (time, u, angle) in enumerate(TABLE)
]
NAMES = ("time_ms", "u", "angle_deg")


def csv(path: Path) -> None:
    rows = [tuple("" if cell is None else cell for cell in row) for row in ROWS]
    path.write_text(text_of(rows))


def quoted_csv(path: Path) -> None:
    rows = [tuple('""' if cell is None else cell for cell in row) for row in ROWS]
    path.write_text(text_of(rows))


def not_a_number(path: Path) -> None:
    rows = [tuple("NaN" if cell is None else cell for cell in row) for row in ROWS]
    path.write_text(text_of(rows))


def records(path: Path) -> None:
    found = [{name: cell for name, cell in zip(NAMES, row) if cell is not None} for row in ROWS]
    path.write_text(json.dumps(found))


def lists(path: Path) -> None:
    path.write_text(json.dumps(dict(zip(NAMES, zip(*ROWS)))))


def parquet(path: Path) -> None:
    pl.DataFrame(ROWS, schema=NAMES, orient="row").write_parquet(path)


WRITERS: list[tuple[str, Callable[[Path], None]]] = [
    ("log.csv", csv),
    ("log.csv", quoted_csv),
    ("log.csv", not_a_number),
    ("log.json", records),
    ("log.json", lists),
    ("log.parquet", parquet),
]


@pytest.mark.parametrize(("name", "write"), WRITERS)
def test_a_log_begins_where_every_column_has_a_value(
    tmp_path: Path, name: str, write: Callable[[Path], None]
) -> None:
    write(tmp_path / name)
    path = tmp_path / "rig.toml"
    path.write_text(HEAD + LOG.replace("log.csv", name))
    (log,) = read_description(path).logs
    first = 2 if name.endswith("csv") else 1
    assert list(log.rows) == list(range(first + 3, first + 20))
    assert list(log.inputs["voltage"]) == [u for _, u, _ in TABLE[3:]]
    assert np.rad2deg(log.outputs["angle"]) == pytest.approx([a for *_, a in TABLE[3:]])
    assert log.begin == pytest.approx(0.015)
    (note,) = log.notes
    assert note.startswith(f"rows {first} to {first + 2} are left out")
    assert "'angle_deg'" in note


def test_a_column_that_nobody_uses_may_begin_late(tmp_path: Path) -> None:
    rows = [(*row, "" if k < 5 else 1.0) for k, row in enumerate(TABLE)]
    log = describe(tmp_path, data=text_of(rows, "time_ms,u,angle_deg,temperature")).logs[0]
    assert len(log.times) == len(TABLE)
    assert not log.notes


def test_a_window_behind_the_empty_cells_leaves_nothing_out(tmp_path: Path) -> None:
    csv(tmp_path / "log.csv")
    windowed = LOG + 'window = ["15 ms", "95 ms"]\n'
    log = describe(tmp_path, windowed, data=(tmp_path / "log.csv").read_text()).logs[0]
    assert len(log.times) == 17
    assert not log.notes


def test_times_may_begin_late_too(tmp_path: Path) -> None:
    rows = [("" if k < 2 else row[0], *row[1:]) for k, row in enumerate(TABLE)]
    log = describe(tmp_path, data=text_of(rows)).logs[0]
    assert log.rows[0] == 4
    rows[7] = (90.0, 0.0, 0.0)
    assert "row 9, column 'time_ms': time runs backward" in complaint(tmp_path, data=text_of(rows))


@pytest.mark.parametrize(
    ("row", "said"),
    [(4, "row 6, column 'u' is empty"), (19, "row 21, column 'u' is empty")],
)
def test_a_cell_that_is_empty_later_is_a_fault_as_before(
    tmp_path: Path, row: int, said: str
) -> None:
    rows: list[Any] = [*TABLE[:row], (TABLE[row][0], "", 1.0), *TABLE[row + 1 :]]
    assert said in complaint(tmp_path, data=text_of(rows))


def test_a_column_without_any_value_is_refused(tmp_path: Path) -> None:
    rows = [(time, "", angle) for time, _, angle in TABLE]
    assert "row 2, column 'u' is empty" in complaint(tmp_path, data=text_of(rows))


@pytest.mark.parametrize(
    "column",
    [
        pd.Series([None, *([1.5] * 19)], dtype=object),
        pd.Series([None, *([1] * 19)], dtype="Int64"),
        np.ma.masked_invalid([np.nan, *([1.5] * 19)]),
        [None, *([1.5] * 19)],
    ],
)
def test_in_memory(column: Any) -> None:
    table = {"t": 0.005 * np.arange(20.0), "u": column, "angle": np.arange(20.0) / 50.0}
    columns = {"time": "t", "voltage": "u", "angle": "angle"}
    log = described(model("torque_motor", "measured"), {"a": table}, columns).logs[0]
    assert list(log.rows) == list(range(1, 20))
    assert "row 0 is left out" in log.notes[0]


def test_a_header_of_numbers_and_words_is_one_above_empty_cells(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("0,angle,u\n0.0,,\n0.1,,1\n0.2,3,2\n")
    assert read_columns(path).names == ("0", "angle", "u")


def test_records_may_begin_with_nothing(tmp_path: Path) -> None:
    path = tmp_path / "log.json"
    path.write_text(json.dumps([None, {"t": 1, "u": 2}]))
    assert read_columns(path).names == ("t", "u")
    assert read_columns(path).begin("u") == 1


def test_a_draft_has_columns_that_begin_late(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    csv(path)
    made = draft(path, "torque_motor")
    assert {match.column.key for match in made.matches} >= {"u", "angle_deg"}
    assert not made.warnings
