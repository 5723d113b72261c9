"""LeRobot data sets of v2 and v3: lists by name, an episode is a run, a description a joint."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from servo_models.data.scaffold import draft
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.lerobot import FPS, JOINTS, LATE, data_set, episodes

VERSIONS = ("v2.1", "v3.0")
FILES = {"v2.1": "data/chunk-000/episode_000001.parquet", "v3.0": "data/chunk-000/file-000.parquet"}
ELBOW = """actuator = "second_order_servo"
variant = "bus"
[[logs]]
file = "{file}"
time = "timestamp"
inputs.goal = {{ column = "action.elbow.pos", unit = "deg" }}
outputs.angle_reading = {{ column = "observation.state[1]", unit = "deg" }}
{more}
"""


def elbow(folder: Path, file: str = "set", more: str = "") -> Path:
    path = folder / "elbow.toml"
    path.write_text(ELBOW.format(file=file, more=more))
    return path


def complaint(path: Path) -> str:
    with pytest.raises(UserError) as caught:
        read_description(path)
    return str(caught.value)


# Lists


@pytest.mark.parametrize("kind", [pl.List(pl.Float64), pl.Array(pl.Float64, 3)])
def test_items_of_lists_are_columns(tmp_path: Path, kind: pl.DataType) -> None:
    values = np.random.default_rng(1).standard_normal((20, 3))
    path = tmp_path / "log.parquet"
    frame = {"t": np.arange(20.0), "action": pl.Series(values.tolist(), dtype=kind)}
    pl.DataFrame(frame).write_parquet(path)
    columns = read_columns(path)
    assert columns.names == ("t", "action[0]", "action[1]", "action[2]")
    for name in ("action[2]", "action.2", 4):
        assert np.array_equal(columns.numbers(name), values[:, 2])


def test_a_shorter_list_has_empty_items(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    pl.DataFrame({"q": [[1, 2], [3], None], "words": [["a"], [], ["b"]]}).write_parquet(path)
    columns = read_columns(path)
    assert list(columns.numbers("q[0]", slice(0, 2))) == [1.0, 3.0]
    with pytest.raises(UserError, match=r"row 2, column 'q\[1\]' is empty"):
        columns.numbers("q[1]")
    with pytest.raises(UserError, match=r"'words' holds List.*: give numbers"):
        columns.numbers("words")


@pytest.mark.parametrize(
    ("names", "first"),
    [
        (list("ab"), "action.a"),
        ({"motors": list("ab")}, "action.a"),
        ({"a": 0, "b": 1}, "action.a"),
        (list("abc"), "action[0]"),
        (list("aa"), "action[0]"),
        ("ab", "action[0]"),
        (None, "action[0]"),
    ],
)
def test_names_of_items_are_those_of_info_json(tmp_path: Path, names: object, first: str) -> None:
    folder = data_set(tmp_path / "set", episodes(20), names={"action": names})
    columns = read_columns(folder / FILES["v3.0"])
    assert columns.names[0] == first
    assert columns.index(first) == columns.index("action[0]") == columns.index("action.0") == 0


def test_counts_of_episodes_are_no_signals(tmp_path: Path) -> None:
    """They step as a command does, and nothing else here is called one."""
    steps = np.repeat([0, 3, 1, 2, 5], 40)
    columns = {"time_s": 0.02 * np.arange(200), "angle_deg": np.sin(0.1 * np.arange(200))}
    for name in ("episode_index", "task_index", "index", "frame_index"):
        path = tmp_path / f"{name}.csv"
        pl.DataFrame({**columns, name: steps}).write_csv(path)
        made = draft(path, "sg90")
        assert [match.column.key for match in made.matches] == ["angle_deg"]
        assert f'not used, it counts rows, or runs of them: "{name}"' in made.not_used


# Episodes


@pytest.mark.parametrize("version", VERSIONS)
def test_an_episode_is_a_run(tmp_path: Path, version: str) -> None:
    recorded = episodes(40, 50, 60, 45)
    data_set(tmp_path / "set", recorded, version)
    more = "repeat = [{ episode = [2, 0] }, { episode = 3, held_out = true }]"
    told = read_description(elbow(tmp_path, more=more))
    assert [log.name for log in told.logs] == ["set episode 2", "set episode 0", "set episode 3"]
    for log, number in zip(told.logs, (2, 0, 3)):
        action, state = recorded[number]
        assert log.times == pytest.approx(np.arange(len(action)) / FPS, abs=1e-4)
        assert np.degrees(log.inputs["goal"]) == pytest.approx(action[:, 1], abs=1e-4)
        assert np.degrees(log.outputs["angle_reading"]) == pytest.approx(state[:, 1], abs=1e-4)
        assert list(log.rows) == list(range(len(action)))
        assert log.held_out.all() == log.held_out.any() == (number == 3)
    every = read_description(elbow(tmp_path)).logs
    assert [len(log.times) for log in every] == [40, 50, 60, 45]
    single = read_description(elbow(tmp_path, f"set/{FILES[version]}", "episode = 1")).logs
    assert [len(log.times) for log in single] == [50]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("episode = 7", "has no frames of episode 7; it has 0 to 1"),
        ('episode = "all"', "write for example episode = [0, 1]"),
        ("episode = [0, 0]", "would count twice"),
        ('table = "episode 0"', "is a data set; choose by 'episode = [0, 1]'"),
    ],
)
def test_an_episode_that_is_not_there_is_refused(tmp_path: Path, more: str, words: str) -> None:
    data_set(tmp_path / "set", episodes(40, 50))
    assert words in complaint(elbow(tmp_path, more=more))


def test_an_episode_of_no_data_set_is_refused(tmp_path: Path) -> None:
    pl.DataFrame({"timestamp": [0.0]}).write_parquet(tmp_path / "log.parquet")
    assert "is no LeRobot data set" in complaint(elbow(tmp_path, "log.parquet", "episode = 0"))
    assert "no file" in complaint(elbow(tmp_path, "absent", "episode = 0"))
    (tmp_path / "empty").mkdir()
    assert "meta/info.json" in complaint(elbow(tmp_path, "empty"))


def test_an_episode_in_two_files_is_refused(tmp_path: Path) -> None:
    chunk = data_set(tmp_path / "set", episodes(40, 50), "v2.1") / "data" / "chunk-000"
    (chunk / "copy.parquet").write_bytes((chunk / "episode_000001.parquet").read_bytes())
    assert "has episode 1, and so has" in complaint(elbow(tmp_path))


# A description for each joint


def init(run: Run, folder: Path, *more: str) -> tuple[int, str]:
    code, out, err = run("check", folder, "--init", *more)
    return code, out + err


@pytest.mark.parametrize("version", VERSIONS)
def test_a_description_a_joint_that_reads_back(run: Run, tmp_path: Path, version: str) -> None:
    recorded = episodes(200, 220, 210)
    folder = data_set(tmp_path / "set", recorded, version)
    code, out = init(run, folder)
    assert code == 0
    assert out.count(f"({LATE}.0 rows) later") == len(JOINTS)
    assert out.count("stamps are nominal, frame / 30 Hz") == 1
    assert out.count("before the robot clipped it") == 1
    for place, joint in enumerate(("shoulder", "elbow")):
        logs = read_description(tmp_path / f"set_{joint}.toml").logs
        travel = [np.abs(np.diff(state[:, place])).sum() for _, state in recorded]
        held_out = [log.name for log in logs if log.held_out.all()]
        assert held_out == [f"set episode {np.argmin(travel)}"]
        for log in logs:
            action, state = recorded[int(log.name.split()[-1])]
            assert np.degrees(log.inputs["goal"]) == pytest.approx(action[:, place], abs=1e-4)
            read = np.degrees(log.outputs["angle_reading"])
            assert read == pytest.approx(state[:, place], abs=1e-4)
    code, out = init(run, folder)
    assert code == 2
    assert "exists: edit it, remove it, or name a folder with --out" in out
    code, out = init(run, folder / FILES[version], "--out", str(tmp_path / "own"))
    assert code == 0
    assert sorted(file.name for file in (tmp_path / "own").iterdir()) == [
        "elbow.toml",
        "shoulder.toml",
    ]


def test_check_of_a_joint_tells_its_lag(run: Run, tmp_path: Path) -> None:
    data_set(tmp_path / "set", episodes(100))
    code, out, _ = run("check", elbow(tmp_path))
    assert code in (0, 1)
    assert re.search(rf"lag +angle_reading follows goal 13\d ms \({LATE}\.0 rows\) later", out)
    silent = elbow(tmp_path)
    text = [line for line in silent.read_text().splitlines() if not line.startswith("inputs")]
    silent.write_text("\n".join(text))
    code, out, _ = run("check", silent)
    assert code == 1
    assert "usable" not in out


@pytest.mark.parametrize(
    ("scale", "unit", "words"),
    [
        (1.0, 'unit = "deg"', "degrees, or -100..100"),
        (np.pi / 180.0, 'unit = "rad"', "as in rad"),
        (1.7, 'unit = "deg"', "as in degrees"),
        (
            4096.0 / 360.0,
            'unit = "deg", scale = 0.087890625',
            "as counts with 4096 a turn",
        ),
    ],
)
def test_a_unit_is_guessed_and_a_doubt_is_a_question(
    run: Run, tmp_path: Path, scale: float, unit: str, words: str
) -> None:
    whole = scale > 10.0
    recorded = [
        (
            np.round(2048 * whole + scale * action, 0 if whole else 6),
            np.round(2048 * whole + scale * state, 0 if whole else 6),
        )
        for action, state in episodes(100)
    ]
    code, out = init(run, data_set(tmp_path / "set", recorded))
    assert code == 0
    assert out.count("guessed, the unit: ") == 1
    assert words in out
    text = (tmp_path / "set_elbow.toml").read_text()
    assert text.count(f"{unit} }}  # guessed: the unit") == 2
    assert words in text


def with_state(recorded: list[tuple[Array, Array]], joint: int, value: float) -> None:
    for _, state in recorded:
        state[:, joint] = value


def test_a_joint_that_cannot_be_described_leaves_the_others(run: Run, tmp_path: Path) -> None:
    recorded = episodes(100)
    with_state(recorded, 0, 5.0)
    code, out = init(run, data_set(tmp_path / "still", recorded))
    assert code == 1
    assert "Warning: shoulder: no description, since it stands still in every episode" in out
    recorded = episodes(100)
    recorded[0][0][7, 0] = np.inf
    code, out = init(run, data_set(tmp_path / "inf", recorded))
    assert code == 1
    assert "row 7, column 'action.shoulder.pos': 'inf' is not finite" in out
    names = {"action": ["gripper.pos", "elbow.pos"], "observation.state": list(JOINTS)}
    code, out = init(run, data_set(tmp_path / "names", episodes(100), names=names))
    assert code == 1
    assert "Warning: shoulder: no description, since a reading without a command" in out
    written = {file.name for file in tmp_path.glob("*.toml")}
    assert written == {"still_elbow.toml", "inf_elbow.toml", "names_elbow.toml"}


def test_a_few_cells_without_a_number_cost_their_rows(run: Run, tmp_path: Path) -> None:
    recorded = episodes(100)
    ((action, state),) = recorded
    sent, read = action[:, 0].copy(), state[:, 0].copy()
    action[7, 0] = state[20, 0] = np.nan
    assert init(run, data_set(tmp_path / "set", recorded))[0] == 0
    (log,) = read_description(tmp_path / "set_shoulder.toml").logs
    kept = np.delete(np.arange(100), 20)
    sent[7] = sent[6]
    assert np.degrees(log.inputs["goal"]) == pytest.approx(sent, abs=1e-4)
    readings = log.readings.outputs["angle_reading"]
    assert np.degrees(readings) == pytest.approx(read[kept], abs=1e-4)
    assert "missing" not in (tmp_path / "set_elbow.toml").read_text()


def test_an_action_that_is_no_goal_is_told(run: Run, tmp_path: Path) -> None:
    """An action may be a step from where the joint is, or the pose of a hand."""
    recorded = [(np.gradient(state, axis=0), state) for _, state in episodes(200)]
    code, out = init(run, data_set(tmp_path / "set", recorded))
    assert code == 1
    shares = [int(share) for share in re.findall(r"explains (\d+)% of its variance", out)]
    assert shares
    assert max(shares) < 75


def test_a_real_data_set(run: Run, logs_folder: Path, tmp_path: Path) -> None:
    """Its authors' arm lags by 4 to 5 frames, 130 to 165 ms; slow motions cannot tell more."""
    code, out = init(run, logs_folder / "lerobot_so101_v3", "--out", str(tmp_path))
    assert code == 0
    assert out.count("angle_reading follows goal") == 6
    late = [float(rows) for rows in re.findall(r"\((.+?) rows\) later", out)]
    body = json.loads((logs_folder / "lerobot_so101_v3/meta/info.json").read_text())
    assert len(late) == len(body["features"]["action"]["names"])
    assert all(3.5 < rows < 5.0 for rows in late)
