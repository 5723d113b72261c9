"""Which jobs a path holds: joints of a recording, descriptions, logs, or the rows of a table.

What has no description is given a first one in the folder of the survey, as ``check --init`` does;
one that is there already is kept, so that what was corrected by hand stays.
"""

from __future__ import annotations

import os
import re
import time
from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, count
from pathlib import Path
from typing import TypeVar

from servo_models.core.stop import Tell, silent
from servo_models.data.description import code_of, read_description, tells_of_logs
from servo_models.data.joints.data_sets import HELD_OUT_PERIOD
from servo_models.data.joints.drafts import as_file, files_of, recording, write_joints
from servo_models.data.joints.recording import Recording
from servo_models.data.readers import is_bag, suffixes
from servo_models.data.readers.lerobot import is_data_set
from servo_models.data.scaffold import Draft, drafts
from servo_models.data.schema import named_files, quoted
from servo_models.errors import UserError
from servo_models.files import read_regular, scratch, write_whole
from servo_models.survey.job import Job

DESCRIPTIONS = "descriptions"  # folder of a survey with what it has drafted
JOBS = "jobs"  # and with what is kept of each job
LOG, UNIT, JOINT = "log", "unit", "joint"  # columns of a table of logs; others are conditions
TELL_SECONDS = 5.0  # between words on how far a long look has come

T = TypeVar("T")


