"""Outputs are written whole or not at all; the cache holds what it was given, or makes it anew.

What is being written has a name of its own, which tells the process: what a killed one has left
is removed by the next that writes there.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import glob
import hashlib
import json
import math
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path

from servo_models.errors import UserError

SEAL = "sealed.json"
"""File of a cache entry with its name and the SHA-256 of every other file in it."""
_HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
_DAY = 86400.0
"""Age [s] at which what another host began to write is left over too."""


def write_with(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then move it into place.

    A crash, of the machine too, leaves the old file as it was.  The temporary file keeps the
    suffix, since writers choose their format by it.

    Raises:
        UserError: the folder cannot be made or written.
    """
    part = _beside(path)
    try:
        write(part)
        mask = os.umask(0)
        os.umask(mask)
        part.chmod(0o666 & ~mask)
        _to_disk(part)
        part.replace(path)
        _to_disk(path.parent)
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


largest_input: ContextVar[int] = ContextVar("largest_input", default=256 << 20)
"""Bytes that a file of measurements may have, and what is read from it may take."""


def read_regular(path: Path, largest: int | None = None) -> bytes:
    """Return what stands in a file, if it is a regular file of no more than ``largest`` bytes.

    Raises:
        UserError: it is missing, may not be read, is a pipe or a device, or is too large.
    """
    try:
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            raise UserError(f"cannot read '{path}': it is no regular file; copy it into one")
        check_size(path, about.st_size, largest)
        return path.read_bytes()
    except OSError as error:
        raise UserError(
            f"cannot read '{path}': {error.strerror or error}; name a file that you may read"
        ) from error
    except ValueError as error:  # a NUL in the name
        raise UserError(f"cannot read '{path}': {error}; correct the name") from error


def matching(folder: Path, pattern: str) -> list[Path]:
    """Return the files that a pattern names as seen from a folder, in natural order.

    ``*``, ``?`` and ``[...]`` stand for parts of a name, ``**`` for folders; ``run_2`` is before
    ``run_10``.  A file of that very name is the only one.
    """
    try:
        if (folder / pattern).is_file():
            return [folder / pattern]
        names = glob.glob(os.path.join(glob.escape(str(folder)), pattern), recursive=True)
        return sorted(filter(Path.is_file, map(Path, names)), key=_natural)
    except (OSError, ValueError):  # a text that is no name at all
        return []


def _natural(path: Path) -> tuple[list[str | int], str]:
    """Digits of a name as numbers, which stand between texts."""
    parts = re.split(r"([0-9]+)", path.as_posix())
    return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.as_posix()


def check_size(path: Path, size: float, most: int | None = None) -> None:
    """Refuse a file with ``size`` bytes in it, or in what it would be read to.

    Raises:
        UserError: it is more than ``most``, by default ``largest_input``.
    """
    limit = largest_input.get() if most is None else most
    if size > limit:
        cure = f", or allow it by --largest {math.ceil(size / 2**20)}" if most is None else ""
        raise UserError(
            f"'{path}' would take {size / 2**20:.4g} MB, more than {limit / 2**20:.4g}: cut"
            f" it{cure}"
        )


def check_writable(path: Path) -> None:
    """Find out before long work whether ``write_with`` can write ``path`` after it.

    Raises:
        UserError: it cannot.
    """
    _beside(path).unlink()
    if path.is_dir():
        raise UserError(f"cannot write '{path}': it is a folder; name a file")


