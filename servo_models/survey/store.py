"""What a survey has found so far: a file a job, named by the hash of all that it depends on.

A job is done when its JSON is there, which is written whole.  So a survey that was killed goes on
where it was, several may work on one folder, and what was changed is done anew.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from servo_models.data.readers.lerobot import DATA, INFO
from servo_models.data.schema import named_files, named_texts
from servo_models.errors import UserError
from servo_models.files import check_writable, locked, matching, write_whole
from servo_models.survey.job import VERSION, Done, Job, Outcome
from servo_models.survey.plan import JOBS

REPORTS, CLAIMS = "reports", "claims"  # folders of a survey


def files_of(description: Path) -> list[Path]:
    """Return a description and all files that it depends on: logs, parameters, own actuators."""
    files = named_files(description) or [description]
    folders = (description.parent / text for text in named_texts(description))
    for folder in (folder for folder in folders if os.path.isdir(folder)):
        files += [*matching(folder, DATA), *matching(folder, str(INFO)), *matching(folder, "*")]
    return list(dict.fromkeys(files))


def key_of(job: Job, options: Mapping[str, Any]) -> str:
    """Return the hash of a job: of its names, description, data, options and version."""
    parts: list[object] = [VERSION, version("servo-models"), job.unit, job.joint]
    parts += [job.failure, sorted(options.items())]
    folder = job.description.parent
    for file in files_of(job.description):
        parts.append((os.path.relpath(file, folder), digest(file)))
    return hashlib.sha256(json.dumps(parts, default=str).encode()).hexdigest()


def digest(file: Path) -> str:
    """Return the SHA-256 of a file, "" for one that cannot be read."""
    try:
        about = file.stat()
        return _digest(file.resolve(), about.st_mtime_ns, about.st_size)
    except OSError:
        return ""


@functools.lru_cache(maxsize=65536)
def _digest(file: Path, changed: int, size: int) -> str:
    """A file of many jobs is read once."""
    with file.open("rb") as stream:
        sha256 = hashlib.sha256()
        while part := stream.read(1 << 20):
            sha256.update(part)
    return sha256.hexdigest()


class Store:
    """The folder of a survey."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        check_writable(self.path("key"))

    def path(self, key: str) -> Path:
        return self.folder / JOBS / f"{key}.json"

    def get(self, key: str) -> Outcome | None:
        """Return what is kept of a job, None for nothing, or what no survey has written."""
        return read_outcome(self.path(key))

    def put(self, done: Done) -> Outcome:
        """Keep what came of a job, its page first, so that what is done has one; return it."""
        if done.page:
            write_whole(self.folder / REPORTS / f"{done.job.key}.html", done.page)
        write_whole(self.path(done.job.key), done.kept)
        return _decoded(done.kept)

    def claimed(self, key: str) -> AbstractContextManager[bool]:
        """Whether a job is ours to do while the block runs: no other process has it in hand."""
        return locked(self.folder / CLAIMS / key)


def read_outcome(path: Path) -> Outcome | None:
    """Return what is kept in a file, None where it is missing, damaged or of another version."""
    try:
        outcome = _decoded(path.read_bytes())
    except (OSError, msgspec.DecodeError):
        return None
    return outcome if outcome.schema_version == VERSION else None


def _decoded(kept: bytes) -> Outcome:
    """Without its diagnosis: those of ten thousand jobs stay in their files."""
    outcome = msgspec.json.decode(kept, type=Outcome)
    return msgspec.structs.replace(outcome, diagnosis=msgspec.Raw(b"null"))


def read_outcomes(folder: Path) -> tuple[Outcome, ...]:
    """Return what an earlier survey has kept, of each joint the newest."""
    files = sorted((folder / JOBS).glob("*.json"), key=lambda file: file.stat().st_mtime_ns)
    outcomes = filter(None, map(read_outcome, files))
    newest = {(outcome.unit, outcome.joint): outcome for outcome in outcomes}
    if not newest:
        raise UserError(f"'{folder}' holds no survey: name the folder of one, see --out")
    return tuple(newest.values())
