"""Work on many cases: what fails stops nothing else, and what is done is not done again."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from servo_models.core.stop import silent
from servo_models.errors import UserError
from servo_models.withheld.run import work_through


@pytest.mark.thorough
def test_a_case_that_fails_stops_no_other_and_is_tried_again(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    tasks = {name: json.dumps({"case": name, "found": 1}) for name in "abcd"}
    with pytest.raises(UserError, match=r"1 of 4 cases failed, case 'b': .* JSONDecodeError") as it:
        work_through(path, {**tasks, "b": "no row"}, json.loads, 2, silent, "")
    assert str(path) in str(it.value)
    assert {json.loads(line)["case"] for line in path.read_text().splitlines()} == set("acd")
    again = {name: "done already" for name in "acd"}
    rows = work_through(path, {**again, "b": tasks["b"]}, json.loads, 2, silent, "")
    assert rows == {name: {"case": name, "found": 1} for name in "abcd"}


def test_a_line_that_was_being_written_is_done_again(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text('{"case": "a", "found": 1}\n{"case": "b", "fou')
    tasks = {"a": "done already", "b": '{"case": "b", "found": 2}'}
    rows = work_through(path, tasks, json.loads, 1, silent, "")
    assert [rows[name]["found"] for name in "ab"] == [1, 2]


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_the_workers_of_a_killed_run_end_with_it(tmp_path: Path) -> None:
    """They went on with their case, half a minute of two processors for nobody."""
    text = (
        "import time; from pathlib import Path\n"
        "from servo_models.withheld.run import work_through\n"
        "work_through(Path('rows'), {'a': 60.0, 'b': 60.0}, time.sleep, 2, print, 'doing')"
    )
    with subprocess.Popen([sys.executable, "-c", text], cwd=tmp_path) as run:
        assert _comes_true(lambda: len(_children(run.pid)) == 2)
        workers = [Path("/proc", child) for child in _children(run.pid)]
        time.sleep(2.0)  # they are at their case by now
        run.kill()
    assert _comes_true(lambda: not any(_runs(worker) for worker in workers))


def _children(process: int) -> list[str]:
    lists = Path(f"/proc/{process}/task").glob("*/children")  # each thread has its own
    return [child for one in lists for child in one.read_text().split()]


def _comes_true(is_so: Callable[[], bool]) -> bool:
    end = time.monotonic() + 20.0
    while not (found := is_so()) and time.monotonic() < end:
        time.sleep(0.05)
    return found


def _runs(process: Path) -> bool:
    try:
        return ") Z " not in (process / "stat").read_text()
    except OSError:
        return False
