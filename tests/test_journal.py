"""Work on many cases: what fails stops nothing else, and what is done is not done again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from servo_models.blind.journal import work_through
from servo_models.errors import UserError


def test_a_case_that_fails_stops_no_other_and_is_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    tasks = {name: json.dumps({"case": name, "found": 1}) for name in "abcd"}
    with pytest.raises(
        UserError, match=r"1 of 4 cases failed, case 'b' with JSONDecodeError"
    ) as it:
        work_through(path, {**tasks, "b": "no row"}, json.loads, 2, lambda *_: None)
    assert str(path) in str(it.value)
    assert {json.loads(line)["case"] for line in path.read_text().splitlines()} == set("acd")
    again = {name: "done already" for name in "acd"}
    rows = work_through(path, {**again, "b": tasks["b"]}, json.loads, 2, lambda *_: None)
    assert rows == {name: {"case": name, "found": 1} for name in "abcd"}


def test_a_line_that_was_being_written_is_done_again(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"case": "a", "found": 1}\n{"case": "b", "fou')
    tasks = {"a": "done already", "b": '{"case": "b", "found": 2}'}
    rows = work_through(path, tasks, json.loads, 1, lambda *_: None)
    assert [rows[name]["found"] for name in "ab"] == [1, 2]
