"""Files that came with somebody's data: no command runs one, unless the user has named it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable
from importlib.metadata import packages_distributions
from pathlib import Path
from urllib.request import Request, urlopen

import pytest

from servo_models import survey
from servo_models.cli import app
from tests.support.sources import ROOT

COMMAND = str(Path(sysconfig.get_path("scripts")) / "servo-models")
PLANTED = """\
with open({mark!r}, "a") as file:
    file.write(__file__ + "\\n")
raise ImportError(__file__)
"""
FOLDERS = ("here", "data", "out", "cache")  # the current one first
ROWS = {
    "list": "",
    "explain": "sg90 --diagram ../out/chain.svg",
    "explore": "../data/description.toml --out ../out/page.html --no-show",
    "new": "example ../out/servo.toml",
    "simulate": "sg90 --out ../out/step.csv --plot ../out/step.svg",
    "figures": "sg90 --plot ../out/figures.svg",
    "check": "../data/description.toml",
    "identify": "../data/description.toml --out ../out/fit.toml --report ../out/fit.html",
    "diagnose": "../data/description.toml --time-limit 1s --json ../out/gap.json",
    "rehearse": "../data/description.toml --jobs 2 --effects backlash --gap 3 --time-limit 1s",
    "survey": "../data --out ../out --jobs 2 --time-limit 1s --no-reports",
    "compare": "../data/GAP.toml --on ../data/bench.toml --report ../out/change.html",
    "sample": "../data/GAP.toml --out ../out/sets.csv",
    "export": "../data/GAP.toml --to ardupilot --out ../out/plane.parm",
    "import": "../data/plane.parm",
    "blind": "--cases 1 --seed 3 --tiers easy --jobs 1 --folder ../out/blind",
    "build": "sg90 --out ../out/sg90.fmu",
    "validate": "../data/sg90.fmu",
}
"""Words of each command; of each folder of ``FOLDERS`` some command reads or writes."""


OURS = {"servo_models", "fmu_src"}
OTHERS = {name for name in packages_distributions() if name.isidentifier()} - OURS
EVERY = {*OTHERS, *OURS, *sys.stdlib_module_names, "sitecustomize", "usercustomize"}
"""Names of modules that a command may import."""


def plant(folder: Path, mark: Path, names: set[str]) -> None:
    """Lay a file of each name, which leaves a mark where it is run."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / f"{name}.py").write_text(PLANTED.format(mark=str(mark)))


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory, fmu_file: Callable[[str], Path]) -> Path:
    """Data, with files planted beside them and in every other folder."""
    folder = tmp_path_factory.mktemp("planted")
    for name in FOLDERS:
        plant(folder / name, folder / "mark", EVERY)
    for file in ("two_csv_files/description.toml", "two_csv_files/steps.csv", "uav/GAP.toml"):
        shutil.copy(ROOT / "examples" / file, folder / "data")
    for file in ("two_csv_files/flight.csv", "uav/bench.toml", "uav/bench.csv"):
        shutil.copy(ROOT / "examples" / file, folder / "data")
    shutil.copy(fmu_file("sg90"), folder / "data")
    (folder / "data" / "plane.parm").write_text("SIM_SERVO_SPEED 0.1")
    return folder


