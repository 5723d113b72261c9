"""Which jobs a path holds."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import pytest

from servo_models.errors import UserError
from servo_models.survey.plan import counted, plan
from servo_models.survey.store import key_of
from tests.support import lerobot
from tests.support.sources import ROOT

GIMBAL = ROOT / "examples/gimbal"
CSV = "time [s],voltage [V],angle [deg]\n" + "".join(
    f"{0.01 * k:.2f},{1.0 if k > 20 else 0.0},{0.1 * max(0, k - 20):.3f}\n" for k in range(100)
)


def named(path: Path, out: Path) -> list[tuple[str, str]]:
    return [(job.unit, job.joint) for job in plan(path, out).jobs]


def test_a_folder_gives_its_descriptions_and_the_logs_that_none_names(tmp_path: Path) -> None:
    fleet, out = tmp_path / "fleet", tmp_path / "out"
    for unit in ("unit_1", "unit_2"):
        shutil.copytree(GIMBAL, fleet / unit)
    (fleet / "spare.csv").write_text(CSV)
    (fleet / ".hidden").mkdir()
    (fleet / ".hidden" / "old.csv").write_text(CSV)
    jobs = plan(fleet, out, "dc_motor").jobs
    assert [(job.unit, job.joint) for job in jobs] == [
        ("unit_1", "gimbal"),
        ("unit_2", "gimbal"),
        ("fleet", "spare"),
    ]
    assert jobs[2].description == out / "descriptions" / "fleet" / "spare.toml"


def test_a_survey_inside_of_its_folder_is_none_of_its_jobs(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV)
    out = tmp_path / "found"
    first = plan(tmp_path, out, "dc_motor").jobs
    assert plan(tmp_path, out, "dc_motor").jobs == first
    assert len(first) == 1
    (out / "jobs").mkdir()
    (out / "jobs" / f"{64 * 'a'}.json").touch()
    assert len(plan(tmp_path, tmp_path / "other", "dc_motor").jobs) == 1


def test_a_description_that_was_corrected_by_hand_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV)
    (job,) = plan(tmp_path / "a.csv", tmp_path / "out", "dc_motor").jobs
    corrected = job.description.read_text("utf-8") + "# looked at\n"
    job.description.write_text(corrected, encoding="utf-8")
    (again,) = plan(tmp_path / "a.csv", tmp_path / "out", "dc_motor").jobs
    assert again.description.read_text("utf-8") == corrected
    assert key_of(again, {}) != ""


def test_a_variant_is_told_with_its_actuator(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV.replace("voltage [V]", "goal [deg]"))
    lerobot.data_set(tmp_path / "robot", lerobot.episodes(120))
    jobs = plan(tmp_path, tmp_path / "out", "smart_servo:sts3215").jobs
    texts = [job.description.read_text("utf-8").splitlines() for job in jobs]
    assert len(texts) == 3
    told = ['actuator = "smart_servo"', 'variant = "sts3215"']  # neither with a doubt
    assert all(lines[1:3] == told for lines in texts)
    (job,) = plan(tmp_path / "a.csv", tmp_path / "none", "smart_servo:sts3216").jobs
    assert "unknown variant 'sts3216' in actuator 'smart_servo'; did you mean" in job.failure


def test_two_logs_of_one_name_are_two_joints(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV)
    (tmp_path / "a.txt").write_text(CSV)
    jobs = plan(tmp_path, tmp_path / "out", "dc_motor").jobs
    assert len({job.description for job in jobs}) == len({job.joint for job in jobs}) == 2


def test_rows_of_a_table_with_one_unit_and_joint_are_runs_of_one_description(
    tmp_path: Path,
) -> None:
    for name in "abcd":
        (tmp_path / f"{name}.csv").write_text(CSV)
    (tmp_path / "fleet.csv").write_text(
        "log,unit,joint,firmware,day\n"
        "a.csv,7,tilt,2.1,1\nb.csv,7,tilt,2.1,2\nc.csv,7,tilt,2.1,2\nd.csv,8,tilt,2.0,1\n"
    )
    found = plan(tmp_path / "fleet.csv", tmp_path / "out", "dc_motor")
    one, other = found.jobs
    assert (one.unit, one.joint, one.conditions) == ("7", "tilt", {"firmware": "2.1"})
    assert (other.unit, other.conditions) == ("8", {"firmware": "2.0", "day": "1"})
    assert "7 tilt: 'day' differs between its logs and is left out" in found.notes
    text = one.description.read_text("utf-8")
    assert text.count("file = ") == 3
    assert text.count("held_out = true") == 1


def test_a_recording_is_a_unit_or_that_of_its_row(tmp_path: Path) -> None:
    robots = tmp_path / "robots"
    lerobot.data_set(robots / "lab" / "day.1", lerobot.episodes(120))
    joints = ("elbow", "shoulder")
    assert named(robots, tmp_path / "one") == [("lab/day.1", joint) for joint in joints]
    table = tmp_path / "fleet.csv"
    table.write_text("log,unit,firmware\nrobots/lab/day.1,7,2.1\n")
    jobs = plan(table, tmp_path / "two").jobs
    assert [(job.unit, job.joint, job.conditions) for job in jobs] == [
        ("7", joint, {"firmware": "2.1"}) for joint in joints
    ]


def test_units_whose_names_are_alike_as_folders_stay_apart(tmp_path: Path) -> None:
    for unit in ("a b", "a_b"):
        (tmp_path / "fleet" / unit).mkdir(parents=True)
        (tmp_path / "fleet" / unit / "tilt.csv").write_text(CSV)
    jobs = plan(tmp_path / "fleet", tmp_path / "out", "dc_motor").jobs
    assert [(job.unit, job.joint) for job in jobs] == [("a b", "tilt"), ("a_b", "tilt")]
    for job in jobs:
        assert f"/fleet/{job.unit}/tilt.csv" in job.description.read_text("utf-8")


def test_a_log_that_says_nothing_is_left_out_of_its_joint(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / f"{name}.csv").write_text(CSV)
    still = "".join(line.rpartition(",")[0] + ",0\n" for line in CSV.splitlines()[1:])
    (tmp_path / "still.csv").write_text(CSV.splitlines()[0] + "\n" + still)
    rows = "".join(f"{name}.csv,7,tilt\n" for name in ("a", "still", "b"))
    (tmp_path / "fleet.csv").write_text(f"log,unit,joint\n{rows}")
    found = plan(tmp_path / "fleet.csv", tmp_path / "out", "dc_motor")
    assert found.jobs[0].description.read_text("utf-8").count("file = ") == 2
    (note,) = (note for note in found.notes if "left out" in note)
    assert "'still.csv' is left out, since" in note
    assert "constant over the log" in note


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda at: None, "has nothing to diagnose"),
        (lambda at: (at / "notes.md").write_text("none"), "has nothing to diagnose"),
        (lambda at: at.rmdir(), "name a folder"),
    ],
)
def test_what_holds_no_job_is_refused(tmp_path: Path, make: object, says: str) -> None:
    fleet = tmp_path / "fleet"
    fleet.mkdir()
    make(fleet)  # type: ignore[operator]
    with pytest.raises(UserError, match=says):
        plan(fleet, tmp_path / "out")


def test_what_cannot_be_read_is_a_job_that_failed_and_the_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(CSV)
    (tmp_path / "b.csv").write_bytes(b"\x00\xff" * 50)
    (tmp_path / "c.toml").write_text("[[logs]\n")
    jobs = {job.joint: job for job in plan(tmp_path, tmp_path / "out", "dc_motor").jobs}
    assert not jobs["a"].failure
    assert "b.csv" in jobs["b"].failure
    assert jobs["c"].description.name == "c.toml"  # which says what is wrong when it is read


def test_a_key_changes_with_all_that_a_job_depends_on(tmp_path: Path) -> None:
    shutil.copytree(GIMBAL, tmp_path / "one")
    shutil.copytree(GIMBAL, tmp_path / "two")
    one, two = (plan(tmp_path / name, tmp_path / "out").jobs[0] for name in ("one", "two"))
    known = key_of(one, {"seed": 0})
    assert key_of(one, {"seed": 1}) != known
    assert key_of(two, {"seed": 0}) != known  # another unit
    log = tmp_path / "one" / "log.csv"
    before = log.read_bytes()
    log.write_bytes(before + b"\n")
    assert key_of(one, {"seed": 0}) != known
    log.write_bytes(before)
    assert key_of(one, {"seed": 0}) == known
    description = one.description.read_bytes()
    one.description.write_bytes(description + b"\n")
    assert key_of(one, {"seed": 0}) != known


def test_how_far_a_long_look_has_come_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[counted.__module__], "TELL_SECONDS", -1.0)
    said: list[str] = []
    assert [*counted("ab", lambda *words: said.append(words[-1]), "looked at")] == ["a", "b"]
    assert said == ["looked at: 0 of 2", "looked at: 1 of 2"]
