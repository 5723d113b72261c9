"""The joints of a robot's recording: which columns are the command and the reading of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Joint:
    """A joint of a recording.

    Attributes:
        name: as the recording calls it.
        log: lines of its ``[[logs]]`` above the signals.
        command, reading: columns, as keys of a signal; ``unit`` is that of both, with its scale.
        guessed: what is, and ``doubt`` why.
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
