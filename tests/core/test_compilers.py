"""C sources become the same library everywhere, and it computes what the C text says."""

from __future__ import annotations

import ctypes
import math
import os
import platform
import random
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from servo_models.core.compilers import (
    TARGETS,
    Compiler,
    Target,
    compile_library,
    compiler,
    host,
    needed_compiler,
    universal,
    zig,
)
from servo_models.errors import UserError
from servo_models.files import cache_folder
from tests.support.binaries import read_binary, slices

EXPORT = """
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
"""
MAIN = b"""
#include <math.h>
#include "export.h"
#include "hidden.c"
EXPORT double decay(double x) { return exp(-x) * sqrt(x) + hidden(x) * x; }
EXPORT double squared(double x) { return pow(x, 2.0); }
EXPORT double sine(double x) { return sin(x); }
EXPORT double cosine(double x) { return cos(x); }
EXPORT double arc(double x) { return atan(x); }
EXPORT const char *source(void) { return __FILE__; }
double unmarked(double x) { return x + 1.0; }
"""
SOURCES = {
    "main.c": MAIN,
    "hidden.c": b"static double hidden(double x) { return cos(x) + 0.1; }",
    "export.h": EXPORT.encode(),
}
EXPORTS = {"decay", "squared", "sine", "cosine", "arc", "source"}
OF_THE_LINKER = {"_mh_dylib_header", "__dso_handle"}
"""Zig's exports them for macOS, where names belong to a library each."""
FUNCTIONS = {"sine": math.sin, "cosine": math.cos, "arc": math.atan}

ZIG, HOST = zig(), host()
with_zig = pytest.mark.skipif(ZIG is None, reason="ziglang is not installed")
with_host = pytest.mark.skipif(HOST is None, reason="no C compiler on the PATH")
COMPILERS = [
    pytest.param(HOST, id="host", marks=with_host),
    pytest.param(ZIG, id="zig", marks=with_zig),
]
HERE = f"{platform.system()}-{platform.machine()}".lower().replace("darwin", "macos")
NATIVE = {"windows-amd64": "windows-x86_64", "macos-arm64": "macos-aarch64"}.get(HERE, HERE)
EVERY = [pytest.param(it, id=it.name, marks=pytest.mark.thorough) for it in TARGETS]


def native(made_by: Compiler) -> Target:
    """The target that this machine runs."""
    for target in made_by.targets:
        if target.name == NATIVE:
            return target
    pytest.skip(f"'{made_by.command[0]}' builds nothing for {NATIVE}")


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A cache without libraries; what zig has made for itself is the usual one's."""
    usual = cache_folder() / "zig"
    usual.mkdir(exist_ok=True)
    folder = tmp_path / "an empty cache"
    folder.mkdir()
    (folder / "zig").symlink_to(usual)
    monkeypatch.setenv("SERVO_MODELS_CACHE", str(folder))
    cache_folder.cache_clear()
    yield folder
    cache_folder.cache_clear()


def loaded(content: bytes, path: Path) -> ctypes.CDLL:
    path.write_bytes(content)
    library = ctypes.CDLL(str(path))
    for name in EXPORTS - {"source"}:
        getattr(library, name).restype = ctypes.c_double
        getattr(library, name).argtypes = [ctypes.c_double]
    library.source.restype = ctypes.c_char_p
    return library


@pytest.mark.parametrize("made_by", COMPILERS)
def test_it_computes_what_python_computes(made_by: Compiler, tmp_path: Path) -> None:
    target = native(made_by)
    content = compile_library(made_by, target, SOURCES, "main.c")
    library = loaded(content, tmp_path / f"library{target.suffix}")
    numbers = random.Random(1)
    for _ in range(2000):
        x = numbers.uniform(0.0, 50.0)
        assert library.decay(x) == math.exp(-x) * math.sqrt(x) + (math.cos(x) + 0.1) * x
        for name, function in FUNCTIONS.items():
            assert getattr(library, name)(x) == function(x)
    assert library.source() == b"main.c"


@pytest.mark.parametrize("made_by", COMPILERS)
def test_no_other_function_is_put_in_place(made_by: Compiler, tmp_path: Path) -> None:
    """Compilers like to write x * x for pow(x, 2), whose last bit is another now and then."""
    target = native(made_by)
    numbers = random.Random(1)
    candidates = (numbers.uniform(1.0, 2.0) for _ in range(100_000))
    x = next((x for x in candidates if math.pow(x, 2.0) != x * x), None)
    if x is None:
        pytest.skip("pow(x, 2) of this platform's library is x * x")
    content = compile_library(made_by, target, SOURCES, "main.c")
    assert loaded(content, tmp_path / f"it{target.suffix}").squared(x) == math.pow(x, 2.0)


