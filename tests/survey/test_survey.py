"""Surveys that are killed, shared, spoiled: what is done is kept, and the rest goes on."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import polars as pl
import pytest

from servo_models import survey
from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.survey import engine, job, store
from servo_models.survey.store import Store, read_outcome
from tests.conftest import Run
from tests.support.sources import ROOT

GIMBAL = ROOT / "examples/gimbal"
BROKEN = 'actuator = "dc_motor"\n[[logs]]\nfile = "gone.csv"\n'
"""Fails at once, and is kept like any other."""
CRASHES = """
import os, time
{what}
"""


def broken(folder: Path, count: int) -> Path:
    for k in range(count):
        unit = folder / f"unit_{k}"
        unit.mkdir(parents=True)
        (unit / "joint.toml").write_text(BROKEN)
    return folder


def kept(out: Path) -> dict[str, str]:
    files = sorted((out / "jobs").glob("*.json"))
    return {file.stem: getattr(read_outcome(file), "unit", "half") for file in files}


def test_broken_logs_are_rows_and_the_rest_finishes(tmp_path: Path, run: Run) -> None:
    fleet = broken(tmp_path / "fleet", 3)
    shutil.copytree(GIMBAL, fleet / "whole")
    options = ("--no-reports", "--jobs", "2", "--trust", "--out", tmp_path / "out")
    code, _, _ = run("survey", fleet, *options)
    assert code == 1
    table = pl.read_csv(tmp_path / "out" / "table.csv")
    assert table["verdict"].to_list() == ["failed", "failed", "failed", "effect"]
    assert all("logs[1].time: missing" in text for text in table["failure"][:3])
    assert table["causes"][3] == "drive_dead_zone"
    assert pl.read_parquet(tmp_path / "out" / "table.parquet")["key"].n_unique() == 4


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ("os._exit(3)", "exit code 3"),
        ("os.kill(os.getpid(), 11)", "by signal 11"),
        pytest.param("time.sleep(600)", "does not answer within", marks=pytest.mark.long),
    ],
)
def test_a_job_that_crashes_or_hangs_ends_alone(
    tmp_path: Path, what: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from servo_models.survey import engine

    monkeypatch.setattr(engine, "GRACE_SECONDS", 20.0)
    fleet = broken(tmp_path / "fleet", 1)
    (fleet / "unit_1").mkdir()
    (fleet / "unit_1" / "own.py").write_text(CRASHES.format(what=what))
    text = BROKEN.replace("dc_motor", "own.py")
    (fleet / "unit_1" / "joint.toml").write_text(text)
    found = survey(fleet, tmp_path / "out", jobs=1, reports=False, time_limit=1.0, trust=True)
    first, second = found.outcomes
    assert "logs[1].time: missing" in first.failure
    assert says in second.failure


def test_a_time_limit_ends_the_fits_of_single_logs_as_well() -> None:
    limited = job.Job("a", "gimbal", GIMBAL / "gimbal.toml", options={"time_limit": 1e-9})
    done = job.run(limited)
    kept = msgspec.json.decode(done.kept)
    assert kept["verdict"]
    assert not kept["episodes"]
    assert kept["warnings"][-1] == "no time was left to fit 1 log alone"
    assert b"<title>a, gimbal: " in done.page  # which no other unit has


SERVO = """
actuator = "second_order_servo"
variant = "bus"
[[logs]]
file = "{0}.csv"
start = "rest"
time = {{ column = "t", unit = "s" }}
inputs.goal = {{ column = "goal", unit = "rad" }}
outputs.angle = {{ column = "angle", unit = "rad" }}
"""


def follow(times: Array, delay: float, pitch: float, random: np.random.Generator) -> Array:
    """Steps of a goal at irregular rows, and the exact angle of a servo with a damping of 0.8."""
    rows = np.cumsum(random.integers(17, 53, size=16))
    steps = [(times[row], random.uniform(-0.1, 0.1)) for row in rows if row < len(times)]
    goal, angle = np.zeros_like(times), 2e-4 * random.standard_normal(len(times))
    for begin, size in steps:
        goal += size * (times >= begin)
        since = pitch * np.maximum(times - begin - delay, 0.0)
        swing = np.cos(0.6 * since) + 0.8 / 0.6 * np.sin(0.6 * since)
        angle += size * (1.0 - np.exp(-0.8 * since) * swing)
    return np.column_stack([times, goal, angle])


@pytest.mark.thorough
def test_a_firmware_that_is_late_is_named_where_the_model_has_a_delay(tmp_path: Path) -> None:
    """By 1.4 rows, of a servo whose delay is a parameter that nobody knows well."""
    random, table = np.random.default_rng(8), ["log,unit,joint,firmware"]
    for k in range(5):
        delay, pitch = 0.024 if k < 2 else 0.01, 30.0 + random.standard_normal()
        log = follow(np.arange(0.0, 5.0, 0.01), delay, pitch, random)
        np.savetxt(tmp_path / f"{k}.csv", log, "%.9g", ",", header="t,goal,angle", comments="")
        (tmp_path / f"{k}.toml").write_text(SERVO.format(k))
        table.append(f"{k}.toml,unit {k},tilt,{'new' if k < 2 else 'old'}")
    (tmp_path / "fleet.csv").write_text("\n".join(table))
    found = survey(tmp_path / "fleet.csv", tmp_path / "out", jobs=2, reports=False)
    (late,) = found.belongings
    assert (late.name, late.whose) == ("transport_delay.time", "firmware = new")
    assert late.places == [("unit 0", "tilt"), ("unit 1", "tilt")]
    assert late.size
    assert late.size.mean == pytest.approx(0.024, abs=3e-4)
    told = found.estimates().filter(pl.col("episode").is_null(), name="transport_delay.time")
    assert told["value"].to_numpy() == pytest.approx([0.024] * 2 + [0.01] * 3, abs=3e-4)
    (common,) = (it for it in found.common("tilt").estimates if it.name == late.name)
    assert common.value == pytest.approx(0.01, abs=3e-4)


def test_parameters_that_units_have_in_common_are_a_file_for_the_other_commands(
    tmp_path: Path, run: Run
) -> None:
    for unit in "ab":
        shutil.copytree(GIMBAL, tmp_path / "fleet" / unit)
    survey(tmp_path / "fleet", tmp_path / "out", jobs=2, reports=False, trust=True)
    common = tmp_path / "out" / "common" / "gimbal.toml"
    code, out, _ = run("explain", "--params", common, "--trust")
    assert code == 0
    assert "drive_dead_zone" in out  # which both have, so that it belongs to the model


def test_where_results_go_and_what_is_guessed_is_told_before_work(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time [s],voltage [V],angle [deg]\n0,0,0\n0.1,1,0\n0.2,1,1\n")
    out, said = tmp_path / "out", list[str]()
    survey(tmp_path / "a.csv", out, "dc_motor", tell=lambda text, *_: said.append(text))
    assert said[0].endswith(f"what is found goes to '{out}'")
    assert (
        said[1] == f"1 description of ours in '{out}/descriptions': look at what is guessed there"
    )


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    fleet, out = broken(tmp_path / "fleet", 3), tmp_path / "out"
    survey(fleet, out, jobs=1)
    stamps = {file: file.stat().st_mtime_ns for file in (out / "jobs").iterdir()}
    (fleet / "unit_1" / "joint.toml").write_text(f"{BROKEN}\n# corrected")
    said: list[str] = []
    survey(fleet, out, jobs=1, tell=lambda text, *_: said.append(text))
    assert "2 done (2 failed), 1 to do on 1 processor, seconds to tens of minutes each" in said[1]
    assert len(kept(out)) == 4
    assert all(file.stat().st_mtime_ns == stamp for file, stamp in stamps.items())


def test_a_condition_that_is_told_later_does_nothing_anew(tmp_path: Path) -> None:
    broken(tmp_path / "fleet", 2)
    table, out = tmp_path / "fleet" / "joints.csv", tmp_path / "out"
    table.write_text("log,unit\nunit_0/joint.toml,0\nunit_1/joint.toml,1\n")
    survey(table, out, jobs=1)
    before = kept(out)
    table.write_text("log,unit,firmware\nunit_0/joint.toml,0,2.0\nunit_1/joint.toml,1,2.1\n")
    found = survey(table, out, jobs=1)
    assert kept(out) == before
    assert found.table()["firmware"].to_list() == ["2.0", "2.1"]


@pytest.mark.parametrize(("limit", "words"), [(30.0, ""), (None, "; with --time-limit 60s")])
def test_how_long_it_takes_at_most_is_told_before_work(
    tmp_path: Path, limit: float | None, words: str
) -> None:
    said: list[str] = []
    fleet, out = broken(tmp_path / "fleet", 5), tmp_path / "out"
    survey(fleet, out, jobs=2, time_limit=limit, tell=lambda text, *_: said.append(text))
    most = "at most about 9 min" if limit is None else ", at most about 4.5 min"
    assert said[1].endswith(f"{words} {most}".strip())  # three in turn, each three times the limit


def test_how_long_it_takes_is_told_by_what_was_done(tmp_path: Path) -> None:
    fleet, out = broken(tmp_path / "fleet", 3), tmp_path / "out"
    survey(fleet, out, jobs=1)
    whole, other, _ = (out / "jobs").iterdir()
    other.unlink()
    done = read_outcome(whole)
    assert done
    done = msgspec.structs.replace(done, failure="", seconds=120.0)
    whole.write_bytes(msgspec.json.encode(done))
    said: list[str] = []
    survey(fleet, out, jobs=1, tell=lambda text, *_: said.append(text))
    assert said[1].endswith("2 done (1 failed), 1 to do, about 2 min on 1 processor")


def test_a_killed_survey_goes_on_where_it_was(tmp_path: Path) -> None:
    fleet, out = broken(tmp_path / "fleet", 40), tmp_path / "out"
    words = [sys.executable, "-m", "servo_models", "survey", str(fleet), "--out", str(out)]
    process = subprocess.Popen([*words, "--jobs", "1"], stderr=subprocess.DEVNULL)
    while len(kept(out)) < 5 and process.poll() is None:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = kept(out)
    assert 5 <= len(before) < 40
    assert "half" not in before.values()
    survey(fleet, out, jobs=1)
    assert sorted(kept(out).values()) == sorted(f"unit_{k}" for k in range(40))
    assert before.items() <= kept(out).items()
    assert not list(out.rglob("*.part"))


def test_several_surveys_share_a_folder_and_do_each_job_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet, out = broken(tmp_path / "fleet", 20), tmp_path / "out"
    written: list[str] = []
    whole = store.write_whole
    monkeypatch.setattr(
        store,
        "write_whole",
        lambda path, content: (written.append(path.stem), whole(path, content)),
    )
    results: list[int] = []

    def run() -> None:
        results.append(len(survey(fleet, out, jobs=1).outcomes))

    threads = [threading.Thread(target=run) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [20, 20]
    assert sorted(written) == sorted(kept(out))


def test_a_damaged_result_is_made_again(tmp_path: Path) -> None:
    fleet, out = broken(tmp_path / "fleet", 2), tmp_path / "out"
    survey(fleet, out, jobs=1)
    damaged, other = sorted((out / "jobs").iterdir())
    damaged.write_bytes(damaged.read_bytes()[:40])
    before = other.read_bytes()
    survey(fleet, out, jobs=1)
    assert read_outcome(damaged)
    assert other.read_bytes() == before


def test_a_full_disk_is_told_and_what_was_done_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet, out = broken(tmp_path / "fleet", 4), tmp_path / "out"
    whole, count = store.write_whole, iter(range(100))

    def full(path: Path, content: bytes) -> None:
        if next(count) >= 2:
            raise UserError(f"cannot write '{path}': {os.strerror(errno.ENOSPC)}")
        whole(path, content)

    monkeypatch.setattr(store, "write_whole", full)
    with pytest.raises(UserError, match="No space left"):
        survey(fleet, out, jobs=1)
    assert len(kept(out)) == 2
    monkeypatch.undo()
    assert len(survey(fleet, out, jobs=1).outcomes) == 4


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root writes anywhere")
def test_a_folder_that_may_not_be_written_is_refused_before_work(tmp_path: Path) -> None:
    fleet = broken(tmp_path / "fleet", 1)
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(UserError, match="choose a folder that you may write"):
            survey(fleet, tmp_path / "out")
    finally:
        tmp_path.chmod(0o700)


def test_a_folder_that_is_a_file_is_refused_before_work(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(UserError, match="cannot write"):
        survey(broken(tmp_path / "fleet", 1), tmp_path / "out")


def test_a_survey_of_before_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no survey"):
        survey(broken(tmp_path / "fleet", 1), tmp_path / "out", before=tmp_path)


def test_a_claim_ends_with_its_process(tmp_path: Path) -> None:
    keep = Store(tmp_path)
    code = (
        "import sys; from pathlib import Path; from servo_models.survey.store import Store\n"
        "claim = Store(Path(sys.argv[1])).claimed('a'); print(claim.__enter__(), flush=True)\n"
        "sys.stdin.read()"
    )
    words = [sys.executable, "-c", code, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"True\n"
        with keep.claimed("a") as ours:
            assert not ours
        process.kill()
    with keep.claimed("a") as ours:
        assert ours


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    distributed = pytest.importorskip("distributed")
    local = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    )
    yield local
    local.close()


@pytest.mark.thorough
def test_a_cluster_gives_the_same_table_to_the_last_digit(tmp_path: Path, cluster: object) -> None:
    fleet = broken(tmp_path / "fleet", 2)
    shutil.copytree(GIMBAL, fleet / "whole")
    address = cluster.scheduler_address  # type: ignore[attr-defined]
    far = survey(fleet, tmp_path / "far", scheduler=address, reports=False, trust=True)
    near = survey(fleet, tmp_path / "near", jobs=2, reports=False, trust=True)
    for one, other in ((far.table(), near.table()), (far.estimates(), near.estimates())):
        columns = [name for name in one.columns if name != "seconds"]
        assert one.select(columns).equals(other.select(columns))


@pytest.mark.thorough
def test_a_worker_killed_in_mid_run_costs_nothing(tmp_path: Path, cluster: object) -> None:
    fleet = broken(tmp_path / "fleet", 30)
    local = cluster
    pids = [worker.pid for worker in local.workers.values()]  # type: ignore[attr-defined]
    killed: list[int] = []

    def tell(text: str, done: int = 0, every: int | None = None) -> None:
        if done == 5 and not killed:
            killed.append(pids[0])
            os.kill(pids[0], signal.SIGKILL)

    address = local.scheduler_address  # type: ignore[attr-defined]
    found = survey(fleet, tmp_path / "out", scheduler=address, tell=tell)
    assert killed
    assert {one.unit for one in found.outcomes} == {f"unit_{k}" for k in range(30)}


@pytest.mark.thorough
def test_a_scheduler_that_is_gone_is_told_and_what_was_done_stays(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    fleet, out = broken(tmp_path / "fleet", 60), tmp_path / "out"
    local = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None
    )

    def tell(text: str, done: int = 0, every: int | None = None) -> None:
        if done == 5:
            local.close()

    with pytest.raises(UserError, match="is gone: what was done is kept"):
        survey(fleet, out, scheduler=local.scheduler_address, tell=tell)
    assert len(kept(out)) >= 5
    assert len(survey(fleet, out, jobs=1).outcomes) == 60


@pytest.mark.long
def test_a_scheduler_that_was_killed_is_told_in_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    about = tmp_path / "scheduler.json"
    words = ["-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    words += ["--no-dashboard", "--scheduler-file", str(about)]
    with subprocess.Popen([sys.executable, *words], stderr=subprocess.DEVNULL) as scheduler:
        while not about.exists():
            time.sleep(0.05)
        words = ["-m", "servo_models", "survey", str(broken(tmp_path / "fleet", 1))]
        words += ["--scheduler", json.loads(about.read_text())["address"]]
        with subprocess.Popen(
            [sys.executable, *words], stderr=subprocess.PIPE, text=True
        ) as surveying:
            assert surveying.stderr is not None
            while "to do on the cluster" not in surveying.stderr.readline():
                pass
            time.sleep(5.0)
            scheduler.kill()
            told = surveying.stderr.read()
    assert told.startswith("servo-models: the scheduler at")
    assert len(told.splitlines()) == 1


def test_no_scheduler_there_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(engine, "CONNECT_SECONDS", 1.0)
    with pytest.raises(UserError, match="no scheduler of Dask at"):
        survey(broken(tmp_path / "fleet", 1), tmp_path / "out", scheduler="tcp://127.0.0.1:1")
