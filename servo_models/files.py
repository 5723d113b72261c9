"""Outputs are written whole or not at all; where the cache is."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from servo_models.errors import UserError


def write_with(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then move it into place.

    A crash leaves the old file as it was.  The temporary file keeps the suffix, since
    writers choose their format by it.

    Raises:
        UserError: the folder cannot be made or written.
    """
    part = _beside(path)
    try:
        write(part)
        mask = os.umask(0)
        os.umask(mask)
        part.chmod(0o666 & ~mask)
        part.replace(path)
    except OSError as error:
        raise UserError(f"cannot write '{path}': {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


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
        handle, name = tempfile.mkstemp(prefix=".part-", suffix=path.suffix, dir=path.parent)
    except OSError as error:
        raise UserError(
            f"cannot write '{path}': {error.strerror or error}; choose a folder that you may write"
        ) from error
    os.close(handle)
    return Path(name)


def write_whole(path: Path, content: bytes) -> None:
    """Write ``content`` to ``path`` through a temporary file; see ``write_with``."""
    write_with(path, lambda part: part.write_bytes(content))


def cache_folder() -> Path:
    """Return the user's cache folder, or a temporary one where that cannot be written.

    ``SERVO_MODELS_CACHE`` keeps it elsewhere.
    """
    base = os.environ.get("SERVO_MODELS_CACHE") or os.path.join(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "servo-models"
    )
    folder = Path(base)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="servo-models-"))