@pytest.mark.parametrize("made_by", COMPILERS)
def test_the_bytes_tell_neither_folder_nor_user(
    made_by: Compiler, tmp_path: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = native(made_by)
    check_reproducible(made_by, target, tmp_path, empty_cache, monkeypatch)


@with_zig
@pytest.mark.parametrize("target", EVERY)
def test_the_bytes_tell_neither_folder_nor_user_on_any_platform(
    target: Target, tmp_path: Path, empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ZIG is not None
    check_reproducible(ZIG, target, tmp_path, empty_cache, monkeypatch)


def check_reproducible(
    made_by: Compiler, target: Target, folder: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built = []
    for name in ("one", "another and longer"):
        (folder / name).mkdir()
        monkeypatch.setattr("tempfile.tempdir", str(folder / name))
        monkeypatch.setenv("USER", name)
        monkeypatch.chdir(folder / name)
        built.append(compile_library(made_by, target, SOURCES, "main.c"))
        assert list((folder / name).iterdir()) == [], "scratch files stay"
        (entry,) = cache.glob("native-*")
        entry.rename(folder / f"built in {name}")
    assert built[0] == built[1]
    assert str(folder).encode() not in built[0]
    assert {path.name for path in cache.iterdir()} == {"zig"}


@with_zig
@pytest.mark.parametrize("target", [pytest.param(TARGETS[0], id=TARGETS[0].name), *EVERY[1:]])
def test_the_headers_are_those_of_the_platform(target: Target) -> None:
    assert ZIG is not None
    found = read_binary(compile_library(ZIG, target, SOURCES, "main.c"))
    system, machine = target.name.split("-")
    assert found.kind == {"linux": "ELF", "windows": "PE", "macos": "Mach-O"}[system]
    assert found.machine == machine
    assert found.exports - OF_THE_LINKER == EXPORTS
    assert not found.has_local_symbols
    assert not found.search_paths
    assert not found.dated
    if system == "linux":
        assert found.newest_glibc <= (2, 17)
        assert found.needs == {"libm.so.6"}
    elif system == "windows":
        assert all(name.startswith(("api-ms-win-crt-", "KERNEL32")) for name in found.needs)
    else:
        assert found.needs == {"/usr/lib/libSystem.B.dylib"}
        assert found.oldest_macos == (11, 0)
        assert found.signed or machine == "x86_64"


@with_host
def test_the_hosts_library_has_the_marked_exports_only() -> None:
    assert HOST is not None
    found = read_binary(compile_library(HOST, HOST.targets[0], SOURCES, "main.c"))
    assert found.machine in HOST.targets[0].name
    assert found.exports == EXPORTS
    assert not found.has_local_symbols


@with_zig
@pytest.mark.thorough
def test_a_universal_library_holds_both() -> None:
    assert ZIG is not None
    parts = [compile_library(ZIG, it, SOURCES, "main.c") for it in TARGETS if it.suffix == ".dylib"]
    assert len(parts) == 2
    assert slices(universal(parts)) == parts
    assert {read_binary(part).machine for part in parts} == {"x86_64", "aarch64"}


def test_folders_of_the_standard() -> None:
    folders = {target.name: (*target.fmi2_folders, target.fmi3_folder) for target in TARGETS}
    assert folders == {
        "linux-x86_64": ("linux64", "x86_64-linux"),
        "linux-aarch64": ("linux64", "aarch64-linux", "aarch64-linux"),
        "windows-x86_64": ("win64", "x86_64-windows"),
        "macos-x86_64": ("darwin64", "x86_64-darwin"),
        "macos-aarch64": ("darwin64", "aarch64-darwin"),
    }


FAULTS = {
    "a date": (b"const char *when(void) { return __DATE__; }", "__DATE__"),
    "no such file": (b'#include "missing.h"', "missing.h"),
    "no such function": (
        b"double f(double);" + EXPORT.encode() + b"EXPORT double g(double x) { return f(x); }",
        "f",
    ),
}


@pytest.mark.parametrize("made_by", COMPILERS)
@pytest.mark.parametrize("fault", FAULTS)
def test_faulty_sources_are_refused(made_by: Compiler, fault: str, empty_cache: Path) -> None:
    text, told = FAULTS[fault]
    with pytest.raises(UserError, match=r"could not build for .*main\.c.*correct") as caught:
        compile_library(made_by, native(made_by), {"main.c": text}, "main.c")
    assert told in str(caught.value)
    assert list(empty_cache.glob("native-*")) == []


@with_host
def test_headers_come_from_folders_and_their_content_counts(tmp_path: Path) -> None:
    assert HOST is not None
    target = native(HOST)
    main = b'#include "export.h"\n#include <number.h>\nEXPORT int number(void) { return N; }'
    for number in (3, 4):
        (tmp_path / "number.h").write_text(f"#define N {number}")
        sources = {"main.c": main, "export.h": EXPORT.encode()}
        content = compile_library(HOST, target, sources, "main.c", [tmp_path])
        path = tmp_path / f"{number}{target.suffix}"
        path.write_bytes(content)
        assert ctypes.CDLL(str(path)).number() == number


@with_host
def test_a_second_build_is_read_from_the_cache(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert HOST is not None
    target = native(HOST)
    first = compile_library(HOST, target, SOURCES, "main.c")
    monkeypatch.setattr("subprocess.run", None)
    assert compile_library(HOST, target, SOURCES, "main.c") == first


@with_host
def test_the_words_in_cc_count(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert HOST is not None
    target = native(HOST)
    text = EXPORT.encode() + b"EXPORT int number(void) { return NUMBER; }"
    for number in (3, 4):
        monkeypatch.setenv("CC", f"{HOST.command[0]} -DNUMBER={number}")
        found = host()
        assert found is not None
        path = tmp_path / f"{number}{target.suffix}"
        path.write_bytes(compile_library(found, target, {"main.c": text}, "main.c"))
        assert ctypes.CDLL(str(path)).number() == number


def test_the_first_build_of_zig_says_that_it_takes_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A script stands for zig, which fills its cache."""
    script = tmp_path / "zig.py"
    script.write_text(
        "import os, pathlib, sys\n"
        "pathlib.Path(os.environ['ZIG_GLOBAL_CACHE_DIR'], 'libc').mkdir(parents=True)\n"
        "pathlib.Path(sys.argv[sys.argv.index('-o') + 1]).write_text('a library')\n"
    )
    slow = Compiler((sys.executable, str(script)), "zig", TARGETS, is_zig=True)
    monkeypatch.setenv("SERVO_MODELS_CACHE", str(tmp_path / "cache"))
    cache_folder.cache_clear()
    try:
        assert compile_library(slow, TARGETS[0], SOURCES, "main.c") == b"a library"
        assert "minutes" in capsys.readouterr().err
        script.write_text(script.read_text().replace("parents=True", "exist_ok=True"))
        compile_library(slow, TARGETS[1], SOURCES, "main.c")
        assert capsys.readouterr().err == ""
    finally:
        cache_folder.cache_clear()


@with_host
def test_the_hosts_compiler_is_refused_for_other_platforms() -> None:
    assert HOST is not None
    other = next(target for target in TARGETS if target not in HOST.targets)
    with pytest.raises(UserError, match=rf"not for {other.name}: pip install"):
        compile_library(HOST, other, SOURCES, "main.c")


def test_no_compiler_is_told_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CC", "no-such-cc")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert compiler() is None
    with pytest.raises(UserError, match=r'pip install "\.\[native\]", or set CC.*no-such-cc'):
        needed_compiler()


@pytest.mark.skipif(os.name == "nt", reason="a script stands for a compiler")
def test_cc_names_the_compiler_and_the_compiler_its_platform(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = tmp_path / "my cc"
    script.write_text(f"#!{sys.executable}\nprint('arm64-apple-darwin23.1.0')\n")
    script.chmod(0o755)
    monkeypatch.setenv("CC", f"'{script}' -pipe")
    found = host()
    assert found is not None
    assert found.command == (str(script), "-pipe")
    assert [target.name for target in found.targets] == ["macos-aarch64"]
    monkeypatch.setenv("CC", str(script))  # not split at the space, as paths on Windows would be
    found = host()
    assert found is not None
    assert found.command == (str(script),)
    script.write_text(f"#!{sys.executable}\nprint('riscv64-linux-gnu')\n")
    assert host() is None


def test_a_quote_in_cc_without_its_other_one_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", '"gcc')
    with pytest.raises(UserError, match='CC = "gcc: No closing quotation'):
        host()
