"""C sources to shared libraries: the host's compiler for its own platform, zig for every one.

The bytes of a library tell its sources and its compiler, and nothing of who built it, when and in
which folder; the numbers that it computes are those of the C text, operation by operation.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import platform
import shlex
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from servo_models.errors import UserError
from servo_models.files import cache_folder, cached, scratch


@dataclass(frozen=True)
class Target:
    """A platform that a library is built for."""

    name: str
    fmi2_folders: tuple[str, ...]
    fmi3_folder: str
    suffix: str
    zig_triple: str


TARGETS = (
    Target("linux-x86_64", ("linux64",), "x86_64-linux", ".so", "x86_64-linux-gnu.2.17"),
    # FMI 2.0.4 says aarch64-linux, hosts look into linux64: both, in an FMU of its own
    Target(
        "linux-aarch64",
        ("linux64", "aarch64-linux"),
        "aarch64-linux",
        ".so",
        "aarch64-linux-gnu.2.17",
    ),
    Target("windows-x86_64", ("win64",), "x86_64-windows", ".dll", "x86_64-windows-gnu"),
    # FMI 2.0 has one name for both: put them together with `universal`
    Target("macos-x86_64", ("darwin64",), "x86_64-darwin", ".dylib", "x86_64-macos.11.0"),
    Target("macos-aarch64", ("darwin64",), "aarch64-darwin", ".dylib", "aarch64-macos.11.0"),
)

ROUNDED_BY_THE_LIBRARY = (
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "cbrt", "hypot"),
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2"),
    *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "erf", "erfc", "tgamma", "lgamma"),
)
"""Functions that compilers may compute at build time, or put others in place of, e.g. x * x for
pow(x, 2): the last bit then is not that of the platform's library."""
FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-I."),
    *("-Wall", "-Wextra", "-Werror=date-time"),  # any other warning must not stop a user's build
    *(f"-fno-builtin-{name}" for name in ROUNDED_BY_THE_LIBRARY),
)
ELF_FLAGS = ("-fPIC", "-s", "-Wl,--build-id=none", "-Wl,-z,defs", "-lm")
ZIG_FLAGS = {".so": ELF_FLAGS, ".dll": ("-s",), ".dylib": ("-fPIC", "-s")}
HOST_FLAGS = {
    ".so": ELF_FLAGS,
    ".dll": ("-s", "-static-libgcc", "-Wl,--no-insert-timestamp"),
    ".dylib": ("-fPIC", "-Wl,-x,-S"),
}
"""Flags by suffix; they stand behind the sources, since a library serves what comes before it."""
LINES_OF_AN_ERROR = 6  # lines of a compiler's complaint that are told, at most
INSTALL = 'pip install ".[native]"'  # how to get a compiler


@dataclass(frozen=True)
class Compiler:
    """A C compiler that was found, and what it can build for."""

    command: tuple[str, ...]
    version: str
    targets: tuple[Target, ...]
    is_zig: bool


def here() -> Target | None:
    """Return the platform of this process, None if it is no target."""
    name = _name(f"{platform.machine()}-{platform.system()}".lower())
    return next((target for target in TARGETS if target.name == name), None)


def compiler() -> Compiler | None:
    """Return zig if it is installed, else the host's compiler, else None."""
    return zig() or host()


def needed_compiler() -> Compiler:
    """Return the compiler.

    Raises:
        UserError: there is none.
    """
    installed = compiler()
    if installed is None:
        named = f"; it is '{os.environ['CC']}'" if os.environ.get("CC") else ""
        raise UserError(
            f"no C compiler was found: {INSTALL}, or set CC to one for a platform of FMI{named}"
        )
    return installed


