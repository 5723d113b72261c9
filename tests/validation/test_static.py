"""FMUs judged by their files: right ones pass, planted faults are named, nothing is run."""

from __future__ import annotations

import re
import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest

from servo_models.build import build
from servo_models.catalogue import model
from servo_models.errors import UserError
from servo_models.validation.any_fmu.static import inspect
from servo_models.validation.rows import Validation
from tests.conftest import Run
from tests.support.foreign_fmus import FOREIGN

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"
)
LOADS = re.compile(r"^(ctypes|subprocess|os\.(exec|fork|posix_spawn|system))")
watched: list[str] | None = None
"""Events of loading and starting that were seen, while a test wants to know."""


def hear(event: str, arguments: object) -> None:
    if watched is not None and LOADS.match(event):
        watched.append(event)


sys.addaudithook(hear)


def changed(
    good: Path, name: str, change: Callable[[bytes], bytes | None], more: dict[str, bytes]
) -> Path:
    """Copy an FMU with another content of one file, None for none, and with ``more`` files."""
    bad = good.with_name("bad.fmu")
    with zipfile.ZipFile(good) as read, zipfile.ZipFile(bad, "w") as write:
        for entry in read.namelist():
            content: bytes | None = read.read(entry)
            if entry == name:
                before, content = content, change(read.read(entry))
                assert content != before
            if content is not None:
                write.writestr(entry, content)
        for entry, content in more.items():
            write.writestr(entry, content)
    return bad


def notes(result: Validation) -> str:
    return " | ".join(f"{row.quantity}: {row.note}" for row in result.failures)


@pytest.mark.parametrize("name", FOREIGN)
def test_a_right_fmu_passes(name: str, tmp_path: Path) -> None:
    result = inspect([FOREIGN[name].write(tmp_path)])
    assert notes(result) == ""
    assert result.claims == ("files",)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["python", "native", "fmi3"])
def test_ours_pass(kind: str, tmp_path: Path) -> None:
    result = inspect([build(model("torque_motor"), tmp_path / "it.fmu", kind)])
    assert notes(result) == ""


XML = "modelDescription.xml"
LINUX2, LINUX3 = "binaries/linux64/lag.so", "binaries/x86_64-linux/oscillator.so"


def text(old: str, new: str) -> Callable[[bytes], bytes]:
    def change(content: bytes) -> bytes:
        assert old.encode() in content
        return content.replace(old.encode(), new.encode())

    return change


def same(content: bytes) -> bytes:
    return content + b"\n"


def none(content: bytes) -> None:
    return None


