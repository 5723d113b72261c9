"""Log descriptions: which samples of a file are taken, judged and held out, and when they were."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

from servo_models.catalogue import model
from servo_models.data.arrays import describe as described
from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from servo_models.data.scaffold import draft
from tests.support.descriptions import DEGREE, HEAD, LOG, TABLE, complaint, describe, text_of


def test_a_window_and_a_span_count_from_the_first_row_of_the_file(tmp_path: Path) -> None:
    more = 'window = ["10 ms", 0.090]\nheld_out = { from = "50 ms", to = "70 ms" }\n'
    (log,) = describe(tmp_path, LOG + more).logs
    assert log.times == pytest.approx(5e-3 * np.arange(17), abs=1e-12)
    assert list(log.rows) == list(range(4, 21))
    assert list(np.flatnonzero(log.held_out)) == [8, 9, 10, 11, 12]
    assert log.outputs["angle"][0] == pytest.approx(0.2 * DEGREE)


def test_what_is_outside_the_window_may_be_broken(tmp_path: Path) -> None:
    rows = [*TABLE, (200.0, "off", "nan")]
    assert "row 22, column 'u'" in complaint(tmp_path, data=text_of(rows))
    (log,) = describe(tmp_path, LOG + 'window = [0, "95 ms"]', data=text_of(rows)).logs
    assert len(log.times) == 20


@pytest.mark.parametrize(
    ("held_out", "expected"),
    [
        ("true", [1] * 20),
        ("false", [0] * 20),
        ('{ from = "85 ms" }', [0] * 17 + [1] * 3),
        ('{ to = "10 ms" }', [1] * 3 + [0] * 17),
        # excursions from 1 to 3, to 2, to 0 and on to 2 and 3; the levels are 0, 2, 3
        (
            '{ input = "voltage", levels = "odd" }',
            [0] * 3 + [1] * 5 + [0] * 4 + [1] * 2 + [0] * 2 + [1] * 4,
        ),
        ('{ input = "voltage", levels = "even" }', [0] * 8 + [1] * 4 + [0] * 2 + [1] * 2 + [0] * 4),
    ],
)
def test_what_is_held_out(tmp_path: Path, held_out: str, expected: list[int]) -> None:
    command = [1, 1, 1, 3, 3, 3, 1, 1, 2, 2, 1, 1, 0, 0, 2, 2, 3, 3, 1, 1]
    rows = [(row[0], u, row[2]) for row, u in zip(TABLE, command)]
    (log,) = describe(tmp_path, f"{LOG}held_out = {held_out}\n", data=text_of(rows)).logs
    assert list(log.held_out) == expected


def test_only_what_follows_a_command_counts(tmp_path: Path) -> None:
    command = [1, 1, 1, 3, 3, 3, 3, 3, 3, 2, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3]
    rows = [(row[0], u, row[2]) for row, u in zip(TABLE, command)]
    judged = 'judged = { input = "voltage", after_change = "12 ms" }\n'
    held = 'held_out = { from = "50 ms" }\n'
    (log,) = describe(tmp_path, LOG + judged + held, data=text_of(rows)).logs
    assert list(np.flatnonzero(log.fitted)) == [3, 4, 5, 9]
    assert list(np.flatnonzero(log.checked)) == [10, 11, 12]


def test_repeated_rows_can_be_dropped(tmp_path: Path) -> None:
    rows = [*TABLE[:5], TABLE[4], TABLE[4], *TABLE[5:]]
    said = complaint(tmp_path, data=text_of(rows))
    assert "log.csv', row 7, column 'time_ms': time 0.12 s repeats" in said
    assert 'time.repeats = "drop"' in said
    log_ = LOG.replace('unit = "ms" }', 'unit = "ms", repeats = "drop" }')
    (log,) = describe(tmp_path, log_, data=text_of(rows)).logs
    assert log.outputs["angle"] == pytest.approx([row[2] * DEGREE for row in TABLE])
    assert list(log.rows) == [2, 3, 4, 5, 6, *range(9, 24)]


@pytest.mark.parametrize(
    ("first", "more", "expected"),
    [
        (0.0, "", 0.0),
        (0.04, "", 0.0),  # below a thousandth of the scale of 50 V
        (5.0, "", 0.095),  # stop_time is 0.2 s, the log is shorter
        (5.0, 'settle = "30 ms"', 0.03),
        (0.0, "constants = { load_torque = 0.01 }", 0.095),
    ],
)
def test_a_log_that_begins_away_from_rest_settles_first(
    tmp_path: Path, first: float, more: str, expected: float
) -> None:
    rows = [(TABLE[0][0], first, TABLE[0][2]), *TABLE[1:]]
    (log,) = describe(tmp_path, LOG + more, data=text_of(rows)).logs
    assert log.settle == pytest.approx(expected)


def test_inputs_of_another_table_are_held(tmp_path: Path) -> None:
    reads = [{"t": 10.0 * i, "angle": 0.1 * i} for i in range(20)]
    drive = [{"t": 15.0, "u": 1.0}, {"t": 15.0, "u": 9.0}, {"t": 40.0, "u": 2.0}]
    (tmp_path / "log.json").write_text(json.dumps({"reads": reads, "drive": drive}))
    log_ = """
    [[logs]]
    file = "log.json"
    table = "reads"
    time = { column = "t", unit = "ms" }
    inputs.voltage = { column = "u", table = "drive" }
    outputs.angle = "angle"
    """
    (log,) = describe(tmp_path, log_).logs
    assert list(log.rows) == list(range(3, 21))  # the first command comes at 15 ms
    assert list(log.inputs["voltage"]) == [9.0, 9.0] + [2.0] * 16
    assert log.times[0] == 0.0
    other = log_.replace('table = "reads"', 'table = "drive"').replace(
        'outputs.angle = "angle"', 'outputs.angle = { column = "angle", table = "reads" }'
    )
    assert "it is in table 'reads', the time in 'drive'" in complaint(tmp_path, log=other)


def test_columns_that_were_not_sampled_together(tmp_path: Path) -> None:
    times = [1e-3 * i for i in range(20)]
    document = {"t": times, "u": [1.0] * 20, "angle": [0.1] * 19, "none": []}
    (tmp_path / "log.json").write_text(json.dumps(document))
    log_ = """
    [[logs]]
    file = "log.json"
    time = "t"
    inputs.voltage = "u"
    outputs.angle = "angle"
    """
    assert "column 'angle' has 19 rows, the time 20" in complaint(tmp_path, log=log_)
    no_time = log_.replace('"t"', '"none"')
    assert "column 'none' has no rows" in complaint(tmp_path, log=no_time)


def test_a_shifted_column_is_late_or_early(tmp_path: Path) -> None:
    """An input stays a staircase, an output is linear between its samples."""
    stamps = [10.0 * k for k in range(40)]
    rows = [(t, float(k // 10), 2e-3 * t) for k, t in enumerate(stamps)]
    body = """[[logs]]
