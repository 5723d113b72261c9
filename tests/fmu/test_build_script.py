"""``build_fmu.py`` in a pipe: what it says and when, and which files it writes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from servo_models.build import kinds_for
from tests.support.own_actuators import WITH_EFFECTS, write

SCRIPT = Path(__file__).parents[2] / "build_fmu.py"


def build_fmu(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.thorough
def test_one_actuator_is_summed_up_first_and_reported_apart(tmp_path: Path) -> None:
    write(tmp_path, changes=WITH_EFFECTS)
    (tmp_path / "fmus").mkdir()
    others = tmp_path / "fmus" / "report.html"
    others.write_text("of all FMUs")
    done = build_fmu(tmp_path, "--actuator", "joint.py")
    lines = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    built = ["joint.fmu", *(f"joint.{kind}.fmu" for kind in kinds_for("fmus", native=False)[1:])]
    assert lines[: len(built)] == [f"fmus/{name}" for name in built]
    assert lines[len(built)].startswith("PASSED: all ")
    assert lines[-1] == "report: fmus/joint.html"
    assert others.read_text() == "of all FMUs"
    assert {path.name for path in others.parent.iterdir()} == {
        *("report.html", "joint.html", *built)
    }
    jobs = done.stderr.splitlines()
    assert len(jobs) > 2
    for number, line in enumerate(jobs, start=1):
        assert line.startswith(f"{number} of {len(jobs)}: joint")
    assert max(map(len, [*lines, *jobs])) <= 80


@pytest.mark.thorough
def test_out_may_name_the_file(tmp_path: Path) -> None:
    write(tmp_path, changes=WITH_EFFECTS)
    done = build_fmu(tmp_path, "--actuator", "joint.py", "--out", "mine/arm.fmu")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0] == "mine/arm.fmu"
    assert {path.name for path in (tmp_path / "mine").iterdir()} == {"arm.fmu", "arm.html"}


@pytest.mark.parametrize("words", [["--out", "all.fmu"], ["--variant", "linear"]])
def test_what_belongs_to_one_actuator_is_refused_without_it(
    words: list[str], tmp_path: Path
) -> None:
    done = build_fmu(tmp_path, *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert "name it" in done.stderr
    assert list(tmp_path.iterdir()) == []