def _beside(path: Path) -> Path:
    """An empty temporary file beside ``path``, whose folder is made."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path.parent)
        handle, name = tempfile.mkstemp(prefix=_prefix(), suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise UserError(
            f"cannot write '{path}': {error.strerror or error}; choose a folder that you may write"
        ) from error
    os.close(handle)
    return Path(name)


def write_whole(path: Path, content: bytes) -> None:
    """Write ``content`` to ``path`` through a temporary file; see ``write_with``."""
    write_with(path, lambda part: part.write_bytes(content))


def cached(name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder of the cache with what ``make`` has put into it, now or in an earlier run.

    Every file is compared with the digest that it had when it was made.  A folder in which one
    differs, is missing or is new is made again, with a line on standard error.

    Args:
        name: of the folder; it has to tell what is in it and what made it, as a digest does.
        make: is given an empty folder to fill.

    Raises:
        UserError: the cache cannot be written.
    """
    folder = cache_folder() / name
    if _sealed(folder):
        return folder
    if folder.exists():
        print(f"servo-models: '{folder}' was damaged and is made again", file=sys.stderr)
    try:
        part = Path(tempfile.mkdtemp(prefix=_prefix(), dir=folder.parent))
        try:
            make(part)
            digests = _digests(part)
            (part / SEAL).write_text(json.dumps({"name": folder.name, "sha256": digests}))
            for file in (*(part / one for one in digests), part / SEAL, part):
                _to_disk(file)
            _put(part, folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    except OSError as error:
        raise UserError(
            f"cannot write the cache '{folder.parent}': {error.strerror or error}; set"
            " SERVO_MODELS_CACHE to a folder that you may write"
        ) from error
    return folder


def _put(part: Path, folder: Path) -> None:
    """Move a made folder into place; what another process has put there meanwhile is as good."""
    if folder.exists() and not _sealed(folder):
        shutil.rmtree(folder, ignore_errors=True)
        with contextlib.suppress(OSError):  # something that is no folder
            folder.unlink()
    try:
        part.rename(folder)
    except OSError:
        if not _sealed(folder):
            raise
    _to_disk(folder.parent)


def _digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a cache entry but the seal, by its path inside."""
    files = (file for file in sorted(folder.rglob("*")) if not file.is_dir())
    return {
        file.relative_to(folder).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
        if file != folder / SEAL
    }


def _not_private(folder: Path) -> str:
    """Why somebody else may have put into a folder what is there, "" if nobody can have."""
    if os.name == "nt":  # a folder of the user is nobody else's there
        return ""
    about = folder.stat()
    if about.st_uid != os.geteuid():
        return "is not yours"
    return "may be written by others" if about.st_mode & 0o022 else ""


def _sealed(folder: Path) -> bool:
    """Whether a cache entry is there, as it was made and under the name it was made for."""
    try:
        if _not_private(folder):
            return False
        seal = {"name": folder.name, "sha256": _digests(folder)}
        return bool(json.loads((folder / SEAL).read_bytes()) == seal)
    except (OSError, ValueError, RecursionError):
        return False


def scratch_folder() -> Path:
    """Return a new temporary folder; what killed processes have left of theirs goes first."""
    _sweep(Path(tempfile.gettempdir()))
    return Path(tempfile.mkdtemp(prefix=_prefix()))


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """A temporary folder that goes at the end."""
    folder = scratch_folder()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@functools.cache
def cache_folder() -> Path:
    """Return the user's cache folder, or one temporary folder where that cannot be written.

    So it is where others may write it, with a line on standard error: what is in it is loaded and
    run.  ``SERVO_MODELS_CACHE`` keeps it elsewhere.  It is looked up once a process.
    """
    base = os.environ.get("SERVO_MODELS_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "servo-models"
    )
    folder = Path(base).absolute()
    try:
        folder.mkdir(0o700, parents=True, exist_ok=True)
        if odd := _not_private(folder):
            print(
                f"servo-models: the cache '{folder}' {odd}, so nothing is loaded from it: remove"
                " it, or set SERVO_MODELS_CACHE to a folder of your own",
                file=sys.stderr,
            )
        elif os.access(folder, os.W_OK):
            _sweep(folder)
            return folder
    except OSError:
        pass
    folder = scratch_folder()
    atexit.register(_remove_own, folder, os.getpid())
    return folder


def _remove_own(folder: Path, process: int) -> None:
    """Remove the temporary cache when the process that made it ends, not one forked from it."""
    if os.getpid() == process:
        shutil.rmtree(folder, ignore_errors=True)


def _prefix() -> str:
    """How names of what this process is writing begin."""
    return f".part-{_HOST}-{os.getpid()}-"


def _sweep(folder: Path) -> None:
    """Remove what processes that are gone had begun to write in a folder."""
    for part in folder.glob(".part-*-*-*"):
        _, _, rest = part.name.partition(".part-")
        host, process, *_ = rest.split("-")
        with contextlib.suppress(OSError):
            ended = host == _HOST and process.isdigit() and not _runs(int(process))
            if ended or time.time() - part.stat().st_mtime > _DAY:
                shutil.rmtree(part) if part.is_dir() else part.unlink()


def _runs(process: int) -> bool:
    if os.name == "nt":  # os.kill would end it; what is left there goes after a day
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def _to_disk(path: Path) -> None:
    """Wait until a file or folder is on the disk, where the system can."""
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
