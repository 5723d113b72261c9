"""Dates and times in the time column, against the calendar of Python."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.catalogue import model
from servo_models.data.arrays import describe as described
from servo_models.data.description import read_description
from servo_models.data.readers.dates import seconds
from servo_models.data.scaffold import draft
from tests.support.descriptions import HEAD, LOG, TABLE, complaint, describe, text_of

DATED = LOG.replace('{ column = "time_ms", unit = "ms" }', '"stamp"')
HEADER = "stamp,u,angle_deg"
FIRST = dt.datetime(2024, 2, 29, 23, 59, 59, 950_000)  # midnight of a leap day lies in the log


def stamps(form: str, zone: str = "") -> list[str]:
    times = (FIRST + dt.timedelta(milliseconds=row[0]) for row in TABLE)
    return [time.strftime(form) + zone for time in times]


def rows(times: Sequence[object]) -> str:
    return text_of([(time, *row[1:]) for time, row in zip(times, TABLE)], HEADER)


@settings(deadline=None, max_examples=200)
@given(
    st.datetimes(dt.datetime(1900, 1, 1), dt.datetime(2200, 1, 1)),
    st.sampled_from(["T", " ", "t"]),
    st.sampled_from(["", "Z", "+00:00", "+02:00", "-0730", "+05"]),
    st.integers(0, 9),
)
def test_every_way_to_write_a_time(time: dt.datetime, between: str, zone: str, digits: int) -> None:
    part = f"{time.microsecond:06d}".ljust(9, "0")[:digits]
    written = f"{time:%Y-%m-%d}{between}{time:%H:%M:%S}{'.' * (digits > 0)}{part}{zone}"
    cut = time.replace(microsecond=int(part.ljust(6, "0")[:6] or 0))
    offset = dt.timezone.utc
    if zone not in ("", "Z"):
        sign = -1 if zone[0] == "-" else 1
        hours, minutes = int(zone[1:3]), int(zone[3:].replace(":", "") or 0)
        offset = dt.timezone(sign * dt.timedelta(hours=hours, minutes=minutes))
    found = seconds(pl.Series([written]), str)
    assert found is not None
    assert found[0] == pytest.approx(cut.replace(tzinfo=offset).timestamp(), abs=1e-6)


@pytest.mark.parametrize(
    "times",
    [
        stamps("%Y-%m-%dT%H:%M:%S.%f"),
        stamps("%Y-%m-%d %H:%M:%S.%f"),
        stamps("%Y-%m-%dT%H:%M:%S.%f", "Z"),
        stamps("%Y-%m-%dT%H:%M:%S.%f", "+02:00"),
        stamps("%Y-%m-%d %H:%M:%S.%f", "000 -0330"),
        stamps("%Y%m%dT%H%M%S.%f", "Z"),
    ],
)
def test_a_log_with_dates_and_times(tmp_path: Path, times: list[str]) -> None:
    log = describe(tmp_path, DATED, data=rows(times)).logs[0]
    assert log.times == pytest.approx(5e-3 * np.arange(len(TABLE)), abs=1e-12)
    assert not log.notes


def test_times_of_a_day(tmp_path: Path) -> None:
    times = [f"12:00:{0.005 * k:06.3f}" for k in range(20)]
    log = describe(tmp_path, DATED, data=rows(times)).logs[0]
    assert log.times == pytest.approx(5e-3 * np.arange(20.0), abs=1e-9)
    late = [
        f"23:59:59.{950 + 5 * k:03d}" if k < 10 else f"00:00:00.{5 * k - 50:03d}" for k in range(20)
    ]
    message = complaint(tmp_path, log=DATED, data=rows(late))
    assert "row 12, column 'stamp': time runs backward from '23:59:59.995' to" in message
    assert "past midnight a time needs its date, such as '2024-05-01T00:00:00.000'" in message


def changed(row: int, text: str) -> list[str]:
    times = stamps("%Y-%m-%dT%H:%M:%S.%f", "Z")
    return [*times[:row], text, *times[row + 1 :]]


@pytest.mark.parametrize(
    ("times", "said"),
    [
        (changed(4, "2024-03-01T00:00:00.070+01:00"), ["row 6", "another zone than the first"]),
        (changed(4, "2024-03-01T00:00:00.070"), ["row 6", "another zone", "in one zone"]),
        (changed(4, "00:00:00.070Z"), ["row 6", "no date and time as"]),
        (
            changed(4, "2024-02-30T00:00:00Z"),
            ["row 6", "'2024-02-30T00:00:00Z' is no date and time, day is"],
        ),
        (changed(4, "2024-13-45T00:00:00"), ["row 6", "is no date and time, month must be in"]),
        (changed(4, "2024-03-01T24:00:00Z"), ["row 6", "is no date and time, hour"]),
        (changed(4, "2024-03-01T23:59:60Z"), ["row 6", "is no date and time, second"]),
        (changed(4, "yesterday"), ["row 6, column 'stamp'", "'yesterday' is no date and time"]),
        (changed(4, "0.12"), ["row 6", "'0.12' is no date and time"]),
        (changed(4, ""), ["row 6, column 'stamp' is empty"]),
        (
            changed(4, "2024-02-29T23:59:59Z"),
            [
                "row 6, column 'stamp': time runs backward from '2024-03-01T00:00:00.065000Z'",
                "sort",
            ],
        ),
        (changed(4, "2024-03-01T00:00:00.065Z"), ["row 6", "'2024-03-01T00:00:00.065Z' repeats"]),
        (["soon", *stamps("%H:%M:%S.%f")[1:]], ["row 2, column 'stamp': 'soon' is not a number"]),
    ],
)
def test_a_fault_of_a_date_is_named(tmp_path: Path, times: list[str], said: list[str]) -> None:
    message = complaint(tmp_path, log=DATED, data=rows(times))
    for words in said:
        assert words in message


OTHER_FORMS = (
    "%d.%m.%Y %H:%M:%S.%f",
    "%m/%d/%Y %H:%M:%S",
    "%d-%m-%y %H:%M",
    "%Y/%m/%d %H:%M:%S",
    "%d.%m.%Y",
)
READ_FORMS = ("%Y-%m-%dT%H:%M:%S.%fZ", "%H:%M:%S")


@pytest.mark.parametrize(
    ("form", "row"),
    [*((form, row) for form in OTHER_FORMS for row in (0, 3)), *((form, 3) for form in READ_FORMS)],
)
def test_dates_of_another_form_have_the_right_one_named(
    tmp_path: Path, form: str, row: int
) -> None:
    plain = [100.0 + 5.0 * k for k in range(len(TABLE))]
    times = [*plain[:row], *stamps(form)[row:]]
    message = complaint(tmp_path, log=DATED, data=rows(times))
    assert f"row {row + 2}, column 'stamp': '{times[row]}' is not a number" in message
    mixed = "; the rows before are numbers: write all as dates or all as numbers"
    assert message.endswith(mixed if row else "; write dates as 2024-05-01T12:00:00")


def test_numbers_that_are_no_dates_are_to_be_corrected(tmp_path: Path) -> None:
    for text in ("1.2.3", "1.2.3.4", "12-5", "1/2", "10.1.1.250"):
        message = complaint(tmp_path, log=DATED, data=rows([text, *range(1, 20)]))
        assert message.endswith("is not a number; correct it or remove the row")


def test_dates_have_no_unit(tmp_path: Path) -> None:
    data = rows(stamps("%Y-%m-%dT%H:%M:%S.%f"))
    unit = DATED.replace('"stamp"', '{ column = "stamp", unit = "ms" }')
    assert "logs[1].time.unit: the column holds dates" in complaint(tmp_path, log=unit, data=data)


def test_files_with_a_type_for_times(tmp_path: Path) -> None:
    times = [FIRST + dt.timedelta(milliseconds=row[0]) for row in TABLE]
    columns = {"stamp": times, "u": [r[1] for r in TABLE], "angle_deg": [r[2] for r in TABLE]}
    for unit in ("ms", "us", "ns"):
        for zone in (None, "Europe/Berlin"):
            frame = pl.DataFrame(columns).cast({"stamp": pl.Datetime(unit, zone)})  # type: ignore[arg-type]
            frame.write_parquet(tmp_path / "log.parquet")
            path = tmp_path / "rig.toml"
            path.write_text(HEAD + DATED.replace("log.csv", "log.parquet"))
            (log,) = read_description(path).logs
            assert log.times == pytest.approx(5e-3 * np.arange(20.0), abs=1e-9)
    records = [dict(zip(HEADER.split(","), (str(t), *row[1:]))) for t, row in zip(times, TABLE)]
    (tmp_path / "log.json").write_text(json.dumps(records))
    path.write_text(HEAD + DATED.replace("log.csv", "log.json"))
    assert len(read_description(path).logs[0].times) == 20


@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_dates_in_memory(zone: str | None) -> None:
    index = pd.date_range(FIRST, periods=20, freq="5ms", tz=zone)
    table: dict[str, Any] = {"t": index, "u": np.arange(20.0) % 3, "angle": np.arange(20.0) / 50}
    columns = {"time": "t", "voltage": "u", "angle": "angle"}
    for given_ in (table, pd.DataFrame(table)):
        log = described(model("torque_motor", "measured"), {"a": given_}, columns).logs[0]
        assert log.times == pytest.approx(5e-3 * np.arange(20.0), abs=1e-9)


def test_a_draft_takes_dates_for_the_time(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(rows(stamps("%Y-%m-%d %H:%M:%S.%f")))
    made = draft(path, "torque_motor")
    assert 'time = { column = "stamp" }' in made.text(tmp_path)
    (tmp_path / "rig.toml").write_text(made.text(tmp_path))
    assert len(read_description(tmp_path / "rig.toml").logs[0].times) == 20
