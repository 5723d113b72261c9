"""The command line: what it prints, what it leaves behind, and its exit codes."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from servo_models.actuators.torque_motor.variants import TABLE_1
from servo_models.build import kinds_for
from servo_models.catalogue import actuator, actuators
from servo_models.cli import app
from servo_models.cli.options import WORDS, assignments
from servo_models.data.tables import read_signals
from servo_models.effects import effects
from servo_models.errors import UserError
from tests.conftest import Run

MOTOR = list(actuator("torque_motor").plant.wire.values())
HEAVY = ("scipy", "numba", "pint", "polars", "matplotlib", "fmpy", "control")


def python(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        [sys.executable, *words], capture_output=True, text=True, check=False, **options
    )


def test_help_shows_every_command_and_each_takes_the_words_of_its_examples() -> None:
    commands: dict[str, Any] = vars(typer.main.get_command(app))["commands"]
    top = CliRunner().invoke(app, ["--help"])
    assert top.exit_code == 0
    for name, command in commands.items():
        assert name in top.output
        examples = re.findall(r"^servo-models (\S+) (.*)$", command.help, re.MULTILINE)
        assert examples or name == "list"
        for of, words in examples:
            commands[of].make_context(of, shlex.split(words))


def test_every_row_of_the_table_of_options_is_one_of_a_command() -> None:
    commands = vars(typer.main.get_command(app))["commands"].values()
    assert {it.help for it in WORDS.values()} == {it.help for one in commands for it in one.params}


def test_help_shows_the_brackets_of_units() -> None:
    page = CliRunner().invoke(app, ["simulate", "--help"], env={"COLUMNS": "200"})
    assert "[us]" in page.output


def test_starting_the_command_line_loads_nothing_heavy() -> None:
    code = f"import sys, servo_models.cli; print([m for m in {HEAVY} if m in sys.modules])"
    assert python("-c", code).stdout.strip() == "[]"


def test_list_names_everything_and_warns(run: Run) -> None:
    code, out, _ = run("list")
    assert code == 0
    for found in actuators().values():
        for variant in found.variants:
            assert variant.name in out
            assert variant.warning in " ".join(out.split())
    assert all(name in out for name in effects())
    lines = [line for line in out.splitlines() if line]
    assert lines[:2] == ["Actuators and effects", "Actuators"]
    assert lines[-3] == "Warnings"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["simulat"], "did you mean 'simulate'?"),
        (["explain", "backlsh"], "did you mean 'backlash'?"),
        (["simulate", "sg9"], "did you mean 'sg90'?"),
        (["simulate", "sg90", "--varient", "linear"], "--variant"),
        (["simulate", "sg90", "--variant", "linea"], "did you mean 'linear'?"),
        (["simulate", "sg90", "--set", "backlash.half_with=1"], "'backlash.half_width'?"),
        (["simulate", "sg90", "--step", "pulse_with=2 ms"], "did you mean 'pulse_width'?"),
        (["simulate", "sg90", "--step", "pulse_width=2000"], "outside"),
        (["simulate", "sg90", "--step", "pulse_width=2 V"], "does not convert to 's'"),
        (["simulate", "sg90", "--set", "backlash.half_width"], "write NAME=VALUE"),
        (["simulate", "sg90", "--set", "backlash.half_width=wide"], "not a number"),
        (["simulate", "sg90", "--set", "backlash.half_width=99 deg"], "outside"),
        (["simulate", "sg90", "--stop", "-1"], "above 0"),
        (["simulate", "sg90", "--dt", "0"], "above 0"),
        (["simulate", "sg90", "--dt", "1e-12"], "too many"),
        (["simulate", "sg90", "--inputs", "absent.csv"], "cannot read 'absent.csv'"),
        (["simulate", "sg90", "--inputs", "a.csv", "--stop", "1"], "leave out"),
        (["simulate", "sg90", "--out", "a.xlsx"], "'a.xlsx'"),
        (["simulate", "sg90", "--plot", "a.gif"], "'a.gif'"),
        (["simulate"], "name one"),
        (["explain", "mine.toml"], "with --params mine.toml"),
        (["simulate", "sg90", "--params", "a.toml"], "leave them out"),
        (["build", "--params", "absent.toml"], "cannot read 'absent.toml'"),
        (["explain"], "name an actuator or an effect"),
        (["explain", "sg90", "--params", "a.toml"], "leave out the name"),
        (["build", "--variant", "linear"], "name it"),
        (["build", "--out", "mine.fmu"], "name it"),
        (["build", "sg90", "--out", "/dev/null/fmus"], "cannot write"),
    ],
)
def test_what_cannot_run_is_told_in_one_line(run: Run, words: list[str], said: str) -> None:
    code, out, err = run(*words)
    assert code == 2
    assert out == ""
    assert err.startswith("servo-models: ")
    assert err.count("\n") == 1
    assert said in err


def test_a_crash_does_not_look_like_a_verdict(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    import servo_models.analysis.explain  # noqa: F401

    def broken() -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(sys.modules["servo_models.analysis.explain"], "overview", broken)
    code, _, err = run("list")
    assert code == 2
    assert "a bug" in err


@pytest.mark.thorough
def test_a_process_that_validates_what_is_wrong_does_not_end_with_0(
    fmu_file: Callable[[str], Path], tmp_path: Path
) -> None:
    """Beside the exit code of ``main``, what a shell or a CI runner sees of it."""
    fmu, bad, reference = fmu_file("torque_motor"), tmp_path / "bad.fmu", tmp_path / "ref.csv"
    bad.write_text("no zip")
    reference.write_text("time,angle\n0,1\n0.1,2\n")
    for words, code, said in [
        ([bad, "--static-only"], 2, "bad.fmu"),
        ([fmu, "--reference", reference], 1, "FAILED"),
        ([fmu, "--refernce", reference], 2, "--reference"),
    ]:
        done = python("-m", "servo_models", "validate", *map(str, words))
        assert (done.returncode, said in done.stdout + done.stderr) == (code, True), done


def test_settings_reach_the_model(run: Run, tmp_path: Path) -> None:
    """The static gain of the torque motor is K_t / (R K_s), whatever K_t is."""
    out = tmp_path / "new" / "run.csv"
    words = ("simulate", "torque_motor", "--variant", "measured", "--stop", "400 ms")
    code, text, _ = run(
        *words, "--set", "torque_constant=3", "--step", "voltage=12000 mV", "--out", out
    )
    assert code == 0
    assert "0 to 0.4 s" in text
    times, signals = read_signals(out, MOTOR)
    gain = 3.0 / (TABLE_1["resistance"] * TABLE_1["stiffness"])
    assert times[-1] == 0.4
    assert signals["angle"][-1] == pytest.approx(12.0 * gain, rel=1e-9)
    assert np.all(signals["voltage"] == 12.0)


def test_a_step_that_does_not_divide_the_run_still_ends_it(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "run.parquet"
    assert run("simulate", "torque_motor", "--stop", "0.01", "--dt", "0.003", "--out", out)[0] == 0
    times, _ = read_signals(out, MOTOR)
    assert times == pytest.approx([0.0, 0.003, 0.006, 0.009, 0.01], abs=1e-15)


def test_the_summary_measures_the_papers_overshoot(run: Run) -> None:
    """4.84 % at K_f = 0.18 (SG90 paper sec. 6)."""
    code, out, _ = run("simulate", "sg90", "--variant", "linear_kf018", "--stop", "60")
    assert code == 0
    line = next(line for line in out.splitlines() if line.startswith("overshoot"))
    assert float(line.split()[1]) == pytest.approx(4.84, abs=0.01)


def test_inputs_of_a_file_are_held_from_their_row(run: Run, tmp_path: Path) -> None:
    """Row by row, the angle only answers to a voltage after the row that carries it."""
    table = tmp_path / "in.csv"
    table.write_text("time [ms],voltage\n0,0\n5,0\n10,20\n15,20\n")
    out = tmp_path / "out.csv"
    words = ("simulate", "torque_motor", "--variant", "measured", "--inputs", table, "--out", out)
    assert run(*words)[0] == 0
    _, signals = read_signals(out, MOTOR)
    assert list(signals["angle"][:3]) == [0.0, 0.0, 0.0]
    assert signals["angle"][3] > 0.0


def test_plots_are_the_same_bytes_again(run: Run, tmp_path: Path) -> None:
    files = [tmp_path / name for name in ("a.svg", "b.svg")]
    for file in files:
        assert run("simulate", "torque_motor", "--plot", file)[0] == 0
    assert files[0].read_bytes() == files[1].read_bytes()
    assert ElementTree.parse(files[0]).getroot().tag.endswith("svg")


@pytest.mark.thorough
def test_a_built_fmu_carries_the_settings(run: Run, tmp_path: Path) -> None:
    words = ("build", "torque_motor", "--variant", "estimated", "--out", tmp_path)
    code, out, _ = run(*words, "--set", "backlash.half_width=0.1 deg")
    assert code == 0
    built = out.splitlines()
    assert built[0] == str(tmp_path / "torque_motor_estimated.fmu")
    assert len(built) == len(kinds_for(tmp_path, native=False))
    description = fmpy.read_model_description(built[-1])
    start = {variable.name: variable.start for variable in description.modelVariables}
    assert float(start["backlash.half_width"]) == pytest.approx(np.radians(0.1), rel=1e-15)
    assert float(start["torque_constant"]) == 5.23


@pytest.mark.thorough
def test_variants_are_files_of_their_own(run: Run, tmp_path: Path) -> None:
    """The default one has the actuator's name alone; ``--out`` may name the file."""
    for words in ([], ["--variant", "identified"], ["--variant", "measured"]):
        assert run("build", "torque_motor", *words, "--out", tmp_path)[0] == 0
    assert run("build", "torque_motor", "--out", tmp_path / "valve.fmu")[0] == 0
    names = {"torque_motor", "torque_motor_measured", "valve"}
    assert {path.name.split(".")[0] for path in tmp_path.iterdir()} == names
    kinds = kinds_for(tmp_path, native=False)
    assert len(list(tmp_path.iterdir())) == 2 * len(kinds) + 1
    first, named = (tmp_path / name for name in ("torque_motor.fmu", "valve.fmu"))
    assert first.read_bytes() == named.read_bytes()


