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
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from servo_models.errors import UserError, did_you_mean
from servo_models.files import write_whole
from servo_models.withheld.answers import unlock
from servo_models.withheld.generator.cases import TIERS
from servo_models.withheld.journal import work_through
from servo_models.withheld.oracle import Known, Question, ask_oracle
from servo_models.withheld.said import Said, diagnose_case
from servo_models.withheld.score import NOTHING, Cases, join

Tell = Callable[[int, int, str], None]
"""Called with cases done, cases in all, and what is being done."""


@dataclass(frozen=True)
class Asked:
    """What a run is asked for."""

    cases: int
    seed: int
    tiers: tuple[str, ...]


@dataclass(frozen=True)
class Check:
    """A withheld check that is done."""

    seed: int
    tiers: tuple[str, ...]
    seal: str
    cases: Cases


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
        case: Said(**row)
        for case, row in work_through(
            folder / "results.jsonl",
            {case.name: case for case in sorted((folder / "cases").iterdir())},
            diagnose_case,
            workers,
            lambda done, every: tell(done, every, "diagnosing"),
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
            lambda done, every: tell(done, every, "asking the oracle"),
        ).items()
    }
    return Check(asked.seed, asked.tiers, seal, join(answers, said, known))


def sealed_cases(folder: Path, asked: Asked, tell: Tell) -> str:
    """The seal of the cases in a folder, which are generated if it is new."""
    path = folder / "run.json"
    wanted = {**asdict(asked), "tiers": list(asked.tiers)}
    code = own_code()
    if not folder.exists():
        part = folder.parent / f".part-{folder.name}"  # whole or not at all, whoever is killed
        shutil.rmtree(part, ignore_errors=True)
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


def own_code() -> str:
    """Return the SHA-256 of this package: what two versions say of cases must not be mixed."""
    package, found = Path(__file__).parents[1], hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        found.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def _listed(tiers: object) -> str:
    return ",".join(tiers) if isinstance(tiers, list) else str(tiers)


def _generated(folder: Path, asked: Asked, tell: Tell) -> str:
    """Let the generator write its cases; returns their seal."""
    order = [sys.executable, "-m", "servo_models.withheld.generator", str(folder)]
    order += ["--cases", str(asked.cases), "--seed", str(asked.seed)]
    order += ["--tiers", ",".join(asked.tiers)]
    said = ""
    with subprocess.Popen(
        order, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stderr
        for line in process.stderr:
            said = line.strip()
            done, slash, every = said.partition("/")
            if slash and done.isdecimal() and every.isdecimal():
                tell(int(done), int(every), "generating")
        seal = process.stdout.read().strip()
    if process.returncode:
        raise UserError(f"the generator cannot write '{folder}': {said.removeprefix('error: ')}")
    return seal
