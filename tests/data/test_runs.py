"""Many runs in one entry: a pattern in ``file``, a list in ``repeat``; one log each."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from servo_models.data.description import Description, read_description
from servo_models.data.log import hashes
from servo_models.data.schema import named_files
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.descriptions import HEAD, LOG, TABLE, complaint, describe, text_of


def recorded(folder: Path, *names: str) -> None:
    """A log in each of these files, told apart by its last reading."""
    for k, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text_of([*TABLE[:-1], (*TABLE[-1][:2], float(k))]))


def entry(file: str, more: str = "") -> str:
    return LOG.replace('"log.csv"', json.dumps(file)) + more + "\n"


def names_of(told: Description) -> list[str]:
    return [log.name for log in told.logs]


def test_a_pattern_is_a_log_for_each_file_in_natural_order(tmp_path: Path) -> None:
    recorded(tmp_path, *(f"runs/step_{k}.csv" for k in (10, 2, 1, 33)), "runs/notes.csv")
    told = describe(tmp_path, entry("runs/step_*.csv", 'constants = { load_torque = "1 mN.m" }'))
    assert names_of(told) == ["step_1", "step_2", "step_10", "step_33"]
    assert [log.path.name for log in told.logs] == [f"step_{k}.csv" for k in (1, 2, 10, 33)]
    assert all(log.constants == {"load_torque": 1e-3} for log in told.logs)
    assert len({log.sha256 for log in told.logs}) == 4


def test_files_of_one_name_in_several_folders_are_told_apart(tmp_path: Path) -> None:
    recorded(tmp_path, "a/x/run.csv", "b/x/run.csv", "b/y/run.csv")
    told = describe(tmp_path, entry("**/run.csv"))
    assert names_of(told) == ["a/x/run", "b/x/run", "b/y/run"]
    assert list(hashes(told.logs)) == ["a/x/run.csv", "b/x/run.csv", "y/run.csv"]


def test_a_name_stands_before_that_of_each_file(tmp_path: Path) -> None:
    recorded(tmp_path, "a/1.csv", "a/2.csv", "b/1.csv")
    both = entry("a/*.csv", 'name = "left"') + entry("b/*.csv", 'name = "right"')
    assert names_of(describe(tmp_path, both)) == ["left 1", "left 2", "right 1"]
    message = complaint(tmp_path, log=entry("a/*.csv") + entry("b/*.csv"))
    assert "logs[2].name: a second log '1'" in message


LONG = [(100.0 + 5.0 * k, float(k % 3), 0.1 * k) for k in range(60)]
"""Rows at which three windows of a file do not overlap."""
PARTS = 'window = [0, "80 ms"]', 'window = ["80 ms", "165 ms"]'
BODY = "".join(line + "\n" for line in LOG.splitlines() if not line.startswith("file"))


def repeated(*runs: str) -> str:
    return f"{BODY}repeat = [{', '.join(f'{{ {run} }}' for run in runs)}]\n"


def test_runs_of_one_file_are_numbered(tmp_path: Path) -> None:
    recorded(tmp_path, "free.csv", "left/free.csv")
    (tmp_path / "steps.csv").write_text(text_of(LONG))
    listed = [f'file = "steps.csv", {part}' for part in PARTS]
    told = describe(tmp_path, repeated(*listed, 'file = "free.csv"'))
    assert names_of(told) == ["steps 1", "steps 2", "free"]
    assert [len(log.times) for log in told.logs] == [17, 18, 20]
    told = describe(tmp_path, repeated('file = "free.csv"', 'file = "left/*.csv"'))
    assert names_of(told) == ["free 1", "free 2"]
    told = describe(tmp_path, repeated(*listed, 'file = "free.csv", name = "steps 1"'))
    assert names_of(told) == ["steps 2", "steps 3", "steps 1"]
    led = describe(tmp_path, repeated(*listed).replace("repeat", 'name = "rig"\nrepeat'))
    assert names_of(led) == ["rig steps 1", "rig steps 2"]


@pytest.mark.parametrize(
    ("runs", "said"),
    [
        (
            ('file = "d.csv"', 'file = "*.csv"', 'file = "d.csv", name = "d"'),
            ["logs[1].repeat[2].file", "d.csv' is also in logs[1].repeat[1]", "rows 2 to 61"],
        ),
        (('file = "d.csv"', 'file = "./d.csv", name = "e"'), ["is also in logs[1].repeat[1]"]),
        (('file = "d.csv"', 'file = "d.csv", held_out = true'), ["would count twice"]),
        (
            (f'file = "d.csv", {PARTS[0]}', 'file = "d.csv", window = ["10 ms", "99 ms"]'),
            ["logs[1].repeat[2].window", "rows 4 to 18 would count twice", "do not overlap"],
        ),
        (
            tuple(f'file = "d.csv", name = "x", {part}' for part in PARTS),
            ["logs[1].repeat[2].name: a second log 'x'"],
        ),
    ],
)
def test_samples_count_once_and_a_name_is_one_log(
    tmp_path: Path, runs: tuple[str, ...], said: list[str]
) -> None:
    (tmp_path / "d.csv").write_text(text_of(LONG))
    with pytest.raises(UserError) as refused:
        describe(tmp_path, repeated(*runs))
    for words in said:
        assert words in str(refused.value)


def test_other_columns_of_the_same_rows_are_another_run(tmp_path: Path) -> None:
    twice = 'outputs.angle = { column = "u" }'
    told = describe(tmp_path, LOG + "repeat = [{}, { " + twice + " }]")
    assert names_of(told) == ["log 1", "log 2"]


def test_a_file_whose_name_looks_like_a_pattern_is_that_file(tmp_path: Path) -> None:
    recorded(tmp_path, "run[1].csv", "run1.csv")
    assert names_of(describe(tmp_path, entry("run[1].csv"))) == ["run[1]"]


def test_each_table_of_repeat_replaces_keys_of_the_entry(tmp_path: Path) -> None:
    recorded(tmp_path, "a.csv", "b.csv")
    runs = """repeat = [
        { file = "a.csv" },
        { file = "b.csv", held_out = true, name = "judge" },
        { window = ["0 s", "80 ms"] },
        { window = ["80 ms", "160 ms"] },
    ]"""
    told = describe(tmp_path, LOG + runs, data=text_of(LONG))
    assert names_of(told) == ["a", "judge", "log 3", "log 4"]
    assert [bool(log.held_out.all()) for log in told.logs] == [False, True, False, False]
    assert [log.begin for log in told.logs] == pytest.approx([0.0, 0.0, 0.0, 0.08])
    without = LOG.replace('file = "log.csv"\n', "") + 'repeat = [{ file = "?.csv" }]'
    assert names_of(describe(tmp_path, without)) == ["a", "b"]


def test_a_fault_in_one_of_many_files_names_it(tmp_path: Path) -> None:
    recorded(tmp_path, "a.csv", "b.csv")
    (tmp_path / "b.csv").write_text((tmp_path / "b.csv").read_text().replace("105.0", "late"))
    assert "b.csv', row 3, column 'time_ms': 'late'" in complaint(tmp_path, log=entry("?.csv"))


def test_files_of_a_pattern_are_not_written_over(tmp_path: Path, run: Run) -> None:
    rows = [dict(zip(("time_ms", "u", "angle_deg"), row)) for row in TABLE]
    for name in ("a.json", "b.json"):
        (tmp_path / name).write_text(json.dumps(rows))
    path = tmp_path / "rig.toml"
    path.write_text(HEAD + entry("?.json"))
    assert len(read_description(path).logs) == 2
    assert set(named_files(path)) == {path, tmp_path / "a.json", tmp_path / "b.json"}
    code, _, err = run("diagnose", path, "--json", tmp_path / "b.json")
    assert code == 2
    assert "b.json" in err
    assert json.loads((tmp_path / "b.json").read_text()) == rows