@given(
    pairs=st.dictionaries(
        st.text("abc._", min_size=1, max_size=8),
        st.text("0123456789.e-+ degV=", min_size=1).filter(str.strip),
        max_size=5,
    )
)
def test_assignments_are_read_back(pairs: dict[str, str]) -> None:
    texts = [f" {name} = {value} " for name, value in pairs.items()]
    assert assignments("--set", texts) == {k: v.strip() for k, v in pairs.items()}


@given(text=st.text())
def test_assignments_understand_or_complain(text: str) -> None:
    try:
        found = assignments("--set", [text])
    except UserError:
        return
    ((name, value),) = found.items()
    assert name
    assert value
    assert "=" not in name


def test_one_name_is_set_once() -> None:
    with pytest.raises(UserError, match="twice"):
        assignments("--set", ["a=1", "a=2"])


def test_piped_output_is_plain_whatever_the_locale() -> None:
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    done = python("-m", "servo_models", "explain", "backlash", env=environment)
    assert done.returncode == 0
    assert "\x1b" not in done.stdout
    assert done.stdout.isascii()


@pytest.mark.skipif(os.name == "nt", reason="pipes end by a signal on POSIX only")
def test_a_reader_that_left_is_no_error() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "servo_models", "list"]
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert done.stderr == b""