def zig() -> Compiler | None:
    """Return the compiler of the ziglang wheel, which builds for every target."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    command = (sys.executable, "-m", "ziglang", "cc")
    return Compiler(command, f"zig {metadata.version('ziglang')}", TARGETS, is_zig=True)


def host() -> Compiler | None:
    """Return the compiler that $CC names, else the first on the PATH; None if none is for a
    target.

    Raises:
        UserError: $CC is no command.
    """
    named = _words(os.environ.get("CC", ""))
    for command in [named] if named else [["cc"], ["gcc"], ["clang"]]:
        if shutil.which(command[0]) is not None:
            machine, version = _said([*command, "-dumpmachine"]), _said([*command, "--version"])
            targets = tuple(target for target in TARGETS if target.name == _name(machine))
            if targets and version:
                return Compiler(tuple(command), version, targets, is_zig=False)
    return None


def for_this_processor(compiler: Compiler) -> tuple[tuple[str, ...], str]:
    """Return the flags for the processor of this machine, and what the compiler takes it for.

    There are none where the compiler has none.  A library for another processor may not run.
    """
    flags = ("-march=native",)
    macros = _said([*compiler.command, *flags, "-dM", "-E", "-x", "c", os.devnull])
    return (flags, macros) if macros else ((), "")


def _words(command: str) -> list[str]:
    """The words of a command, which is one where it is a path, backslashes and spaces included."""
    if shutil.which(command) is not None:
        return [command]
    try:
        return shlex.split(command)
    except ValueError as error:
        raise UserError(f"CC = {command}: {error}; correct it") from error


def _said(words: Sequence[str]) -> str:
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _name(machine: str) -> str:
    """The name of the target that compilers call e.g. ``arm64-apple-darwin23.1.0``."""
    cpu, _, rest = machine.partition("-")
    systems = {"linux": "linux", "mingw": "windows", "windows": "windows", "darwin": "macos"}
    system = next((name for word, name in systems.items() if word in rest), "none")
    return f"{system}-{ {'arm64': 'aarch64', 'amd64': 'x86_64'}.get(cpu, cpu) }"


def compile_library(
    compiler: Compiler,
    target: Target,
    sources: Mapping[str, bytes],
    main: str,
    includes: Sequence[Path] = (),
) -> bytes:
    """Return the stripped shared library of ``main``, which includes other ``sources`` of its
    folder and headers of ``includes``, from the cache if it was built before.

    Raises:
        UserError: the compiler is not for the target, or refuses the sources.
    """
    if target not in compiler.targets:
        known = ", ".join(one.name for one in compiler.targets)
        raise UserError(
            f"'{compiler.command[0]}' builds for {known} only, not for {target.name}: {INSTALL}"
        )
    headers = {h.name: h.read_bytes() for folder in includes for h in sorted(folder.glob("*.h"))}
    files = {**headers, **sources}
    digests = [f"{name} {_sha256(content)}" for name, content in sorted(files.items())]
    return cached_library(compiler, target, digests, main, lambda: files).read_bytes()


def cached_library(
    compiler: Compiler,
    target: Target,
    made_of: Sequence[str],
    main: str,
    sources: Callable[[], Mapping[str, bytes]],
    flags: Sequence[str] = (),
) -> Path:
    """Return the file of a library in the cache, ``made_of`` what identifies its sources; they are
    written only to build it.

    Raises:
        UserError: the compiler refuses the sources.
    """
    library = f"{Path(main).stem}{target.suffix}"
    words = [*FLAGS, *flags, main, "-o", library]
    if compiler.is_zig:
        words = ["-target", target.zig_triple, *words, *ZIG_FLAGS[target.suffix]]
    else:
        words += HOST_FLAGS[target.suffix]

    def make(folder: Path) -> None:
        built = _compile(compiler, words, sources(), library, target.name)
        (folder / library).write_bytes(built)

    told = json.dumps([compiler.version, compiler.command, words, *made_of])
    return cached(f"native-{target.name}-{_sha256(told.encode())[:32]}", make) / library


def _compile(
    compiler: Compiler, words: Sequence[str], files: Mapping[str, bytes], library: str, name: str
) -> bytes:
    """Run the compiler in a folder that holds the files alone, so that no path gets into a
    library."""
    zig_cache = cache_folder() / "zig"
    if compiler.is_zig and not zig_cache.exists():
        print(
            "servo-models: zig first builds the C library of each platform: this takes minutes,"
            " once",
            file=sys.stderr,
        )
    with scratch() as folder:
        for file, content in files.items():
            (folder / file).write_bytes(content)
        environment = {
            **os.environ,
            "LC_ALL": "C",
            "ZIG_GLOBAL_CACHE_DIR": str(zig_cache),
            "ZIG_LOCAL_CACHE_DIR": str(folder / "zig"),
        }
        try:
            done = subprocess.run(
                [*compiler.command, *words],
                cwd=folder,
                env=environment,
                capture_output=True,
                check=False,
            )
        except OSError as error:
            raise UserError(f"cannot run '{compiler.command[0]}': {error}; {INSTALL}") from error
        if done.returncode == 0 and (folder / library).is_file():
            return (folder / library).read_bytes()
    lines = [line for line in done.stderr.decode(errors="replace").splitlines() if line.strip()]
    raise UserError(
        f"'{shlex.join(compiler.command)}' could not build for {name}:"
        f" {' | '.join(lines[:LINES_OF_AN_ERROR])}; correct the sources or take another compiler"
    )


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


FAT_MAGIC = 0xCAFEBABE  # first number of a Mach-O file of several processors
FAT_ALIGN = 14  # exponent of 2 of the alignment of its slices [bytes]: a page of ARM


def universal(slices: Sequence[bytes]) -> bytes:
    """Return one Mach-O file for the processors of several."""
    header = struct.pack(">II", FAT_MAGIC, len(slices))
    page = 1 << FAT_ALIGN
    body = b""
    for content in slices:
        cpu, subtype = struct.unpack_from("<II", content, 4)
        body += bytes(-len(body) % page)
        header += struct.pack(">IIIII", cpu, subtype, page + len(body), len(content), FAT_ALIGN)
        body += content
    return header.ljust(page, b"\0") + body
