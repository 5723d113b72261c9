"""Names out of anybody's files are printed, and command no CI runner."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.cli.console import disarmed
from tests.support.archives import with_description
from tests.support.sources import ROOT

LOGS = ("a\n ::error::x.csv", "a\r::error::y.csv", "##[error]z.csv", "##vso[task.complete]z.csv")


def servo_models(*words: object) -> tuple[int, bytes, bytes]:
    done = subprocess.run(
        [sys.executable, "-m", "servo_models", *map(str, words)], capture_output=True, check=False
    )
    return done.returncode, done.stdout, done.stderr


def obeyed(said: bytes | str) -> list[str]:
    """Return the lines that a runner takes for commands.

    Source: ActionCommand.cs of actions/runner, whose second form is looked for in the whole line;
    CommandStringConvertor of azure-pipelines-agent.
    """
    text = said if isinstance(said, str) else said.decode()
    lines = re.split(r"\r\n|\r|\n", text)
    return [
        line
        for line in lines
        if line.lstrip().startswith("::") or re.search(r"##(vso|teamcity)?\[", line)
    ]


def test_a_runner_obeys_what_is_looked_for() -> None:
    commands = [
        "::error::x",
        "  ::error::x",
        "a ##[error]x",
        "##vso[task.complete result=Failed;]x",
    ]
    assert obeyed("\r".join([*commands, "a ::error::x", "# [x]"])) == commands


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="no such file names there")
def test_names_of_logs_command_nothing(tmp_path: Path) -> None:
    gimbal = ROOT / "examples/gimbal"
    shutil.copy(gimbal / "gimbal.py", tmp_path)
    head, log = (gimbal / "gimbal.toml").read_text().split("[[logs]]")
    for name in LOGS:
        shutil.copy(gimbal / "log.csv", tmp_path / name)
        head += "[[logs]]" + log.replace('"log.csv"', json.dumps(name))
    (tmp_path / "logs.toml").write_text(head)
    code, out, err = servo_models("check", tmp_path / "logs.toml")
    assert code in (0, 1)
    assert out.count(b"error::x") > 0
    assert obeyed(out) == obeyed(err) == []


@pytest.fixture
def hostile(fmu_file: Callable[[str], Path], tmp_path: Path) -> Path:
    """An FMU of which names command something, and with a fault that names a variable."""

    def change(description: bytes) -> bytes:
        changed = description.replace(b'name="angle"', b'name="&#13;::error::x ##[error]x"')
        return changed.replace(b'modelName="', b'modelName="::error::x&#10;##[error]', 1).replace(
            b'causality="output"', b'causality="::warning::y&#10;::error::x"'
        )

    return with_description(fmu_file("torque_motor"), tmp_path / "::error::x.fmu", change)


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="no such file names there")
def test_names_in_an_fmu_command_nothing(hostile: Path, tmp_path: Path) -> None:
    code, out, err = servo_models("validate", hostile, "--static-only", "--all")
    assert code == 1
    assert b"error::x" in out
    assert obeyed(out) == obeyed(err) == []
    (tmp_path / "ref.csv").write_text("time,angle\n0,0\n1,0\n")
    code, out, err = servo_models("validate", hostile, "--reference", tmp_path / "ref.csv")
    assert code == 2
    assert b"error::x" in err
    assert obeyed(out) == obeyed(err) == []


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="no such file names there")
def test_other_formats_tell_names_as_they_are(hostile: Path) -> None:
    code, out, err = servo_models("validate", hostile, "--static-only", "--format", "json")
    assert code == 1
    assert any("##[error]torque_motor" in str(row) for row in json.loads(out)["rows"])
    assert obeyed(out) == obeyed(err) == []
    code, out, err = servo_models("validate", hostile, "--static-only", "--format", "github")
    assert code == 1
    assert all(re.match(r"::(error|notice) title=", line) for line in out.decode().splitlines())


PIECE = st.sampled_from([":", "::", "#", "##", "[", "vso", " ", "\n", "\r", "\t", "x", "error"])


@given(st.lists(PIECE | st.text(max_size=3)))
def test_whatever_is_written_in_pieces_commands_nothing(pieces: list[str]) -> None:
    stream = io.StringIO(newline="")  # for both, as somebody may have it who calls ``main``
    with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
        with disarmed():
            for piece in pieces:
                sys.stdout.write(piece)
        print("::notice::behind it all is as before")
    said, text = stream.getvalue(), "".join(pieces)
    assert said.endswith("::notice::behind it all is as before\n")
    shown = said.removesuffix("::notice::behind it all is as before\n")
    assert obeyed(shown) == []
    assert shown.replace("\\", "") == text.replace("\\", "")
    assert shown == text or "::" in text or "##" in text
