"""A measured log in SI, ready to be compared with a simulation.

Readers of files (``readers/``) and log descriptions (``description.py``) make it;
the audit, the identification and the diagnosis only know this.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Mask


@dataclass(frozen=True)
class Channel:
    """How a column of a file becomes a signal: SI value = ``scale`` * raw + ``offset``.

    Attributes:
        signal: name of an input or output of the actuator, or ``"time"``.
        column: name of the column, or its number as text, 1 for the first.
        unit: unit of the column in words of its author, for people: ``"deg"``, ``"count"``.
        scale: SI per number in the file, with unit and sign in it.
        offset: SI value of 0 in the file.
        checked: its author has looked at unit, sign, zero and readings, so nothing is asked of it.
        shift: time [s] that is added to its stamps.
        after_command: time [s] from the command of a row until an output was read, which may have
            jumped with it; None where it was read just before.
    """

    signal: str
    column: str
    unit: str
    scale: float = 1.0
    offset: float = 0.0
    checked: bool = False
    shift: float = 0.0
    after_command: float | None = None

    @property
    def told(self) -> tuple[float, str]:
        """What a number of the column is worth: how many of which unit, such as 0.1 deg."""
        parts = re.fullmatch(r"([-+]?[\d.]+(?:e[-+]?\d+)?) (.+)", self.unit)
        return (float(parts[1]), parts[2]) if parts else (1.0, self.unit)


@dataclass(frozen=True)
class Start:
    """How a run begins that begins neither at rest nor settled at its first row.

    Attributes:
        shaft: angle and rate [SI] of the shaft as the log begins, by the names of these outputs,
            and of states that are carried; empty where the shaft is where the inputs have brought
            it.
        before: inputs [SI] that were held before the log begins, in place of its first row.
        fitted: these values are estimated in every simulation, beginning here; else they are known.
    """

    shaft: Mapping[str, float] = field(default_factory=dict)
    before: Mapping[str, float] = field(default_factory=dict)
    fitted: bool = False


@dataclass(frozen=True, eq=False)
class Log:
    """One recorded run.

    Attributes:
        name: short and unique within a description.
        path: the file, and ``sha256`` of its bytes.
        times: [s], shape (n,), strictly increasing from 0.
        inputs: SI by name of the input, each (n,); held from its row on.
        outputs: SI by name of the output, each (n,); measured at its row.
        channels: columns by signal, ``"time"`` included.
        rows: row of the file for each sample, as its author would count, shape (n,).
        constants: SI values of parameters or inputs that hold in this log only.
        held_out: True for samples that no fit may see, shape (n,).
        skipped: True for samples that neither count in a fit nor in a score, such as long rests
            that would thin out every figure; None for no such samples.
        settle: time [s] for which the first row's inputs are held before the log begins, so
            that the simulation starts in equilibrium.
        begin: time [s] from the file's first row to the first sample here.
        notes: what reading has changed of the file, one sentence each.
        start: how the run begins; None for at rest, or settled where there is a ``settle`` time.
        assumed: nobody said how it begins, so that it may be found from its first samples.
        unsure: changes [SI] of each output by one standard deviation of what nobody knows of the
            inputs, commands between lost rows and digits that were not written, shape (n,
            changes); None where all is known.
        between: True for samples that are no reading: a command came between two of them, and
            they are skipped; None for no such samples.
    """

    name: str
    path: Path
    sha256: str
    times: Array
    inputs: Mapping[str, Array]
    outputs: Mapping[str, Array]
    channels: Mapping[str, Channel]
    rows: NDArray[np.int64]
    held_out: Mask
    constants: Mapping[str, float] = field(default_factory=dict)
    settle: float = 0.0
    skipped: Mask | None = None
    begin: float = 0.0
    notes: tuple[str, ...] = ()
    start: Start | None = None
    assumed: bool = False
    unsure: Mapping[str, Array] | None = None
    between: Mask | None = None

    def after_command(self, names: Iterable[str]) -> Array:
        """Times [s] from the command of a row until signals were read, NaN for just before it."""
        known = [self.channels[it].after_command if it in self.channels else None for it in names]
        return np.array(known, dtype=float)

    @property
    def duration(self) -> float:
        """Length of the log [s]."""
        return float(self.times[-1])

    @property
    def interval(self) -> float:
        """Median time from a reading to the next [s], infinite for one."""
        times = self.times[self.read]
        return float(np.median(np.diff(times))) if len(times) > 1 else np.inf

    def at(self, rows: slice | NDArray[np.int64]) -> Log:
        """Return the log at some of its rows, as it stands there."""
        return replace(
            self,
            times=self.times[rows],
            inputs={name: values[rows] for name, values in self.inputs.items()},
            outputs={name: values[rows] for name, values in self.outputs.items()},
            rows=self.rows[rows],
            held_out=self.held_out[rows],
            skipped=None if self.skipped is None else self.skipped[rows],
            unsure=self.unsure and {name: moves[rows] for name, moves in self.unsure.items()},
            between=None if self.between is None else self.between[rows],
        )

    @property
    def readings(self) -> Log:
        """The log at its readings, without commands between them."""
        if self.between is None:
            return self
        return replace(self.at(np.flatnonzero(self.read)), between=None)

    @property
    def read(self) -> Mask:
        """Samples that are readings, shape (n,)."""
        return np.ones(len(self.times), dtype=bool) if self.between is None else ~self.between

    @property
    def stamps(self) -> Array:
        """Times since the file's first row [s], shape (n,): a description counts like that."""
        return self.begin + self.times

    @property
    def fitted(self) -> Mask:
        """Samples that a fit sees, shape (n,)."""
        return ~self.held_out & self.counted

    @property
    def checked(self) -> Mask:
        """Samples held out, that a score sees, shape (n,)."""
        return self.held_out & self.counted

    @property
    def counted(self) -> Mask:
        """Samples that are not skipped, shape (n,)."""
        return np.ones(len(self.times), dtype=bool) if self.skipped is None else ~self.skipped


def hashes(logs: Iterable[Log]) -> dict[str, str]:
    """Return the SHA-256 of each log's file by name, with its folders where names repeat."""
    files = {log.path: log.sha256 for log in logs}
    return {_told_apart(path, files): digest for path, digest in files.items()}


def _told_apart(path: Path, paths: Iterable[Path]) -> str:
    """The last parts of a path, as many as no other of the paths ends in."""
    for count in range(1, len(path.parts)):
        if sum(other.parts[-count:] == path.parts[-count:] for other in paths) == 1:
            return "/".join(path.parts[-count:])
    return path.as_posix()
