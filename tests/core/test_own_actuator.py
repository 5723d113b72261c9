"""Whose Python files are run, when, and how often."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest

from fmu_src.source import slave_source
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.data.parameters import read_parameters
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.archives import with_description
from tests.support.own_actuators import SOURCE, WITH_EFFECTS, runs, write


def reached(path: Path) -> float:
    """Angle after 0.1 s of a step of 1 rad."""
    return float(simulate(model(str(path)), [0.0, 0.1], {"goal": 1.0})["angle"][-1])


def test_a_file_is_run_once_and_again_when_it_has_changed(tmp_path: Path) -> None:
    path = write(tmp_path)
    assert reached(path) == reached(path) == pytest.approx(1.0 - np.exp(-0.1 / 0.2), abs=1e-9)
    assert runs(path) == 1
    write(tmp_path, 0.4)
    assert reached(path) == pytest.approx(1.0 - np.exp(-0.1 / 0.4), abs=1e-9)
    assert runs(path) == 2


def test_files_of_one_name_do_not_meet(tmp_path: Path) -> None:
    slow, quick = write(tmp_path / "a", 0.4), write(tmp_path / "b", 0.1)
    for path, time_constant in ((slow, 0.4), (quick, 0.1), (slow, 0.4)):
        assert reached(path) == pytest.approx(1.0 - np.exp(-0.1 / time_constant), abs=1e-9)


def test_blocks_are_those_that_ran_whatever_becomes_of_the_file(tmp_path: Path) -> None:
    path = write(tmp_path)
    chosen = model(str(path))
    path.write_text(path.read_text().replace("(goal - angle)", "(goal + angle)"))
    angle = simulate(chosen, [0.0, 0.1], {"goal": 1.0})["angle"][-1]
    assert angle == pytest.approx(1.0 - np.exp(-0.1 / 0.2), abs=1e-9)


@pytest.mark.parametrize("end", ["import sys; sys.exit(0)", "raise SystemExit('done')", "exit()"])
def test_a_file_that_ends_the_process_is_an_error(tmp_path: Path, end: str, run: Run) -> None:
    path = tmp_path / "mine.py"
    path.write_text(end + "\n")
    code, out, err = run("simulate", path)
    assert (code, out) == (2, "")
    assert "mine.py' does not run: SystemExit" in err
    assert "correct it" in err


def test_a_file_is_explained_in_place_of_a_name(tmp_path: Path, run: Run) -> None:
    path, drawn = write(tmp_path), tmp_path / "step.svg"
    code, out, _ = run("explain", path, "--picture", drawn)
    assert code == 0
    assert "joint: A joint" in out
    assert "time_constant" in out
    assert "plain" in drawn.read_text()


@pytest.mark.thorough
def test_one_input_is_enough(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path, changes=WITH_EFFECTS)
    for words in (
        ["explain", path, "--variant", "plain", "--picture", tmp_path / "step.svg"],
        ["simulate", path, "--plot", tmp_path / "run.svg"],
        ["figures", path, "--at", "goal=1"],
        ["build", path, "--out", tmp_path],
    ):
        code, _, err = run(*words)
        assert (code, err) == (0, ""), words


def test_declarations_that_do_not_fit_together_are_an_error(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('"angle", "rad", "angle"', '"goal", "rad", "angle"'))
    for command in ("simulate", "build"):
        code, _, err = run(command, path)
        assert code == 2
        assert f"{path}'" in err
        assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "name", ["../up", "my servo", "2x", "a.b", "class", "", "nul\0", "con", "LPT1"]
)
def test_a_name_that_no_fmu_can_have_is_refused(name: str, tmp_path: Path, run: Run) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('name="joint"', f"name={name!r}"))
    code, out, err = run("build", path, "--out", tmp_path / "built")
    assert (code, out) == (2, "")
    assert "joint.py' does not run: ValueError: actuator '" in err
    assert len(err.splitlines()) == 1
    assert {it.name for it in tmp_path.iterdir()} <= {"joint.py", "joint.ran"}


def test_an_output_without_a_unit_is_refused(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('Wire("speed", "rad/s", "speed"),', ""))
    assert run("simulate", path)[0] == 0
    path.write_text(path.read_text().replace('outputs=("angle",)', 'outputs=("speed",)'))
    code, out, err = run("simulate", path)
    assert (code, out) == (2, "")
    assert "joint.py' does not run: ValueError: unknown output 'speed'" in err


def test_a_standard_step_of_no_input_is_refused(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('step=("goal"', 'step=("gaol"'))
    code, out, err = run("build", path, "--out", tmp_path / "built")
    assert (code, out) == (2, "")
    assert "ValueError: unknown input of the standard step 'gaol'; did you mean 'goal'" in err


def test_a_standard_step_out_of_bounds_is_no_start_value(tmp_path: Path, run: Run) -> None:
    """No FMU may have such a start value; ``simulate`` says what is wrong with it."""
    path = write(tmp_path, changes=WITH_EFFECTS)
    path.write_text(path.read_text().replace('step=("goal", 1.0)', 'step=("goal", 11.0)'))
    assert run("build", path, "--out", tmp_path)[0] == 0
    (goal, *_) = fmpy.read_model_description(str(tmp_path / "joint.fmu")).modelVariables
    assert (goal.name, float(goal.start)) == ("goal", 0.0)
    code, _, err = run("simulate", path)
    assert code == 2
    assert "'goal' = 11 is outside [-10, 10] rad" in err


def test_an_actuator_without_a_variant_is_refused(tmp_path: Path, run: Run) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('(Variant("plain", "", {}, ""),)', "()"))
    code, out, err = run("simulate", path)
    assert (code, out) == (2, "")
    assert "joint.py' does not run: ValueError: actuator 'joint' has no variant: give it one" in err


def test_an_uncertainty_of_no_parameter_is_refused(tmp_path: Path, run: Run) -> None:
    _, description = describe(tmp_path, "joint.py")
    path = write(tmp_path)
    path.write_text(path.read_text().replace('{}, "")', '{}, "", uncertainty={"time": 0.3})'))
    code, out, err = run("check", description)
    assert (code, out) == (2, "")
    assert "unknown parameter with an uncertainty 'time'; did you mean 'time_constant'" in err


@pytest.mark.parametrize("title", ["C:\\users", 'three quotes """', "of two\nlines", "plain"])
def test_a_title_is_no_code(title: str, tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace('title="A joint"', f"title={title!r}"))
    chosen = model(str(path))
    text = ast.parse(slave_source(chosen)[1])
    assert (ast.get_docstring(text, clean=False) or "").startswith(f"{chosen.actuator.title}, ")


