"""Outputs are written whole or not at all; the cache holds what it was given, or makes it anew.

What is being written lies in a folder such as ``.servo-models-x1_k09ab.part`` beside the output,
with a file that is locked meanwhile.  What a killed process has left is not locked: the next that
writes there removes it.
"""

from __future__ import annotations

import atexit
import contextlib
import errno
import functools
import glob
import hashlib
import json
import math
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from pathlib import Path

from servo_models.errors import CuredError, UserError

SEAL = "sealed.json"  # file of a cache entry: its name and the SHA-256 of its other files
_PREFIX, _SUFFIX = ".servo-models-", ".part"
_PART = re.compile(rf"{re.escape(_PREFIX)}[a-z0-9_]{{8}}{re.escape(_SUFFIX)}")
"""What ``tempfile`` makes of prefix and suffix."""
_LOCK = ".servo-models.lock"


def write_with(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a file of the same name in a temporary folder, then move it into place.

    A crash, of the machine too, leaves the old file as it was.

    Raises:
        UserError: the folder cannot be made or written.
    """
    with being_written(path) as part:
        try:
            write(part)
            _to_disk(part)
            part.replace(path)
            _to_disk(path.parent)
        except OSError as error:
            raise UserError(
                f"cannot write '{path}': {error.strerror or error}; make room there, or choose"
                " another folder"
            ) from error


@contextlib.contextmanager
def being_written(path: Path) -> Iterator[Path]:
    """A free name on the same disk for a file or folder that is then moved to ``path``.

    The folder of ``path`` is made.  What stays under the free name goes at the end.

    Raises:
        UserError: the folder cannot be made or written.
    """
    with contextlib.ExitStack() as stack:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part = stack.enter_context(_part(path.parent))
        except OSError as error:
            raise UserError(
                f"cannot write '{path}': {error.strerror or error}; choose a folder that you may"
                " write"
            ) from error
        yield part / path.name


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
    with being_written(path):
        if path.is_dir():
            raise UserError(f"cannot write '{path}': it is a folder; name a file")


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
        with _part(folder.parent) as part:
            made = part / name
            made.mkdir()
            make(made)
            digests = _digests(made)
            (made / SEAL).write_text(json.dumps({"name": name, "sha256": digests}))
            for file in (*(made / one for one in digests), made / SEAL, made):
                _to_disk(file)
            _put(made, folder)
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


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """A temporary folder that goes at the end.

    Raises:
        CuredError: its disk is full.
    """
    try:
        with _part(Path(tempfile.gettempdir())) as part:
            folder = part / "files"
            folder.mkdir()
            yield folder
    except OSError as error:
        if tempfile.tempdir and error.errno not in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise CuredError(
            f"cannot write temporary files: {error.strerror} ({tempfile.tempdir}); make room there,"
            " or set TMPDIR to a folder on another disk"
        ) from error


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
    temporary = scratch()
    atexit.register(temporary.__exit__, None, None, None)
    return temporary.__enter__()


@contextlib.contextmanager
def _part(folder: Path) -> Iterator[Path]:
    """A new folder in ``folder``, which no other process removes; it goes at the end.

    Raises:
        OSError: ``folder`` cannot be written.
    """
    _sweep(folder)
    part, handle = _begin(folder)
    process = os.getpid()
    try:
        yield part
    finally:
        if os.getpid() == process:  # and not one forked from it
            _remove(part, handle)


def _begin(folder: Path) -> tuple[Path, int]:
    """Make a part and lock it; another is made where a sweep came between the two."""
    while True:
        part = Path(tempfile.mkdtemp(prefix=_PREFIX, suffix=_SUFFIX, dir=folder))
        with contextlib.suppress(FileNotFoundError):
            handle = _open(part)
            with contextlib.suppress(OSError):  # a disk without locks, on which nothing is swept
                _lock(handle, wait=True)
            if (part / _LOCK).exists():
                return part, handle
            os.close(handle)


@contextlib.contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Lock a file, made for that, while the block runs; False where another process has it locked.

    The system ends the lock of a process that is killed.

    Raises:
        UserError: the file cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}") from error
    try:
        _lock(handle, wait=False)
    except OSError:
        os.close(handle)
        yield False
        return
    try:
        yield True
    finally:
        with contextlib.suppress(OSError):  # an open file stays on Windows, and does no harm
            path.unlink()
        os.close(handle)


def _sweep(folder: Path) -> None:
    """Remove what processes that are gone had begun to write in a folder."""
    for part in folder.glob(f"{_PREFIX}*{_SUFFIX}"):
        with contextlib.suppress(OSError):
            if not (_PART.fullmatch(part.name) and _is_ours(part)):
                continue
            handle = _open(part)
            try:
                _lock(handle, wait=False)
            except OSError:
                os.close(handle)
            else:
                _remove(part, handle)


def _is_ours(part: Path) -> bool:
    """Whether it is a folder of this user: others may have put a link there."""
    about = part.lstat()
    user = 0 if sys.platform == "win32" else os.getuid()
    return stat.S_ISDIR(about.st_mode) and about.st_uid == user


def _open(part: Path) -> int:
    return os.open(part / _LOCK, os.O_RDWR | os.O_CREAT, 0o600)


def _lock(handle: int, wait: bool) -> None:
    """Lock an open file until it is closed, or its process has ended.

    Raises:
        OSError: another process holds it, or the disk has no locks.
    """
    if sys.platform == "win32":
        import msvcrt

        msvcrt.locking(handle, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
    else:
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


def _remove(part: Path, handle: int) -> None:
    """Remove a part, also one with folders that their owner may not write."""
    if os.name == "nt":  # which removes no open file
        os.close(handle)
    for place, _, _ in os.walk(part):
        with contextlib.suppress(OSError):
            os.chmod(place, stat.S_IRWXU)
    shutil.rmtree(part, ignore_errors=True)
    if os.name != "nt":
        os.close(handle)


def _to_disk(path: Path) -> None:
    """Wait until a file or folder is on the disk, where the system can."""
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY if os.name != "nt" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