@pytest.mark.skipif(os.name == "nt", reason="pipes end by a signal on POSIX only")
def test_files_are_written_though_the_reader_left(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    out = tmp_path / "step.csv"
    words = ["-u", "-m", "servo_models", "simulate", "torque_motor", "--out", str(out)]
    subprocess.run([sys.executable, *words], stdout=writer, stderr=subprocess.PIPE, check=False)
    os.close(writer)
    assert out.is_file()


def test_an_input_out_of_bounds_is_told_with_the_row_of_its_file(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "inputs.csv"
    path.write_text("time,voltage\n0,0\n0.1,1\n0.2,2\n0.3,5000\n")
    code, _, err = run("simulate", "torque_motor", "--inputs", path)
    assert code == 2
    assert "inputs.csv', row 5, column 'voltage'" in err
    assert "5000 V is outside" in err


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("servo-models sim", "simulate"),
        ("servo-models simulate tor", "torque_motor"),
        ("servo-models simulate sg90 --variant linear_unl", "linear_unloaded_kf018"),
        ("servo-models simulate sg90 --set backl", "backlash.half_width="),
        ("servo-models simulate torque_motor --step vol", "voltage="),
        ("servo-models explain transp", "transport_delay"),
    ],
)
def test_shells_complete(line: str, expected: str) -> None:
    words = line.split()
    environment = {
        **os.environ,
        "_SERVO_MODELS_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
    }
    done = python("-m", "servo_models", env=environment)
    assert expected in done.stdout.split()