PARAMETERS = "actuator = '{name}'\n"
DESCRIPTION = """actuator = '{name}'
free = ["time_constant"]
[[logs]]
file = "log.csv"
time = "t"
inputs.goal = "goal"
outputs.angle = "angle"
"""


def describe(folder: Path, name: str) -> tuple[Path, Path]:
    """Write a parameter file and a description that name this file, with a log."""
    folder.mkdir(exist_ok=True)
    times = np.linspace(0.0, 1.0, 101)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(101)
    since = np.maximum(times - 0.1, 0.0)
    table = np.column_stack([times, times >= 0.1, 1.0 - np.exp(-since / 0.3) + noise])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,goal,angle", comments="")
    parameters, description = folder / "params.toml", folder / "rig.toml"
    parameters.write_text(PARAMETERS.format(name=name))
    description.write_text(DESCRIPTION.format(name=name))
    return parameters, description


def test_a_file_beside_the_one_that_names_it_is_run(tmp_path: Path) -> None:
    path = write(tmp_path)
    for parameters, description in (describe(tmp_path, "joint.py"), describe(tmp_path, str(path))):
        assert read_parameters(parameters).actuator == str(path)
        assert read_description(description).actuator.file == path
    assert runs(path) == 1


@pytest.mark.thorough
@pytest.mark.parametrize("way", ["elsewhere", "below", "through a link"])
def test_a_file_elsewhere_is_run_only_if_trusted(tmp_path: Path, way: str, run: Run) -> None:
    folder = tmp_path / "rig"
    path = write(folder / "below" if way == "below" else tmp_path / "other")
    name = "below/joint.py" if way == "below" else "../other/joint.py"
    parameters, description = describe(folder, name)
    if way == "through a link":
        (folder / "joint.py").symlink_to(path)
        parameters, description = describe(folder, "joint.py")
    commands = [
        ["explain", "--params", parameters],
        ["simulate", "--params", parameters],
        ["figures", "--params", parameters],
        ["build", "--params", parameters, "--out", tmp_path],
        ["validate", "--params", parameters],
        ["check", description],
        ["identify", description],
        ["diagnose", description],
    ]
    for words in commands:
        code, out, err = run(*words)
        assert (code, out) == (2, "")
        assert "would run the Python file" in err
        assert "--trust" in err
    for read, file in ((read_parameters, parameters), (read_description, description)):
        with pytest.raises(UserError, match="trust=True"):
            read(file)
    assert runs(path) == 0
    for words in (commands[0], commands[1], commands[6]):
        code, _, err = run(*words, "--trust")
        assert (code, err) == (0, ""), words
    assert read_description(description, trust=True).actuator.name == "joint"
    assert runs(path) == 1


def test_a_description_runs_no_file_elsewhere_by_way_of_its_parameters(tmp_path: Path) -> None:
    path = write(tmp_path / "other")
    parameters, _ = describe(tmp_path / "other", "joint.py")
    _, description = describe(tmp_path / "rig", "joint.py")
    named = f"params = '../other/{parameters.name}'"
    description.write_text(description.read_text().replace("actuator = 'joint.py'", named))
    with pytest.raises(UserError, match=r"'rig.toml' would run .*--trust"):
        read_description(description)
    assert runs(path) == 0
    assert read_description(description, trust=True).actuator.file == path


def test_an_fmu_names_no_file(
    tmp_path: Path, fmu_file: Callable[[str], Path], run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Validation asks whose model an FMU is: the name inside is one of the catalogue."""
    path = write(tmp_path)
    monkeypatch.chdir(tmp_path)
    for name in ("joint.py", str(path)):
        other = f'modelName="{name}"'.encode()
        evil = with_description(
            fmu_file("torque_motor"),
            tmp_path / "evil.fmu",
            lambda text, other=other: text.replace(b'modelName="torque_motor"', other),
        )
        assert run("validate", evil)[0] in (1, 2)
        assert runs(path) == 0


def test_a_file_for_the_modules_of_version_0_2_runs(tmp_path: Path) -> None:
    old = SOURCE.replace(
        "from servo_models import Actuator, Param, Plant, State, Variant, Wire, block",
        "from servo_models.actuator import Actuator, Plant, State, Variant, Wire\n"
        "from servo_models.block import Param, block",
    )
    assert old != SOURCE
    path = tmp_path / "old_joint.py"
    path.write_text(old)
    response = simulate(model(str(path)), [0.0, 0.2], {"goal": 1.0})
    assert response["angle"][-1] == pytest.approx(1.0 - math.exp(-1.0), rel=1e-6)
