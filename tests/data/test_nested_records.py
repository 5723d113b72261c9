"""JSON as robots log it: records inside of records, lists in them, and one record a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from tests.support.descriptions import HEAD, LOG, TABLE
from tests.support.files import complaint, file

EPISODE = [
    {
        "timestamp": 0.005 * k,
        "observation": {"state": [0.1 * k, 2.0, 3.0, float(k)], "load": {"left": k, "right": -k}},
        "action": [float(k % 3), 0.0],
    }
    for k in range(20)
]
LINES = "\n".join(map(json.dumps, EPISODE)) + "\n"


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (json.dumps(EPISODE), "log.json"),
        (LINES, "log.jsonl"),
        (LINES.replace("\n", "\r\n"), "log.ndjson"),
        ("\N{BYTE ORDER MARK}" + LINES, "log.JSONL"),
        (LINES, "log.json"),
        (json.dumps({"fps": 200, "frames": EPISODE}), "log.json"),
    ],
)
def test_columns_are_dotted_and_items_of_lists_have_their_index(
    tmp_path: Path, content: str, name: str
) -> None:
    columns = read_columns(file(tmp_path, content, name))
    assert columns.names == (
        "timestamp",
        *(f"observation.state[{k}]" for k in range(4)),
        "observation.load.left",
        "observation.load.right",
        "action[0]",
        "action[1]",
    )
    for written in ("observation.state[3]", "observation.state.3"):
        assert list(columns.numbers(written)) == [float(k) for k in range(20)]
    assert list(columns.numbers("observation.load.right")) == [-float(k) for k in range(20)]


def test_a_description_names_them_either_way(tmp_path: Path) -> None:
    (tmp_path / "log.jsonl").write_text(LINES)
    path = tmp_path / "rig.toml"
    nested = LOG.replace("log.csv", "log.jsonl").replace('"time_ms", unit = "ms"', '"timestamp"')
    nested = nested.replace('"u"', '"action.0"').replace("angle_deg", "observation.state[0]")
    path.write_text(HEAD + nested)
    (log,) = read_description(path).logs
    assert list(log.inputs["voltage"]) == [u for _, u, _ in TABLE]
    assert np.rad2deg(log.outputs["angle"]) == pytest.approx([angle for *_, angle in TABLE])


@pytest.mark.parametrize("dotted", ["q.1", "q[1]"])
def test_a_name_that_stands_there_comes_first(tmp_path: Path, dotted: str) -> None:
    records = [{"q.1": 1.0, "q": [5.0, 6.0]}]
    columns = read_columns(file(tmp_path, json.dumps(records), "log.json"))
    assert list(columns.numbers(dotted)) == [{"q.1": 1.0, "q[1]": 6.0}[dotted]]


def test_lists_of_lists_are_columns_too(tmp_path: Path) -> None:
    document: dict[str, Any] = {"t": [0, 1, 2], "joints": {"q": [[1, 2], [3, 4], None]}}
    columns = read_columns(file(tmp_path, json.dumps(document), "log.json"))
    assert columns.names == ("t", "joints.q[0]", "joints.q[1]")
    assert list(columns.numbers("joints.q.1", slice(0, 2))) == [2.0, 4.0]
    rows = file(tmp_path, "[0, 1.5]\n[1, 2.5]\n", "rows.jsonl")
    assert list(read_columns(rows).numbers("[1]")) == [1.5, 2.5]


JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)


@pytest.mark.thorough
@settings(deadline=None, max_examples=60)
@given(st.lists(st.dictionaries(st.text(min_size=1, max_size=3), JSON, min_size=1), min_size=1))
def test_lines_are_read_as_a_list_of_the_same_records(
    tmp_path_factory: pytest.TempPathFactory, records: list[dict[str, Any]]
) -> None:
    folder = tmp_path_factory.getbasetemp()
    whole = file(folder, json.dumps(records), "whole.json")
    lines = file(folder, "\n".join(map(json.dumps, records)), "lines.jsonl")
    try:
        expected = read_columns(whole)
    except Exception as error:
        with pytest.raises(type(error)):
            read_columns(lines)
        return
    found = read_columns(lines)
    assert found.names == expected.names
    assert all(a.equals(b, null_equal=True) for a, b in zip(found.cells, expected.cells))


@pytest.mark.parametrize(
    ("content", "column", "said"),
    [
        ('{"t": 0}\n{"t": }\n', "t", "row 2: no JSON"),
        ('{"t": 0}\n\n{"t": 1}\n', "t", "row 2 is empty"),
        ('{"t": 0}\n{"t": "late"}\n', "t", "row 2, column 't': 'late' is not a number"),
        ('{"t": 0}\n{"u": 1}\n', "t", "row 2, column 't' is empty"),
        ("", 1, "no rows"),
        ("1\n2\n", 1, "row 1: no record"),
        ("[" * 100_000, "t", "nested too deeply"),
        (b"\xff\xfe\x00", "t", "damaged"),
    ],
)
def test_a_fault_of_a_line_is_named(
    tmp_path: Path, content: str | bytes, column: str | int, said: str
) -> None:
    assert said in complaint(file(tmp_path, content, "log.jsonl"), column)
