"""Bad recordings of robots: one sentence with the cure, and the other joints go on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.data.description import read_description
from tests.conftest import Run
from tests.support.bags import EPOCH, Message, bag, joint_state, ns, sampled
from tests.support.lerobot import data_set, episodes

Names = Sequence[str]
JOINTS = ("shoulder", "elbow")


def a_bag(folder: Path, names: Names = JOINTS, sent: Names = (), storage: str = "mcap") -> Path:
    """States of joints, and commands, of others if these are ``sent``."""

    def message(of: Names, time: float) -> Message:
        angles = [float(np.sin((2.0 + k) * time)) for k in range(len(of))]
        return ns(time), joint_state(EPOCH + ns(time), of, angles)

    topics = {"/joint_states": names, "/cmd": sent or names}
    messages = {it: sampled(partial(message, of), 0.01, 2.0) for it, of in topics.items()}
    return bag(folder / "rig", messages, storage)


def a_set(folder: Path, names: Names = JOINTS, sent: Names = (), frames: Any = (100,)) -> Path:
    both = {"action": sent or names, "observation.state": names}
    return data_set(folder / "rig", episodes(*frames), names=both)


def with_file(
    recording: Callable[[Path], Path], file: str, content: float | str | None
) -> Callable[[Path], Path]:
    """With that share of a file, with another text in it, or without it."""

    def make(folder: Path) -> Path:
        made = recording(folder)
        whole = (made / file).read_bytes()
        (made / file).unlink()
        if isinstance(content, str):
            (made / file).write_text(content)
        elif content is not None:
            (made / file).write_bytes(whole[: int(content * len(whole))])
        return made

    return make


def in_another_unit(folder: Path) -> Path:
    first, (action, state), third = episodes(100, 110, 105)
    odd = (np.radians(action), np.radians(state))
    return data_set(folder / "rig", [first, odd, third])


def in_sqlite3(folder: Path) -> Path:
    return a_bag(folder, storage="sqlite3")


BOTH = ["elbow", "shoulder"]
FRAMES, INFO = "data/chunk-000/file-000.parquet", "meta/info.json"
DAMAGED = "rig' is damaged, cut short or no bag of ROS 2: 'ros2 bag reindex' mends"
NO_INFO = "info.json' is no description of a data set: copy it again, or name a file"
NO_COMMAND = "shoulder: no description, since '/joint_states' has its reading and no topic its comm"
NONE = "rig' has no joint with a command and a reading: "
ROWS = [
    *((with_file(a_bag, "rig.mcap", share), DAMAGED, []) for share in (0.0, 0.3, 0.9)),
    *((with_file(in_sqlite3, "rig.db3", share), DAMAGED, []) for share in (0.0, 0.3, 0.9)),
    (with_file(a_bag, "metadata.yaml", ""), DAMAGED, []),
    (with_file(a_bag, "metadata.yaml", "a: ["), DAMAGED, []),
    (with_file(a_bag, "metadata.yaml", "rosbag2_bagfile_information: 3"), DAMAGED, []),
    (with_file(a_bag, "metadata.yaml", None), "is a folder, no description; begin one with", []),
    (lambda it: a_bag(it, ("x" * 20_000, "elbow")), "messages above 16 kB only: name their", []),
    (lambda it: a_bag(it, sent=["elbow"]), NO_COMMAND, ["elbow"]),
    (lambda it: a_bag(it, sent=["other"]), f"{NONE}{NO_COMMAND}", []),
    (lambda it: a_set(it, sent=["x", "elbow"]), "shoulder: no description, since", ["elbow"]),
    (lambda it: a_set(it, sent=["x", "y"]), f"{NONE}shoulder: no description", []),
    (with_file(a_set, INFO, None), "joints have numbers: copy the data set whole", ["0", "1"]),
    *((with_file(a_set, INFO, it), NO_INFO, []) for it in ("", "[]", '{"fps": "x"}', "[" * 9999)),
    (with_file(a_set, FRAMES, 0.9), "file-000.parquet' is damaged or no Parquet file: wri", []),
    (with_file(a_set, FRAMES, None), "rig' has no frames: there is no file", []),
    (in_another_unit, "episode 1 left out: its joints reach 1.66 and those of the others 9", BOTH),
    (lambda it: a_set(it, frames=(100, 0, 3)), "episodes 1, 2 left out: fewer", BOTH),
    (lambda it: a_set(it, frames=(0,)), f"{NONE}episode 0 left out: fewer than 16", []),
]


@pytest.mark.parametrize(("make", "said", "left"), ROWS, ids=[said[-24:] for _, said, _ in ROWS])
def test_it_is_told_and_the_other_joints_go_on(
    run: Run, tmp_path: Path, make: Callable[[Path], Path], said: str, left: list[str]
) -> None:
    path = make(tmp_path)
    code, out, err = run("check", path, "--init")
    assert said in out + err
    assert (code == 2) == (not left)
    assert left or err.count("\n") == 1
    assert "usable" not in out + err
    written = sorted(tmp_path.glob("**/*.toml"))
    assert [file.stem.removeprefix("rig_") for file in written] == left
    for file in written:
        assert read_description(file).logs


NAMES = {
    "path traversal": (("../../evil", "elbow"), ("evil", "elbow")),
    "a path": (("/etc/passwd", "elbow"), ("etc_passwd", "elbow")),
    "lines of TOML": (('a"\n[[logs]]\nfile = "b', "elbow"), ("a_logs_file_b", "elbow")),
    "escapes": (("\x1b[31m\u202ered\x7f", "elbow"), ("31m_red", "elbow")),
    "another script": (("Größe 手", "elbow"), ("Größe_手", "elbow")),
    "no letter": (("", "."), ("joint", "joint_2")),
    "10 000 letters": (("x" * 10_000, "elbow"), ("x" * 60, "elbow")),
    "letters of three bytes": (("手" * 5000, "elbow"), ("手" * 20, "elbow")),
    "one name of a file": (("a/b", "a_b"), ("a_b", "a_b_2")),
    "capitals": (("Elbow", "elbow"), ("Elbow", "elbow_2")),
    "composed letters": (("e\u0301", "\u00e9"), ("\u00e9", "\u00e9_2")),
}


@pytest.mark.parametrize("recording", [a_bag, a_set])
@pytest.mark.parametrize(("names", "files"), NAMES.values(), ids=NAMES)
def test_hostile_names_stay_text(
    run: Run,
    tmp_path: Path,
    recording: Callable[..., Path],
    names: tuple[str, str],
    files: tuple[str, str],
) -> None:
    folder = tmp_path / "in" / "here"
    folder.mkdir(parents=True)
    code, out, err = run("check", recording(folder, names), "--init")
    assert (code, err) == (0, "")
    assert all(sign == "\n" or sign.isprintable() for sign in out)
    assert max(map(len, out.splitlines())) < 4096
    written = set(tmp_path.glob("**/*.toml"))
    assert written == {folder / f"rig_{file}.toml" for file in files}
    for file in written:
        (log,) = read_description(file).logs
        assert len(log.times) > 90
