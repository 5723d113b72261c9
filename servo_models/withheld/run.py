"""The withheld check from the first case to the last: what ``servo-models blind`` does.

::

    FOLDER/cases, truth, answers.json   by the generator, in a process of its own
    FOLDER/run.json                     what was asked for, the seal of the answers, and by which
                                        code it was begun
    FOLDER/results.jsonl                what was said, one line a case
    FOLDER/oracle.jsonl                 what could have been said, after the answers were opened

The answers lie in plain text beside the cases.  Nothing keeps a person from reading them; a
diagnosis is given the folder of its case alone, and the seal shows that they are not chosen after
it.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from servo_models.core.stop import Tell
from servo_models.core.workers import python
from servo_models.errors import UserError, did_you_mean
from servo_models.files import being_written, write_whole
from servo_models.report.interchange import conditions
from servo_models.report.result import Result
from servo_models.survey.engine import Worker, here
from servo_models.withheld.generator.cases import TIERS
from servo_models.withheld.oracle import Diagnosed, Known, Question, ask_oracle, diagnose_case
from servo_models.withheld.score import NOTHING, Cases, join

GENERATE = "from servo_models.withheld.generator.__main__ import main; sys.exit(main())"
Task = TypeVar("Task")
Row = dict[str, Any]


@dataclass(frozen=True)
class Asked:
    """What a run is asked for."""

    cases: int
    seed: int
    tiers: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """A withheld check that is done.

    Attributes:
        seed, tiers: what it was asked for.
        seal: of the answers.
        cases: with their answers.
        versions: of what it ran on, by name.
    """

    seed: int
    tiers: tuple[str, ...]
    seal: str
    cases: Cases
    versions: Mapping[str, str] = field(default_factory=dict)


def check_tiers(words: str) -> tuple[str, ...]:
    """Return the tiers in a text such as ``"easy,hard"``.

    Raises:
        UserError: an unknown one, or the same twice.
    """
    found = tuple(word.strip() for word in words.split(","))
    for name in found:
        if name not in TIERS:
            raise UserError(f"unknown tier '{name}'; {did_you_mean(name, TIERS)}")
    if len(set(found)) < len(found):
        raise UserError(f"--tiers {words}: name every tier once")
    return found


def run_blind(
    folder: Path, asked: Asked, jobs: int | None, announce: Callable[[str], None], tell: Tell
) -> Check:
    """Generate cases, diagnose them, open the answers and score what was said.

    Args:
        folder: new, or that of the same check that was interrupted.
        asked: for which cases.
        jobs: processes, by default as many as there are processors.
        announce: is told the seal of the answers before anything is diagnosed.
        tell: is told what goes on.

    Raises:
        UserError: a folder with something else or begun by other code, a generator that fails,
            or answers that were changed.
    """
    workers = jobs or os.cpu_count() or 1
    seal = sealed_cases(folder, asked, tell)
    announce(seal)
    said = {
        case: Diagnosed(**row)
        for case, row in work_through(
            folder / "results.jsonl",
            {case.name: case for case in sorted((folder / "cases").iterdir())},
            diagnose_case,
            workers,
            tell,
            "diagnosing",
        ).items()
    }
    answers = unlock(folder, seal)
    known = {
        case: Known(**row)
        for case, row in work_through(
            folder / "oracle.jsonl",
            {
                a["case"]: Question(folder, a, said[a["case"]])
                for a in answers
                if a["kind"] != NOTHING
            },
            ask_oracle,
            workers,
            tell,
            "asking the oracle",
        ).items()
    }
    return Check(asked.seed, asked.tiers, seal, join(answers, said, known), conditions())


def sealed_cases(folder: Path, asked: Asked, tell: Tell) -> str:
    """The seal of the cases in a folder, which are generated if it is new."""
    path = folder / "run.json"
    wanted = {**asdict(asked), "tiers": list(asked.tiers)}
    code = own_code()
    if not folder.exists():
        with being_written(folder) as part:
            seal = _generated(part, asked, tell)
            begun = json.dumps({**wanted, "seal": seal, "code": code})
            write_whole(part / path.name, begun.encode())
            part.rename(folder)
        return seal
    if not path.is_file():
        raise UserError(f"'{folder}' is there and holds no withheld check: name a new folder")
    try:
        known: dict[str, object] = json.loads(path.read_text(encoding="utf-8"))
        seal, began = str(known.pop("seal")), known.pop("code", "")
        if known.keys() != wanted.keys():
            raise KeyError(path)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"'{path}' is damaged: name a new folder") from error
    if known != wanted:
        raise UserError(
            f"'{folder}' holds {known['cases']} cases of seed {known['seed']}, tiers"
            f" {_listed(known['tiers'])}: ask for these to go on, or name a new folder"
        )
    if began != code:
        raise UserError(
            f"'{folder}' was begun by another version of servo-models: go on with that one, or"
            " name a new folder"
        )
    return seal


def own_code(*beside: Path) -> str:
    """Return the SHA-256 of the code: what two versions say of cases must not be mixed.

    Args:
        beside: folders with more code than the package.
    """
    found = hashlib.sha256()
    for package in (Path(__file__).parents[1], *beside):
        for path in sorted(package.rglob("*.py")):
            found.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def _listed(tiers: object) -> str:
    return ",".join(tiers) if isinstance(tiers, list) else str(tiers)


def _generated(folder: Path, asked: Asked, tell: Tell) -> str:
    """Let the generator write its cases; returns their seal."""
    order = python(GENERATE, str(folder), "--cases", str(asked.cases), "--seed", str(asked.seed))
    said = ""
    with subprocess.Popen(
        [*order, "--tiers", ",".join(asked.tiers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout
        assert process.stderr
        for line in process.stderr:
            said = line.strip()
            done, slash, every = said.partition("/")
            if slash and done.isdecimal() and every.isdecimal():
                tell("generating", int(done), int(every))
        seal = process.stdout.read().strip()
    if process.returncode:
        raise UserError(f"the generator cannot write '{folder}': {said.removeprefix('error: ')}")
    return seal


def unlock(folder: Path, seal: str) -> list[dict[str, Any]]:
    """Return the answers, one per case; see ``generator.files`` for what is in them.

    Args:
        folder: what the generator wrote.
        seal: what it printed, before any diagnosis began.

    Raises:
        UserError: no answers there, answers that the seal is not of, or another file than the
            generator wrote.
    """
    path = folder / "answers.json"
    try:
        text = path.read_bytes()
    except OSError as error:
        raise UserError(f"'{path}' cannot be read: {error.strerror}") from error
    if hashlib.sha256(text).hexdigest() != seal:
        raise UserError(f"'{path}' is not what was sealed: generate the cases again")
    answers: list[dict[str, Any]] = json.loads(text)["cases"]
    for answer in answers:
        for name, digest in answer["files"].items():
            file = folder / name
            if not file.is_file() or hashlib.sha256(file.read_bytes()).hexdigest() != digest:
                raise UserError(f"'{file}' is not what was generated: generate the cases again")
    return answers


def work_through(
    path: Path,
    tasks: Mapping[str, Task],
    do: Callable[[Task], Row],
    jobs: int,
    tell: Tell,
    doing: str,
) -> dict[str, Row]:
    """Return what ``do`` makes of every task, by case; what ``path`` holds is not done again.

    Args:
        path: a line of JSON for every case that is done.
        tasks: by case.
        do: from a task to a row with its ``"case"``, a function of a module.
        jobs: processes.
        tell: is told how many cases are done, and what goes on: ``doing``.

    Raises:
        UserError: tasks failed, or ended their process; all others are kept.
    """
    rows = _read(path)
    left = [item for item in tasks.items() if item[0] not in rows]
    tell(doing, len(rows), len(tasks))
    failed: dict[str, str] = {}
    workers = [Worker(None, _failed, partial, _row, do) for _ in range(min(jobs, len(left)))]
    with path.open("a", encoding="utf-8") as file:
        for case, row in here(iter(left), workers) if left else ():
            if isinstance(row, str):
                failed[case] = row
                continue
            rows[row["case"]] = row
            file.write(json.dumps(row) + "\n")
            file.flush()
            tell(doing, len(rows), len(tasks))
    for case, why in failed.items():
        raise UserError(
            f"{len(failed)} of {len(tasks)} cases failed, case '{case}': {why}; the others are in"
            f" '{path}': mend that, or use fewer --jobs where memory is short, and the same"
            " --folder to go on"
        )
    return rows


def _row(do: Callable[[Task], Row], item: tuple[str, Task]) -> tuple[str, Row]:
    """A case, in a process of its own."""
    return item[0], do(item[1])


def _failed(item: tuple[str, Task], why: str) -> tuple[str, str]:
    return item[0], why


def _read(path: Path) -> dict[str, Row]:
    """Rows by case; a line that was being written when everything stopped is cut off."""
    if not path.exists():
        return {}
    text = path.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if whole != text:
        path.write_bytes(whole)
    rows = [json.loads(line) for line in whole.splitlines()]
    return {row["case"]: row for row in rows}
