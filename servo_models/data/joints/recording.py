"""The joints of a robot's recording: which columns are the command and the reading of each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from servo_models.data.readers import Columns
from servo_models.data.schema import quoted


@dataclass(frozen=True)
class Joint:
    """A joint of a recording.

    Attributes:
        name: as the recording calls it.
        log: lines of its ``[[logs]]`` above the signals.
        command, reading: columns, as keys of a signal; ``unit`` is that of both, with its scale.
        guessed: what was guessed, and ``doubt`` why.
        runs: lines below the signals.
    """

    name: str
    log: Sequence[str]
    command: str
    reading: str
    unit: str
    guessed: str
    doubt: str
    runs: Sequence[str] = ()


@dataclass(frozen=True)
class Recording:
    """The joints of a recording, and what is said once about all, or of those that are left out."""

    path: Path
    joints: tuple[Joint, ...]
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def column_keys(column: str, tables: Iterable[Columns], missing: str) -> str:
    """Return the keys of a column, with ``missing`` where one of its tables has gaps."""
    gaps = any(it.empty(column)[it.begin(column) :].any() for it in tables)
    return f"column = {quoted(column)}" + (f", missing = {quoted(missing)}" if gaps else "")