FAULTS: dict[str, tuple[str, str, Callable[[bytes], bytes | None], dict[str, bytes], str]] = {
    "a unit that nobody defines": (
        "lag",
        XML,
        text('<Unit name="rad"/>', ""),
        {},
        'rules of FMI, by fmpy: The unit "rad" of variable "y"',
    ),
    "an attribute that FMI has not": (
        "lag",
        XML,
        text("modelName=", "weight='1' modelName="),
        {},
        "rules of FMI",
    ),
    "inputs that share a reference": (
        "lag",
        XML,
        text('valueReference="17"', 'valueReference="16"'),
        {},
        "['gain', 'tau'] share one",
    ),
    "outputs of FMI 3.0 that share one": (
        "oscillator",
        XML,
        text('valueReference="9"', 'valueReference="8"'),
        {},
        "has the same value reference as variable",
    ),
    "a start value out of bounds": (
        "lag",
        XML,
        text('start="0.1"', 'start="0.1" min="0.2"'),
        {},
        "'tau' starts at 0.1, outside its bounds",
    ),
    "bounds that are swapped": (
        "lag",
        XML,
        text('start="0.1"', 'start="0.1" min="2" max="1"'),
        {},
        "min 2 above max 1",
    ),
    "an output that the structure has not": (
        "lag",
        XML,
        text('<Outputs><Unknown index="2"/></Outputs>', ""),
        {},
        "ModelStructure/Outputs must have exactly one entry for each variable",
    ),
    "no library": (
        "lag",
        LINUX2,
        none,
        {"binaries/linux64/other.so": b"x"},
        "it has no binaries/linux64/lag.so",
    ),
    "nothing to run": ("lag", LINUX2, none, {}, "neither a binary nor sources"),
    "a text for a library": ("lag", LINUX2, lambda content: b"library", {}, "no shared library"),
    "a library that is cut": (
        "lag",
        LINUX2,
        lambda content: content[:200],
        {},
        "not exported: fmi2",
    ),
    "a library of another processor": (
        "lag",
        LINUX2,
        lambda content: content[:18] + b"\xb7\x00" + content[20:],
        {},
        "is ELF for aarch64, not ELF for x86_64",
    ),
    "a function that is not exported": (
        "lag",
        LINUX2,
        lambda content: content.replace(b"fmi2DoStep\0", b"fmi2DoStop\0"),
        {},
        "functions that are not exported: fmi2DoStep",
    ),
    "a getter that is not exported": (
        "oscillator",
        LINUX3,
        lambda content: content.replace(b"fmi3GetFloat64\0", b"fmi3GetFloat46\0"),
        {},
        "fmi3GetFloat64",
    ),
    "sources that nobody lists": (
        "lag",
        XML,
        same,
        {"sources/lag.c": b"int x;"},
        "files that are listed",
    ),
    "a listed source that is not there": (
        "lag",
        XML,
        lambda content: content.replace(
            b'="true"/>',
            b'="true"><SourceFiles><File name="lag.c"/></SourceFiles></CoSimulation>',
            1,
        ),
        {"sources/other.c": b"int x;"},
        "files that are listed and not there: lag.c",
    ),
    "a run that ends before it starts": (
        "lag",
        XML,
        text("<ModelVariables>", '<DefaultExperiment startTime="2" stopTime="1"/><ModelVariables>'),
        {},
        "it stops at 1 s",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_named(fault: str, tmp_path: Path) -> None:
    name, entry, change, more, told = FAULTS[fault]
    result = inspect([changed(FOREIGN[name].write(tmp_path), entry, change, more)])
    assert told in notes(result)


def test_what_is_no_fault_is_told(tmp_path: Path) -> None:
    more = {"resources/run.sh": b"#!/bin/sh\n", "notes.txt": b"x", "binaries/riscv/lag.so": b"x"}
    result = inspect([changed(FOREIGN["lag"].write(tmp_path), XML, same, more)])
    assert result.passed
    told = " | ".join(f"{row.quantity}: {row.note}" for row in result.rows)
    for words in (
        "code beside the binaries: resources/run.sh",
        "outside the folders of FMI: notes.txt",
        "platforms that are not looked at: riscv",
    ):
        assert words in told


def test_nothing_is_loaded_or_started(tmp_path: Path) -> None:
    global watched  # noqa: PLW0603  (a hook cannot be taken away)
    path = FOREIGN["lag"].write(tmp_path)
    inspect([path])  # what Python itself loads on the way is there now
    watched = []
    try:
        inspect([path])
        seen = list(watched)
    finally:
        watched = None
    assert seen == []


def test_path_tricks_are_refused(tmp_path: Path) -> None:
    path = changed(FOREIGN["lag"].write(tmp_path), XML, same, {"../outside": b"x"})
    with pytest.raises(UserError, match="would be written outside its folder"):
        inspect([path])
    assert not (tmp_path.parent / "outside").exists()


def test_the_command_says_what_it_cannot_see(tmp_path: Path, run: Run) -> None:
    path = FOREIGN["lag"].write(tmp_path)
    page = tmp_path / "page.html"
    code, out, err = run("validate", path, "--static-only", "--report", page)
    assert (code, err) == (0, "")
    assert "by files alone" in out
    assert "Nothing was loaded or run" in page.read_text()
    code, _, err = run("validate", path, "--static-only", "--reference", path)
    assert (code, "runs nothing" in err) == (2, True)


def test_a_library_is_known_for_any_system(tmp_path: Path) -> None:
    """FMPy has one of a single function for each, built by the tools of that system."""
    folder = Path(fmpy.__file__).parent / "logging"
    built = ["linux64/logging.so", "win64/logging.dll", "darwin64/logging.dylib"]
    so, dll, dylib = ((folder / name).read_bytes() for name in built)
    places = {
        "win64": "dll",
        "x86_64-windows": "dll",
        "darwin64": "dylib",
        "aarch64-darwin": "dylib",
    }

    def told(contents: dict[str, bytes], check: str) -> dict[str, str]:
        more = {f"binaries/{place}/lag.{it}": contents[it] for place, it in places.items()}
        failed = inspect([changed(FOREIGN["lag"].write(tmp_path), XML, same, more)]).failures
        return {row.case: row.note for row in failed if row.quantity == check}

    assert {*told({"dll": dll, "dylib": dylib}, "functions that are not exported")} == {*places}
    assert told({"dll": so, "dylib": dll}, "library") == {
        "win64": "lag.dll is ELF for x86_64, not PE for x86_64",
        "x86_64-windows": "lag.dll is ELF for x86_64, not PE for x86_64",
        "darwin64": "lag.dylib is PE for x86_64, not Mach-O for x86_64",
        "aarch64-darwin": "lag.dylib is PE for x86_64, not Mach-O for aarch64",
    }
    wrong = told({"dll": dylib, "dylib": dylib}, "library")
    assert wrong["win64"] == "lag.dll is Mach-O for x86_64, aarch64, not PE for x86_64"
