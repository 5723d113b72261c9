"""``servo-models new actuator``: what it writes works in every command, and what it refuses."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from servo_models.catalogue import actuator, all_actuators
from servo_models.cli.new import write_template
from servo_models.core.plant import check_actuator_name
from servo_models.core.types import Array
from servo_models.data.parameters import read_parameters
from servo_models.data.tables import read_signals
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.document import complaints
from tests.support.template_servo import STEP_SIZE, STEPS, VALUES, angles, write_log

ERRORS = 4.0  # standard errors by which an estimate may miss the truth


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run) -> Path:
    """An empty folder with ``mine.py``."""
    monkeypatch.chdir(tmp_path)
    said = "wrote 'mine.py': adapt it, then 'servo-models explain mine.py'\n"
    assert run("new", "actuator", "mine.py") == (0, said, "")
    return tmp_path


def written(path: Path) -> tuple[Array, Array]:
    """Times [s] and readings [rad] that ``simulate`` has written."""
    times, signals = read_signals(path, list(actuator("mine.py").plant.wire.values()))
    return times, signals["reading"]


def test_it_loads_and_is_called_like_the_file(folder: Path, run: Run) -> None:
    code, out, err = run("explain", "mine.py")
    assert (code, err) == (0, "")
    assert out.startswith("mine: Position servo")
    assert "my_servo" not in (folder / "mine.py").read_text()


def test_a_small_step_is_that_of_a_second_order(folder: Path, run: Run) -> None:
    """Below saturation: J a = S (G (command - angle) - v / V), solved by hand."""
    assert run("simulate", "mine.py", "--step", "command=0.1", "--out", "step.csv")[0] == 0
    times, reading = written(folder / "step.csv")
    inertia, top_speed, stall_torque, gain = VALUES.values()
    own = np.sqrt(gain * stall_torque / inertia)
    damping = stall_torque / top_speed / (2.0 * own * inertia)
    decay, swing = damping * own, own * np.sqrt(1.0 - damping**2)
    wave = np.cos(swing * times) + decay / swing * np.sin(swing * times)
    np.testing.assert_allclose(reading, 0.1 * (1.0 - np.exp(-decay * times) * wave), atol=1e-6)


def test_a_large_step_and_a_load_are_those_of_another_solver(folder: Path, run: Run) -> None:
    words = ("--step", "command=0.4", "--step", "load_torque=0.3", "--dt", "0.01")
    assert run("simulate", "mine.py", *words, "--out", "step.csv")[0] == 0
    _, reading = written(folder / "step.csv")
    exact = angles(np.full(101, 0.4), 0.01, VALUES, load=lambda speed: 0.3)
    np.testing.assert_allclose(reading, exact, atol=1e-5)
    assert reading[-1] == pytest.approx(0.4 - 0.3 / (VALUES["gain"] * VALUES["stall_torque"]))


@pytest.mark.thorough
def test_it_passes_its_validation(folder: Path, run: Run) -> None:
    """Its FMU against the simulation, that against plain Python, each effect on in turn."""
    run("build", "mine.py")
    code, out, _ = run("validate", "--actuator", "mine.py", "fmus/mine.fmu")
    assert code == 0, out
    assert "PASSED" in out


def test_it_is_identified(folder: Path, run: Run) -> None:
    truth = {**VALUES, "inertia": 2.6e-3, "gain": 5.1}
    description = write_log(folder, "mine", angles(STEPS, STEP_SIZE, truth))
    assert run("check", description)[0] in (0, 1)
    code, out, _ = run("identify", description, "--out", "PARAMS.toml")
    assert code in (0, 1), out
    # stall torque over inertia is all that motion without a known load can tell
    found = {e.name: e for e in read_parameters(folder / "PARAMS.toml").estimates}
    for name in ("top_speed", "gain"):
        error = found[name].standard_error
        assert error
        assert abs(found[name].value - truth[name]) < ERRORS * error, name
    ratio = found["stall_torque"].value / found["inertia"].value
    assert ratio == pytest.approx(truth["stall_torque"] / truth["inertia"], rel=0.02)


@pytest.mark.thorough
def test_what_it_lacks_is_named(folder: Path, run: Run) -> None:
    """A dead zone of the drive, simulated by another solver."""
    truth = {**VALUES, "inertia": 2.3e-3}
    log = angles(STEPS, STEP_SIZE, truth, dead_zone=0.08)
    code, out, err = run("diagnose", write_log(folder, "mine", log))
    assert (code, complaints(err)) == (1, [])
    assert "drive_dead_zone on 'drive' explains the gap" in out


REFUSED = [
    ("mine.txt", "'mine.txt' is no Python file: let the name end in .py"),
    ("mine", "let the name end in .py"),
    ("2nd.py", "'2nd.py' names its actuator: actuator '2nd' has an unfit name"),
    ("my-servo.py", "begin with a letter, go on with letters (a to z), digits"),
    ("my servo.py", "has an unfit name"),
    ("class.py", "has the name of a Python keyword: give it another one"),
    (".py", "has an unfit name"),
    ("con.py", "has the name of a device"),
    ("sg90.py", "is called like the actuator 'sg90' of the catalogue"),
]


@pytest.mark.parametrize(("name", "message"), REFUSED)
def test_what_is_refused(
    name: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run("new", "actuator", name)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_missing_is_made(tmp_path: Path, run: Run) -> None:
    """As for the files that other commands write."""
    path = tmp_path / "no" / "such" / "mine.py"
    assert run("new", "actuator", path)[0] == 0
    assert actuator(str(path)).name == "mine"
    (tmp_path / "file").write_text("")
    code, _, err = run("new", "actuator", tmp_path / "file" / "mine.py")
    assert code == 2
    assert "choose a folder" in err


@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_nothing_is_overwritten(kind: str, tmp_path: Path, run: Run) -> None:
    path = tmp_path / "mine.py"
    if kind == "file":
        path.write_text("mine")
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(tmp_path / "nowhere.py")
    code, out, err = run("new", "actuator", path)
    assert (code, out) == (2, "")
    assert "mine.py' is there, and is not overwritten: choose another name" in err
    assert os.listdir(tmp_path) == ["mine.py"]
    assert kind != "file" or path.read_text() == "mine"


def test_a_wrong_kind_is_refused_with_the_right_one(run: Run) -> None:
    code, out, err = run("new", "effect", "mine.py")
    assert (code, out) == (2, "")
    assert "'actuator'" in err
    assert err.count("\n") == 1


@example("linear_drive")  # hypothesis draws texts of the sources, too
@given(st.text(min_size=1, max_size=20).filter(lambda text: "/" not in text and "\0" not in text))
def test_a_name_is_written_or_refused(tmp_path_factory: pytest.TempPathFactory, stem: str) -> None:
    """Whatever it is: a file that defines an actuator of that name, or a word to the user."""
    folder = tmp_path_factory.mktemp("any name")
    path = folder / f"{stem}.py"
    try:
        check_actuator_name(path.stem)
        if path.stem in all_actuators():
            raise ValueError("a name of the catalogue")
    except ValueError:
        with pytest.raises(UserError):
            write_template(path)
        assert not list(folder.iterdir())
    else:
        write_template(path)
        assert f'name="{stem}"' in path.read_text()


def test_the_example_lags_a_ramp_as_a_second_order_does(tmp_path: Path, run: Run) -> None:
    """By 2 zeta / omega, the delay and half a row, which is held; play in the loop is not seen."""
    path = tmp_path / "new" / "servo.toml"
    code, out, _ = run("new", "example", path)
    assert code == 0
    assert f"servo-models diagnose {path}" in out
    time, goal, angle = np.loadtxt(path.with_suffix(".csv"), delimiter=",", skiprows=1).T
    lag = np.degrees(np.mean((angle - goal)[time > 5.5]))
    assert lag == pytest.approx((2.0 * 0.8 / 26.0 + 0.005 + 0.005) * 20.0 / 1.5, abs=0.03)
    assert run("check", path)[0] == 0


@pytest.mark.parametrize("taken", ["servo.toml", "servo.csv"])
def test_an_example_overwrites_nothing(taken: str, tmp_path: Path, run: Run) -> None:
    (tmp_path / taken).write_text("mine")
    code, _, err = run("new", "example", tmp_path / "servo.toml")
    assert code == 2
    assert f"{taken}' is there, and is not overwritten" in err
    assert [it.name for it in tmp_path.iterdir()] == [taken]


def test_an_example_is_a_description(tmp_path: Path, run: Run) -> None:
    code, _, err = run("new", "example", tmp_path / "servo.txt")
    assert code == 2
    assert "let the name end in .toml" in err