def begun(place: Path, *words: str) -> subprocess.Popen[str]:
    known = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.Popen(
        words,
        cwd=place / FOLDERS[0],
        env=known | {"SERVO_MODELS_CACHE": str(place / "cache")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def none_ran(place: Path) -> None:
    mark = place / "mark"
    ran = mark.read_text() if mark.exists() else ""
    mark.unlink(missing_ok=True)
    assert not ran


def test_every_command_is_held_to_it() -> None:
    assert {command.name for command in app.registered_commands} == ROWS.keys()


@pytest.mark.thorough
@pytest.mark.parametrize("name", ROWS)
def test_no_command_runs_what_lies_in_its_folders(place: Path, name: str) -> None:
    with begun(place, COMMAND, name, *ROWS[name].split()) as run:
        said = run.communicate(timeout=600)[0]
    none_ran(place)
    assert run.returncode in (0, 1), said


@pytest.mark.thorough
def test_no_button_of_a_page_runs_it(place: Path) -> None:
    words = ("explore", "../data/description.toml", "--serve", "--no-show", "--out", "../out")
    with begun(place, COMMAND, *words) as run:
        try:
            assert run.stdout
            url = next(line for line in run.stdout if "http" in line).split()[1]
            head = {"Origin": url.rpartition("/")[0].rpartition("/")[0]}
            urlopen(Request(f"{url}check", b"", head)).read()
            while (state := json.load(urlopen(f"{url}job")))["running"]:
                time.sleep(0.1)
        finally:
            run.kill()
    none_ran(place)
    assert state["code"] in (0, 1), state


@pytest.mark.thorough
def test_the_module_drops_the_current_folder_before_it_imports_a_library(tmp_path: Path) -> None:
    """Python itself has looked there by then, for ``servo_models``: ``servo-models`` does not."""
    plant(tmp_path / FOLDERS[0], tmp_path / "mark", OTHERS)
    words = (sys.executable, "-m", "servo_models", "simulate", "sg90")
    with begun(tmp_path, *words) as run:
        said = run.communicate(timeout=600)[0]
    none_ran(tmp_path)
    assert run.returncode == 0, said


DESCRIPTION = '{actuator}\n[[logs]]\nfile = "log.csv"\n'
NAMES = {
    "first": 'actuator = "evil.py"',
    "function": 'actuator = "evil.py:simulate"',
    "params": 'params = "known.toml"',
    "both": 'actuator = "sg90"\nparams = "known.toml"',
}
"""What a description may hold that has a Python file run, by its name."""
PLACES = {
    "descriptions deep in the data": ("data/run_1", "data"),
    "descriptions in a table": ("data", "data/table.csv"),
    "drafts that came with the data": ("data_survey/descriptions/data", "data"),
    "a draft that came with a log": ("data/first_survey/descriptions/data", "data/first.csv"),
}
"""Where they lie, and what is surveyed."""


@pytest.mark.thorough
@pytest.mark.parametrize("where", PLACES)
def test_what_a_survey_finds_by_itself_runs_if_it_is_trusted_only(
    tmp_path: Path, where: str
) -> None:
    place, asked = PLACES[where]
    folder = tmp_path / place
    for made in (folder, tmp_path / "data"):
        made.mkdir(parents=True, exist_ok=True)
    for name in (f"{name}.csv" for name in NAMES):
        (tmp_path / "data" / name).write_text("time [s],voltage [V],angle [deg]\n0,0,0\n0.1,1,0\n")
    rows = [f"{name}.toml" for name in NAMES]
    (tmp_path / "data/table.csv").write_text("\n".join(["log", *rows]))
    for name, words in NAMES.items():
        (folder / f"{name}.toml").write_text(DESCRIPTION.format(actuator=words))
    (folder / "known.toml").write_text('actuator = "evil.py"\n')
    mark = tmp_path / "mark"
    (folder / "evil.py").write_text(PLANTED.format(mark=str(mark)))

    def failures(*named: str, **options: bool) -> list[str]:
        found = survey(tmp_path.joinpath(*named), jobs=1, **options).outcomes
        return [it.failure for it in found if "evil.py" in it.failure]

    held = failures(asked)
    assert not mark.exists()
    assert len(held) == (1 if asked == "data/first.csv" else len(NAMES))
    assert all("--trust" in why for why in held)
    assert failures(place, "both.toml")
    assert mark.read_text()  # since who names a description names what lies beside it
    mark.unlink()
    assert not any("--trust" in why for why in failures(asked, trust=True))
    assert mark.read_text()


@pytest.mark.thorough
def test_an_actuator_of_a_job_that_came_with_the_data_is_not_run(tmp_path: Path) -> None:
    """What is kept of joints names their actuator, which a file of parameters is made from."""
    for unit in "ab":
        folder = tmp_path / "data" / unit
        folder.mkdir(parents=True)
        (folder / "joint.toml").write_text('actuator = "dc_motor"\n[[logs]]\nfile = "gone.csv"\n')
    survey(tmp_path / "data", jobs=1)
    mark, evil = tmp_path / "mark", tmp_path / "data" / "evil.py"
    evil.write_text(PLANTED.format(mark=str(mark)))
    size = {"name": "resistance", "unit": "Ohm", "nominal": 1.0, "prior": 0.5, "value": 1.1}
    changes = {"actuator": str(evil), "variant": "x", "failure": "", "verdict": "parameters"}
    for job in (tmp_path / "data_survey" / "jobs").glob("*.json"):
        kept = json.loads(job.read_text()) | changes
        job.write_text(json.dumps(kept | {"parameters": [size | {"standard_error": 0.1}]}))
    assert survey(tmp_path / "data", jobs=1).common("joint").actuator == str(evil)
    assert not mark.exists()
    survey(tmp_path / "data", jobs=1, trust=True)
    assert mark.exists()
