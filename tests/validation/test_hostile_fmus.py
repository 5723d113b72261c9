"""A share of the hostile FMUs; ``tests/fuzz/fmus.py`` makes and judges all of them."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from servo_models.core.own_actuator import load_actuator
from servo_models.core.workers import python
from servo_models.errors import UserError
from servo_models.fmu.fmu import Limits
from servo_models.validation.any_fmu.static import inspect
from servo_models.validation.rows import Validation
from servo_models.validation.runner import validate
from tests.fuzz.fmus import Case, cases, judge, made_good

SHARE = {
    "in UTF-16": "",
    "raises RuntimeError at a step": "no [bold]wish[/] %s %n",
    "leaves by os._exit(0) when imported": "ends the process with exit code 0",
    "loops at a step": "does not answer within",
    "reads address 0 at a step": "signal 11",
    "takes all memory at once when initialised": "cannot be initialised",
    "answers in texts in place of its host when read": "gives other outputs than it was asked for",
    "says that all is well when imported": "gives an answer that is none",
    "an output scaled by 1.001": "not bit for bit",
    "no pythonfmu in it": "No module named 'pythonfmu'",
    "a renamed output": "has not the variables of actuator 'joint' ('angles', 'reading')",
    "a wrong GUID": "'guid' is not that of this description",
    "a wrong bound": "Real has max 400.0, not 4.0",
    "a library that is a text": "has a library that cannot be loaded",
    "no library of this system": "has no library binaries/",
}
"""Cases of which each is told in its own way, and what is told."""
REFUSED = {
    "a file above its folder": "would be written outside its folder",
    "a link to a folder": "is a link or a device",
    "a bomb of 512 MB": "the limit is 256 MB; raise it with --unpacked",
    "a bomb that lies about its size": "cannot read FMU",
    "entities that explode": "has a DOCTYPE",
    "elements nested deeply": "more or deeper elements",
    "an endless name": "has a name of more than 1000 characters",
    "no description": "it has no modelDescription.xml",
    "bzip2": "packed in a way that FMI does not know",
    "a wrong unit": 'unit "deg"',
    "an unknown actuator": "unknown actuator 'joints'",
}
LIMITS = Limits(seconds=5.0)
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="signals are those of Linux")


class Ground:
    """The good FMU, its actuator and all cases by name, made once."""

    def __init__(self, home: Path) -> None:
        self.home = home
        self.source, self.good = made_good(home)
        self.cases: dict[str, Case] = {case.name: case for case in cases(self.good)}

    def validated(self, name: str) -> Validation:
        path = self.home / "it.fmu"
        self.cases[name].write(path)
        return validate([path], own=load_actuator(self.source), limits=LIMITS)


@pytest.fixture(scope="module")
def ground(tmp_path_factory: pytest.TempPathFactory) -> Ground:
    return Ground(tmp_path_factory.mktemp("hostile"))


@pytest.fixture(autouse=True)
def nothing_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> object:
    """Every test leaves the folder of temporary files as empty as it was."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    yield
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
@pytest.mark.parametrize("name", SHARE)
def test_a_wrong_fmu_fails_with_a_sentence(name: str, ground: Ground) -> None:
    result = ground.validated(name)
    assert result.passed == ground.cases[name].harmless
    if SHARE[name]:
        assert any(SHARE[name] in row.note for row in result.failures), result.failures[0].note
    assert all("\n" not in row.note and "\x1b" not in row.note for row in result.rows)


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_fmu_is_refused_with_a_sentence(name: str, ground: Ground) -> None:
    with pytest.raises(UserError) as refused:
        ground.validated(name)
    assert REFUSED[name] in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.thorough
def test_a_failure_is_told_once(ground: Ground) -> None:
    """After the process has ended nothing else is tried: each try could take the time limit."""
    result = ground.validated("loops when imported")
    assert len(result.failures) == 1


@pytest.mark.thorough
def test_a_bomb_passes_where_the_limit_is_raised(ground: Ground) -> None:
    path = ground.home / "large.fmu"
    with zipfile.ZipFile(ground.good) as read, zipfile.ZipFile(path, "w", 8) as write:
        for name in read.namelist():
            write.writestr(name, read.read(name))
        write.writestr("extra/large", bytes(20 << 20))
    own = load_actuator(ground.source)
    with pytest.raises(UserError, match="the limit is 10 MB"):
        validate([path], own=own, limits=Limits(unpacked_megabytes=10.0))
    assert validate([path], own=own, limits=Limits(unpacked_megabytes=30.0)).passed


@pytest.mark.long
def test_the_command_ends_and_leaves_nothing(ground: Ground) -> None:
    """The command itself, on a slave whose children outlive it."""
    outcome = judge(ground.cases["has children at a step"], ground.source, ground.home)
    assert outcome.sound, outcome
    assert outcome.code == 1


def test_an_fmu_finds_the_standard_library_and_the_environment_of_a_host(tmp_path: Path) -> None:
    """What is installed or imported beside it would serve a slave that lacks its own."""
    probe = (
        "import fmpy, importlib.util as u, os; from servo_models.fmu.host import shut_in;"
        f"shut_in({str(tmp_path)!a}, 4096.0);"
        "print([it for it in ('pythonfmu', 'numpy', 'fmpy', 'servo_models') if u.find_spec(it)],"
        "u.find_spec('sqlite3') is not None, os.getcwd(), os.environ.get('SECRET'))"
    )
    secret = {**os.environ, "SECRET": "x"}
    done = subprocess.run(python(probe), env=secret, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["[]", "True", str(tmp_path), "None"]


@pytest.mark.thorough
def test_files_alone_are_looked_at_without_harm(ground: Ground) -> None:
    """A verdict, or a refusal in one line; never another exception."""
    path = ground.home / "it.fmu"
    for name in (*SHARE, *REFUSED, "model exchange"):
        ground.cases[name].write(path)
        if name in REFUSED and name not in ("a wrong unit", "an unknown actuator"):
            with pytest.raises(UserError, match=r"\A[^\n]*\Z"):
                inspect([path], LIMITS)
            continue
        rows = inspect([path], LIMITS).rows
        assert all("\n" not in row.note and "\x1b" not in row.note for row in rows)
