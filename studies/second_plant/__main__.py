"""The command line of the second withheld study.

::

    FOLDER/cases, answers.json     the rigs, before anything is diagnosed
    FOLDER/judged.jsonl            what was said and what could have been said, one line a rig
    FOLDER/figures.json            figures, bars, and every rig with all of the above

A folder with more rigs than are asked for gives the figures of its first ones.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from servo_models.cli.console import progress, show
from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.report.interchange import conditions, plain
from servo_models.withheld import run
from servo_models.withheld.oracle import Diagnosed
from servo_models.withheld.run import work_through
from studies.second_plant.figures import BARS, FIGURES, Case, Cases, play_by_share, report
from studies.second_plant.judge import Observed, judged
from studies.second_plant.mujoco_plant import engine
from studies.second_plant.rigs import ENGINES, MIXES, Rig, draw, six, write

own_code = partial(run.own_code, Path(__file__).parents[1])
"""Of the package and of all studies."""


def main() -> int:
    """Run the command line; 0 done, 2 could not run."""
    parser = argparse.ArgumentParser(prog="python -m studies second_plant")
    parser.add_argument("--seed", type=int, default=1, help="of the rigs")
    parser.add_argument("--cases", type=int, default=150, help="rigs, engines in turn")
    parser.add_argument("--mix", default="mechanics", choices=MIXES, help="what causes are drawn")
    parser.add_argument("--six", action="store_true", help="the six rigs with play and delay")
    parser.add_argument("--engines", default=",".join(ENGINES), help="two_mass,mujoco or one")
    parser.add_argument("--folder", type=Path, required=True, help="of rigs and results")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--resume", action="store_true", help="go on with a folder that is there")
    given = parser.parse_args()
    engines = tuple(given.engines.split(","))
    if not set(engines) <= set(ENGINES) or given.cases < 1 or given.seed < 0:
        parser.error(f"give 1 rig or more, a seed of 0 or more, engines of {', '.join(ENGINES)}")
    try:
        if "mujoco" in engines and not given.six:
            engine()
        rigs, title = six(), "second plant, the six"
        if not given.six:
            rigs = [draw(given.seed, i, engines, given.mix) for i in range(given.cases)]
            title = f"second plant, {given.mix}, seed {given.seed}"
        cases = study(given.folder, rigs, given.jobs, given.resume)
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    write_whole(
        given.folder / "figures.json", f"{json.dumps(plain(document(title, cases)))}\n".encode()
    )
    show(report(title, cases))
    return 0


def study(folder: Path, rigs: list[Rig], jobs: int, resume: bool) -> Cases:
    """Write rigs, diagnose them, and judge what was said.

    Raises:
        UserError: a folder that is there and was not to be gone on with, or that holds other rigs
            or what other code has said.
    """
    with progress("generating") as tell:
        if not folder.exists():
            write(folder, rigs, tell)
            write_whole(folder / "code.txt", own_code().encode())
        elif not resume:
            raise UserError(f"'{folder}' is there: name a new folder, or go on with '--resume'")
        answers = _answers(folder, rigs)
        rows = work_through(
            folder / "judged.jsonl",
            {case: (folder, answer) for case, answer in answers.items()},
            judged,
            jobs,
            tell,
            "diagnosing",
        )
    return [
        Case(answer, Diagnosed(**rows[name]["said"]), Observed(**rows[name]["observed"]))
        for name, answer in answers.items()
    ]


def _answers(folder: Path, rigs: list[Rig]) -> dict[str, dict[str, Any]]:
    """The answers of a folder, which are those of the rigs that were asked for."""
    try:
        known = json.loads((folder / "answers.json").read_text(encoding="utf-8"))
        code = (folder / "code.txt").read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise UserError(f"'{folder}' holds no study: name a new folder") from error
    known = known[: len(rigs)]
    if known != json.loads(json.dumps([rig.answer() for rig in rigs])):
        raise UserError(f"'{folder}' holds other rigs: ask for these, or name a new folder")
    if code != own_code():
        raise UserError(f"'{folder}' was begun by another version: name a new folder")
    return {answer["case"]: answer for answer in known}


def document(title: str, cases: Cases) -> dict[str, Any]:
    """Return all of a study as what JSON is made of."""
    return {
        "title": title,
        "versions": conditions(),
        "figures": {define.__name__: define(cases) for define in FIGURES},
        "play_by_share": {f"{share:.2f}": figure for share, figure in play_by_share(cases).items()},
        "bars": {name: " ".join(map(str, bar)) for name, bar in BARS.items()},
        "cases": [
            {
                **case.answer,
                "right": case.right,
                "said": case.said,
                "observed": asdict(case.observed),
            }
            for case in cases
        ],
    }


if __name__ == "__main__":
    raise SystemExit(main())
