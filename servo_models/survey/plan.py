"""Which jobs a path holds: joints of a recording, descriptions, logs, or the rows of a table.

What has no description is given a first one in the folder of the survey, as ``check --init`` does;
one that is there already is kept, so that what was corrected by hand stays.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, count
from pathlib import Path

from servo_models.data.description import read_description, tells_of_logs
from servo_models.data.joints.data_sets import HELD_OUT_PERIOD
from servo_models.data.joints.drafts import as_file, recording, write_joints
from servo_models.data.readers import is_bag, suffixes
from servo_models.data.readers.lerobot import is_data_set
from servo_models.data.scaffold import Draft, draft
from servo_models.data.schema import named_files, quoted
from servo_models.errors import UserError
from servo_models.files import read_regular, scratch, write_whole

DESCRIPTIONS = "descriptions"  # folder of a survey with what it has drafted
LOG, UNIT, JOINT = "log", "unit", "joint"  # columns of a table of logs; others are conditions


@dataclass(frozen=True)
class Planned:
    """The joint of a unit; ``failure`` says why it has no description that can be read."""

    unit: str
    joint: str
    description: Path
    conditions: Mapping[str, str] = field(default_factory=dict)
    failure: str = ""


@dataclass(frozen=True)
class Plan:
    """Jobs, and what is to be told of them, such as what was guessed or left out."""

    jobs: tuple[Planned, ...]
    notes: tuple[str, ...] = ()


@dataclass
class _Planner:
    """Collects the jobs of a path.

    Attributes:
        root: folder from which units are named.
        drafts: folder for descriptions.
        actuator: what made the logs, None for a guess.
        trust: as for descriptions.
        units: by the folder of their descriptions.
    """

    root: Path
    drafts: Path
    actuator: str | None
    trust: bool
    jobs: list[Planned] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)

    def folder(self, folder: Path, survey: Path) -> None:
        """Add descriptions, recordings and logs without a description, at any depth."""
        descriptions: list[Path] = []
        others: list[Path] = []
        for place, names, files in os.walk(folder):
            at = Path(place)
            whole = [name for name in names if _is_whole(at / name)]
            hidden = [name for name in names if name.startswith(".") or at / name == survey]
            names[:] = sorted(set(names).difference(whole, hidden))
            for path in (at / name for name in sorted([*files, *whole])):
                if path.suffix.lower() == ".toml":
                    descriptions += [path] if tells_of_logs(path, damaged=True) else []
                elif _is_whole(path) or path.suffix.lower() in suffixes():
                    others.append(path)
        described = {file.resolve() for path in descriptions for file in named_files(path)}
        for path in descriptions:
            self.jobs.append(Planned(self.unit(path), path.stem, path))
        for path in others:
            if path.resolve() not in described:
                self.log(path, self.unit(path))

    def unit(self, path: Path) -> str:
        """Name of the unit whose folder a file is in."""
        return self.root.name if path.parent == self.root else self.inside(path.parent)

    def inside(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()

    def place(self, unit: str) -> Path:
        """Folder for the descriptions of a unit, and of no other whose name is alike."""
        names = (f"{as_file(unit)}{more}" for more in chain([""], (f"_{n}" for n in count(2))))
        return self.drafts / next(n for n in names if self.units.setdefault(n, unit) == unit)

    def log(self, path: Path, unit: str) -> None:
        """Add each joint of a recording, or a log."""
        try:
            recorded = recording(path, self.actuator)
        except UserError as error:
            return self.fail(unit, path.name, path, error)
        if recorded is None:
            return self.described(unit, path.stem, [path], {})
        unit = path.stem if path.is_file() else path.name
        if path.parent != self.root:
            unit = f"{self.inside(path.parent)}/{unit}"
        folder = self.place(unit)
        try:
            told = list(write_joints(recorded, folder, self.actuator, self.trust, keep=True))
        except UserError as error:
            return self.fail(unit, path.name, path, error)
        self.notes |= {f"{unit}: {text}": None for text, _ in told if not text.startswith("wrote")}
        self.jobs += [Planned(unit, file.stem, file) for file in sorted(folder.glob("*.toml"))]

    def described(
        self, unit: str, joint: str, logs: Sequence[Path], conditions: Mapping[str, str]
    ) -> None:
        """Add a joint with logs of its own; a description among them is its description."""
        if any(tells_of_logs(path, damaged=True) for path in logs):
            if len(logs) > 1:
                text = f"'{logs[0]}' and {len(logs) - 1} more: give a description a row of its own"
                return self.fail(unit, joint, logs[0], UserError(text))
            self.jobs.append(Planned(unit, joint, logs[0], conditions))
            return
        taken = {job.description for job in self.jobs}
        path = self.place(unit) / f"{as_file(joint)}.toml"
        if path in taken:  # two logs of one name, such as a.csv and a.json
            joint = logs[0].name
            path = path.with_name(f"{as_file(joint)}.toml")
        try:
            if not path.exists():
                made = draft(logs[0], self.actuator)
                text = made.text(path.parent)
                if len(logs) > 1:
                    usable = [log for log in logs if self.reads(made, log, f"{unit} {joint}")]
                    # if none can be read, the diagnosis says what has to be completed
                    text = _with_runs(text, usable or logs, path.parent)
                write_whole(path, text.encode())
                self.notes |= {f"{unit} {joint}: {text}": None for text in made.warnings}
        except UserError as error:
            return self.fail(unit, joint, logs[0], error)
        self.jobs.append(Planned(unit, joint, path, conditions))

    def reads(self, made: Draft, log: Path, name: str) -> bool:
        """Whether a log can be read by a draft; if not, a note says why it is left out."""
        with scratch() as folder:
            description = folder / "log.toml"
            text = _with_runs(made.text(folder), [log], folder)
            description.write_text(text, encoding="utf-8")
            try:
                read_description(description, self.trust)
            except UserError as error:
                why = str(error).rpartition(f"{log.name}', ")[2]
                self.notes[f"{name}: '{log.name}' is left out, since {why}"] = None
                return False
        return True

    def fail(self, unit: str, joint: str, path: Path, error: UserError) -> None:
        self.jobs.append(Planned(unit, joint, path, failure=str(error)))

    def table(self, path: Path) -> None:
        """Add the joints of a table of logs."""
        cells = _texts(path)
        grouped: dict[tuple[str, str], list[int]] = {}
        for row, log in enumerate(cells[LOG]):
            stem = Path(log).stem
            unit, joint = (cells[key][row] if key in cells else "" for key in (UNIT, JOINT))
            grouped.setdefault((unit or self.root.name, joint or stem), []).append(row)
        for (unit, joint), rows in grouped.items():
            conditions = {
                name: texts[rows[0]]
                for name, texts in cells.items()
                if name not in {LOG, UNIT, JOINT}
            }
            logs = [path.parent / cells[LOG][row] for row in rows]
            self.described(unit, joint, logs, conditions)


def plan(path: Path, survey: Path, actuator: str | None = None, trust: bool = False) -> Plan:
    """Return the jobs that a path holds, with first descriptions in the folder of the survey.

    Args:
        path: a recording of a robot, a folder of descriptions, recordings or logs, a table with a
            column ``log``, a description or a log.

    Raises:
        UserError: nothing there, nothing to be diagnosed, or a folder that cannot be written.
    """
    if not os.path.exists(path):
        raise UserError(
            f"no '{path}': name a folder, a recording, a table of logs or a description"
        )
    whole = os.path.isfile(path) or _is_whole(path)
    root = path.resolve().parent if whole else path.resolve()
    planner = _Planner(root, survey.resolve() / DESCRIPTIONS, actuator, trust)
    if _is_table(path):
        planner.table(path)
    elif tells_of_logs(path, damaged=True):
        planner.jobs.append(Planned(root.name, path.stem, path))
    elif whole:
        planner.log(path.resolve(), root.name)
    else:
        planner.folder(path.resolve(), survey.resolve())
    if not planner.jobs:
        ends = ", ".join(suffixes())
        raise UserError(
            f"'{path}' has nothing to diagnose: neither a description nor a recording or log"
            f" ({ends})"
        )
    return Plan(tuple(planner.jobs), tuple(planner.notes))


def _is_whole(path: Path) -> bool:
    """Whether a folder is a recording."""
    return os.path.isdir(path) and (is_data_set(path) or is_bag(path))


def _is_table(path: Path) -> bool:
    """Whether a CSV file is a table of logs, and no log."""
    if path.suffix.lower() != ".csv" or not os.path.isfile(path):
        return False
    with path.open("rb") as stream:
        return LOG.encode() in re.split(rb"[,;\t\r\n\"]", stream.readline())


def _texts(path: Path) -> dict[str, list[str]]:
    """Every column of a CSV file, as texts."""
    import polars as pl

    try:
        frame = pl.read_csv(read_regular(path), infer_schema_length=0).fill_null("")
    except pl.exceptions.PolarsError as error:
        raise UserError(f"'{path}' is no table of logs: write CSV, with commas") from error
    if LOG not in frame.columns or not frame.height:
        raise UserError(
            f"'{path}' is no table of logs: give it a column '{LOG}' with their files, and rows"
        )
    return {name: frame[name].to_list() for name in frame.columns}


def _with_runs(text: str, logs: Sequence[Path], folder: Path) -> str:
    """A draft of the first log with all of them as its runs, of which some are held out."""
    return re.sub(r"(?m)^file = .*$", lambda _: _runs(logs, folder), text)


def _runs(logs: Sequence[Path], folder: Path) -> str:
    def lines() -> Iterator[str]:
        for k, log in enumerate(logs, start=1):
            file = quoted(Path(os.path.relpath(log.resolve(), folder)).as_posix())
            held_out = ", held_out = true" if k % HELD_OUT_PERIOD == 0 else ""
            yield f"    {{ file = {file}{held_out} }},"

    return "\n".join(("repeat = [", *lines(), "]"))