file = "log.csv"
time = { column = 1, unit = "ms" }
inputs.voltage = { column = 2, unit = "V", shift = "20 ms" }
outputs.angle = { column = 3, unit = "deg", shift = "-5 ms" }
"""
    (log,) = describe(tmp_path, log=body, data=text_of(rows)).logs
    voltage = [rows[max(k - 2, 0)][1] for k in range(40)]
    np.testing.assert_array_equal(log.inputs["voltage"], voltage)
    expected = DEGREE * 2e-3 * (np.array(stamps[:-1]) + 5.0)
    np.testing.assert_allclose(log.outputs["angle"][:-1], expected, atol=1e-12)


@pytest.mark.parametrize("signal", ["inputs.voltage", "outputs.angle"])
@pytest.mark.parametrize(
    ("shift", "said"),
    [
        ("5 s", "5 s, but the log lasts 0.095 s"),
        ("-1e6 s", "-1e+06 s, but the log lasts"),
        ("25 ms", "0.025 s leaves 15 of 20 samples"),
        ("-95 ms", "-0.095 s leaves 1 of 20 samples"),
    ],
)
def test_a_shift_that_leaves_too_few_samples(
    tmp_path: Path, signal: str, shift: str, said: str
) -> None:
    log = LOG.replace(f"{signal} = {{", f'{signal} = {{ shift = "{shift}",')
    message = complaint(tmp_path, log=log)
    assert f"logs[1].{signal}.shift: {said}" in message
    assert 'give its unit, such as "5 ms"' in message


def test_a_shift_that_leaves_an_output_constant(tmp_path: Path) -> None:
    rows = [(*row[:2], 0.0 if k < 18 else 1.0) for k, row in enumerate(TABLE)]
    log = LOG.replace('unit = "deg"', 'unit = "deg", shift = "15 ms"')
    message = complaint(tmp_path, log=log, data=text_of(rows))
    assert "column 'angle_deg' is constant over the log, in what a shift of 0.015 s" in message


MISSING = """
[[logs]]
file = "log.csv"
time = { column = 1, unit = "ms" }
inputs.voltage = { column = 2, unit = "V" }
outputs.angle = { column = 3, unit = "deg", missing = -999 }
"""


def test_a_number_that_stands_for_no_reading_is_not_seen(tmp_path: Path) -> None:
    lost = (4, 5, 11)
    rows = [(t, u, -999 if k in lost else y) for k, (t, u, y) in enumerate(TABLE)]
    (whole,) = describe(tmp_path, LOG).logs
    (log,) = describe(tmp_path, MISSING, data=text_of(rows)).logs
    assert list(np.flatnonzero(~log.fitted)) == list(lost)
    kept = np.delete(np.arange(len(TABLE)), lost)
    assert np.array_equal(log.outputs["angle"][kept], whole.outputs["angle"][kept])
    line = np.interp(whole.times, whole.times[kept], whole.outputs["angle"][kept])
    assert log.outputs["angle"] == pytest.approx(line)


def test_a_column_says_how_long_after_its_command_it_was_read(tmp_path: Path) -> None:
    told = LOG.replace('"deg"', '"deg", after_command = "2 ms"')
    (log,), (usual,) = (describe(tmp_path, it).logs for it in (told, LOG))
    assert log.channels["angle"].after_command == 2e-3
    assert usual.channels["angle"].after_command is None
    assert np.array_equal(log.outputs["angle"], usual.outputs["angle"])
    late = told.replace('"2 ms"', '"-2 ms"')
    assert "outputs.angle.after_command: below 0; say by shift" in complaint(tmp_path, log=late)
    command = LOG.replace('"V"', '"V", after_command = 0')
    assert "leave after_command out" in complaint(tmp_path, log=command)


def test_missing_is_for_outputs_and_not_for_every_row(tmp_path: Path) -> None:
    entry = MISSING.replace('unit = "V"', 'unit = "V", missing = 0')
    assert "an input has a value in every row" in complaint(tmp_path, log=entry)
    rows = [(t, u, -999) for t, u, _ in TABLE]
    assert "is no reading in any row" in complaint(tmp_path, log=MISSING, data=text_of(rows))


EMPTY_U, EMPTY_Y = (3, 4), (9, 12)
GAPS = [
    (t, "" if k in EMPTY_U else u, "nan" if k in EMPTY_Y else y)
    for k, (t, u, y) in enumerate(TABLE)
]


@pytest.mark.parametrize(
    ("voltage", "angle", "log_", "dropped"),
    [
        ("hold", "drop", None, EMPTY_Y),
        ("drop", "hold", None, EMPTY_U),
        (None, None, "hold", ()),
        (None, None, "drop", EMPTY_U + EMPTY_Y),
        (None, "drop", "hold", EMPTY_Y),
    ],
)
def test_a_cell_without_a_value_holds_or_drops_its_row(
    tmp_path: Path, voltage: str | None, angle: str | None, log_: str | None, dropped: tuple[int]
) -> None:
    entry = LOG + (f'missing = "{log_}"\n' if log_ else "")
    for unit, given in (("V", voltage), ("deg", angle)):
        more = f', missing = "{given}"' if given else ""
        entry = entry.replace(f'unit = "{unit}"', f'unit = "{unit}"{more}')
    (log,) = describe(tmp_path, entry, data=text_of(GAPS)).logs
    kept = [k for k in range(len(TABLE)) if k not in dropped]
    held_u = [TABLE[2][1] if k in EMPTY_U else TABLE[k][1] for k in kept]
    held_y = [TABLE[k - 1 if k in EMPTY_Y else k][2] * DEGREE for k in kept]
    assert any("2 rows without a value of 'u'" in note for note in log.notes)
    log = log.readings
    assert log.times == pytest.approx([0.005 * k for k in kept])
    assert log.inputs["voltage"] == pytest.approx(held_u)
    assert log.outputs["angle"] == pytest.approx(held_y)
    assert list(log.rows) == [k + 2 for k in kept]


def test_a_command_shifts_by_part_of_a_row(tmp_path: Path) -> None:
    shifted = LOG.replace('unit = "V"', 'unit = "V", shift = "2 ms"')
    (log,) = describe(tmp_path, shifted).logs
    sent = np.array([u for _, u, _ in TABLE])
    place = np.floor((log.times - 0.002) / 0.005 + 1e-6).astype(int)
    assert log.inputs["voltage"] == pytest.approx(sent[np.maximum(place, 0)])
    assert log.between is not None
    assert np.count_nonzero(log.between) == np.count_nonzero(np.diff(sent[:-1]))
    assert log.readings.times == pytest.approx(0.005 * np.arange(len(TABLE)))


def test_a_gap_that_nobody_explains_is_a_fault(tmp_path: Path) -> None:
    assert "row 5, column 'u' is empty" in complaint(tmp_path, data=text_of(GAPS))
    held = LOG.replace('unit = "V"', 'unit = "V", missing = "hold"')
    assert "row 11, column 'angle_deg'" in complaint(tmp_path, log=held, data=text_of(GAPS))
    assert "did you mean 'hold'?" in complaint(tmp_path, log=LOG + 'missing = "holds"\n')
    words = [(t, "off" if k == 5 else u, y) for k, (t, u, y) in enumerate(TABLE)]
    assert "'off' is not a number" in complaint(tmp_path, log=held, data=text_of(words))
    apart = [(t, u if k % 2 else "", "" if k % 2 else y) for k, (t, u, y) in enumerate(TABLE)]
    message = complaint(tmp_path, log=LOG + 'missing = "drop"\n', data=text_of(apart))
    assert 'no row has a value in every column; write missing = "hold"' in message


def test_readings_further_from_their_neighbours_than_said_are_not_seen(tmp_path: Path) -> None:
    wild = (4, 11, 12)
    rows = [(t, u, y + 40.0 if k in wild else y) for k, (t, u, y) in enumerate(TABLE)]
    entry = MISSING.replace("missing = -999", 'outliers = "30 deg"')
    (whole,) = describe(tmp_path, LOG).logs
    (log,) = describe(tmp_path, entry, data=text_of(rows)).logs
    assert list(np.flatnonzero(~log.fitted)) == list(wild)
    kept = np.delete(np.arange(len(TABLE)), wild)
    assert np.array_equal(log.outputs["angle"][kept], whole.outputs["angle"][kept])
    wrong = entry.replace('"30 deg"', "0")
    assert "is no distance; give one above 0" in complaint(tmp_path, log=wrong)
    for_input = entry.replace('unit = "V"', 'unit = "V", outliers = 1')
    assert "an input has a value in every row; leave outliers out" in complaint(
        tmp_path, log=for_input
    )


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