@dataclass
class Plan:
    """The jobs of a path, as they are found.

    Attributes:
        root: folder from which units are named.
        drafts: folder for descriptions.
        actuator: what made the logs, None for a guess.
        trust: as of ``survey``.
        tell: is told how far it has come.
        jobs: without a key and options.
        notes: what is to be told of them, such as what was guessed or left out.
        units: by the folder of their descriptions.
        drafted: descriptions of logs.
    """

    root: Path
    drafts: Path
    actuator: str | None
    trust: bool
    tell: Tell
    jobs: list[Job] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    drafted: set[Path] = field(default_factory=set)

    def folder(self, folder: Path, survey: Path) -> None:
        """Add descriptions, recordings and logs without a description, at any depth."""
        descriptions: list[Path] = []
        others: list[Path] = []
        for place, names, files in os.walk(folder):
            at = Path(place)
            whole = [name for name in names if _is_whole(at / name)]
            surveys = [name for name in names if at / name == survey or _is_survey(at / name)]
            hidden = [name for name in names if name.startswith(".")]
            names[:] = sorted(set(names).difference(whole, surveys, hidden))
            for path in (at / name for name in sorted([*files, *whole])):
                if path.suffix.lower() == ".toml":
                    descriptions += [path] if tells_of_logs(path, damaged=True) else []
                elif _is_whole(path) or path.suffix.lower() in suffixes():
                    others.append(path)
        described = {file.resolve() for path in descriptions for file in named_files(path)}
        for path in descriptions:
            self.jobs.append(Job(self.unit(path), path.stem, path))
        for path in counted(others, self.tell, "logs looked at"):
            if path.resolve() not in described:
                self.add("", path.stem, [path], {})

    def table(self, path: Path) -> None:
        """Add the joints of a table of logs."""
        grouped: dict[tuple[str, str], list[dict[str, str]]] = defaultdict(list)
        for row in _rows(path):
            unit, joint = row.get(UNIT) or self.root.name, row.get(JOINT) or Path(row[LOG]).stem
            grouped[unit, joint].append(row)
        for (unit, joint), rows in counted(grouped.items(), self.tell, "joints looked at"):
            texts = {key: {row[key] for row in rows} for key in rows[0]}
            others = [key for key in texts if key not in {LOG, UNIT, JOINT}]
            known = {key: rows[0][key] for key in others if len(texts[key]) == 1}
            for key in (key for key in others if key not in known):
                why = f"'{key}' differs between its logs and is left out"
                self.notes[f"{unit} {joint}: {why}"] = None
            self.add(unit, joint, [path.parent / row[LOG] for row in rows], known)

    def unit(self, path: Path) -> str:
        """Name of the unit whose folder a file is in."""
        return self.root.name if path.parent == self.root else self.inside(path.parent)

    def inside(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()

    def place(self, unit: str) -> Path:
        """Folder for the descriptions of a unit, and of no other whose name is alike."""
        names = (f"{as_file(unit)}{more}" for more in chain([""], (f"_{n}" for n in count(2))))
        return self.drafts / next(n for n in names if self.units.setdefault(n, unit) == unit)

    def add(
        self, unit: str, joint: str, logs: Sequence[Path], conditions: Mapping[str, str]
    ) -> None:
        """Add a description, each joint of a recording, or a joint with logs of its own.

        A ``unit`` without a name is the folder of a log, and the recording itself.
        """
        first, *others = logs
        owner = unit or self.unit(first)
        try:
            if any(tells_of_logs(path, damaged=True) for path in logs):
                if others:
                    raise UserError(
                        f"'{first}' and {len(others)} more: give a description a row of its own"
                    )
                self.jobs.append(Job(owner, joint, first, conditions))
            elif not others and (recorded := recording(first, self.actuator)):
                own = first if first.is_dir() else first.with_suffix("")
                self.joints(recorded, unit or self.inside(own), conditions)
            else:
                self.joint(owner, joint, logs, conditions)
        except UserError as error:  # which is told as that of this joint, and the others go on
            self.jobs.append(Job(owner, joint, first, conditions, str(error)))

    def joints(self, recorded: Recording, unit: str, conditions: Mapping[str, str]) -> None:
        """Add the joints of a recording."""
        folder = self.place(unit)
        for text, _ in write_joints(recorded, folder, self.actuator, self.trust, keep=True):
            if not text.startswith("wrote"):
                self.notes[f"{unit}: {text}"] = None
        for file in sorted(folder.glob("*.toml")):
            self.jobs.append(Job(unit, file.stem, file, conditions))

    def joint(
        self, unit: str, joint: str, logs: Sequence[Path], conditions: Mapping[str, str]
    ) -> None:
        """Add a joint, with a first description if it has none."""
        path = self.place(unit) / f"{as_file(joint)}.toml"
        if path in self.drafted:  # two logs of one name, such as a.csv and a.json
            joint = logs[0].name
            path = path.with_name(f"{as_file(joint)}.toml")
        self.drafted.add(path)
        if path.exists():
            self.jobs.append(Job(unit, joint, path, conditions))
            return
        for file, made in files_of(drafts(logs[0], self.actuator), path).items():
            name = joint if file == path else file.stem
            if not file.exists():
                self.write(made, file, logs, f"{unit} {name}")
            self.jobs.append(Job(unit, name, file, conditions))

    def write(self, made: Draft, path: Path, logs: Sequence[Path], name: str) -> None:
        """Write a first description of logs."""
        text = made.text(path.parent)
        if len(logs) > 1:
            usable = [log for log in logs if self.reads(made, log, name)]
            # if none can be read, the diagnosis says what has to be completed
            text = _with_runs(text, usable or logs, path.parent)
        write_whole(path, text.encode())
        self.notes |= {f"{name}: {text}": None for text in made.warnings}

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


def plan(
    path: Path,
    survey: Path,
    actuator: str | None = None,
    trust: bool = False,
    tell: Tell = silent,
) -> Plan:
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
    found = Plan(root, survey.resolve() / DESCRIPTIONS, actuator, trust, tell)
    if _is_table(path):
        found.table(path)
    elif whole:
        found.add("", path.stem, [path.resolve()], {})
    else:
        found.folder(root, survey.resolve())
    if not found.jobs:
        ends = ", ".join(suffixes())
        raise UserError(
            f"'{path}' has nothing to diagnose: neither a description nor a recording or log"
            f" ({ends})"
        )
    if not trust:
        found.jobs = [_held(job, path.resolve()) for job in found.jobs]
    return found


def _held(job: Job, named: Path) -> Job:
    """A job that fails where it would run code and nobody has named its description."""
    if job.failure or job.description == named or not (code := code_of(job.description)):
        return job
    why = f"it would run '{code}', and the survey found '{job.description}' by itself"
    return replace(job, failure=f"{why}: read both, then say --trust, or survey that file alone")


def counted(items: Collection[T], tell: Tell, doing: str) -> Iterator[T]:
    """Yield items, and tell now and then how many are done."""
    last = time.monotonic()
    for done, item in enumerate(items):
        if time.monotonic() - last > TELL_SECONDS:
            last = time.monotonic()
            tell(f"{doing}: {done} of {len(items)}")
        yield item


def _is_whole(path: Path) -> bool:
    """Whether a folder is a recording."""
    return os.path.isdir(path) and (is_data_set(path) or is_bag(path))


def _is_survey(path: Path) -> bool:
    """Whether a survey has written a folder: what it has drafted is no joint of another one."""
    return any((path / JOBS).glob(f"{'[0-9a-f]' * 64}.json"))


def _is_table(path: Path) -> bool:
    """Whether a CSV file is a table of logs, and no log."""
    if path.suffix.lower() != ".csv" or not os.path.isfile(path):
        return False
    with path.open("rb") as stream:
        return LOG.encode() in re.split(rb"[,;\t\r\n\"]", stream.readline())


def _rows(path: Path) -> Iterator[dict[str, str]]:
    """The rows of a table of logs."""
    import polars as pl

    try:
        frame = pl.read_csv(read_regular(path), infer_schema_length=0).fill_null("")
    except pl.exceptions.PolarsError as error:
        raise UserError(f"'{path}' is no table of logs: write CSV, with commas") from error
    if LOG not in frame.columns or not frame.height:
        raise UserError(
            f"'{path}' is no table of logs: give it a column '{LOG}' with their files, and rows"
        )
    return frame.iter_rows(named=True)


def _with_runs(text: str, logs: Sequence[Path], folder: Path) -> str:
    """A draft of the first log with all of them as its runs, of which some are held out."""
    lines = ["repeat = ["]
    for k, log in enumerate(logs, start=1):
        file = quoted(Path(os.path.relpath(log.resolve(), folder)).as_posix())
        held_out = ", held_out = true" if k % HELD_OUT_PERIOD == 0 else ""
        lines.append(f"    {{ file = {file}{held_out} }},")
    return re.sub(r"(?m)^file = .*$", lambda _: "\n".join([*lines, "]"]), text)
