"""Does the second log that a diagnosis asks for decide what the first one leaves open?

    python -m studies second_log --seed 1 --cases 60 [--jobs 1] [--resume] [--folder DIR]

A case is a withheld rig with one or two effects of the catalogue (tiers in turn) whose first log
leaves more than one explanation.  Its diagnosis asks for a command; the generator plays that on the
same rig, with the same sensors and noise, and both logs are diagnosed together.  The control is a
second log of the first command's kind and of the same length.  *Right and alone*: the verdict is
``effect`` or ``effects``, those named and those of the confidence set are the true ones (a hidden
one of the hard tier may be among them), and none is missing.

Where a diagnosis says that no command tells its explanations apart, it asks for no log: these rigs
are counted apart, beyond the cases wanted.  No command helps where the first log has ruled out the
truth, or where the truth is like another explanation under every command: these cases count, and
are told.  Intervals are Wilson's (J. American Statistical Association 22 (1927) 209), the paired
difference is tested by McNemar's exact test (Psychometrika 12 (1947) 153).  ``DIR/SEED.jsonl``
holds a line a rig; ``--resume`` goes on after the last one.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.verdict import EFFECT, EFFECTS
from studies.withheld.generator.cases import CLEAN, Case, another_command, draw_case, with_log
from studies.withheld.generator.files import write_case
from studies.withheld.score import share

ASKED, CONTROL = "asked", "control"
CONTROL_COMMAND, NOISE = 1, 2
"""What a random generator of a rig is for, beside the rig itself."""
Row = dict[str, Any]


def examined(seed: int, number: int) -> Row:
    """What the first log of a rig and either second one lead to."""
    case = draw_case(seed, number, CLEAN[number % len(CLEAN)])
    row: Row = {
        "number": number,
        "tier": case.tier,
        "actuator": case.experiment.rig.actuator,
        "truth": sorted(acting.name for acting in case.acting),
        "hidden": sorted(acting.name for acting in case.hidden),
    }
    if case.kind not in ("one", "two"):
        return row
    first, row["first"] = _diagnosed(case)
    if row["first"]["right_and_alone"] or len(first.undecided) < 2:
        return row
    begin = time.perf_counter()
    planned = [one for one in first.next_experiments if one.telling]
    row |= {"planned": len(planned), "design_seconds": time.perf_counter() - begin}
    if not planned:
        return row
    asked = planned[0]
    row |= {
        "text": asked.text,
        "explanations": [list(effects) for effects in asked.explanations],
        "separations": asked.separations.tolist(),
        "told": asked.told.tolist(),
    }
    commands = {
        ASKED: asked.command,
        CONTROL: another_command(case, len(asked.command), _random(seed, number, CONTROL_COMMAND)),
    }
    for arm, command in commands.items():
        _, row[arm] = _diagnosed(with_log(case, command, _random(seed, number, NOISE)))
    return row


def _random(seed: int, number: int, use: int) -> np.random.Generator:
    return np.random.default_rng([seed, number, use])


def _diagnosed(case: Case) -> tuple[Diagnosis, Row]:
    """The diagnosis of all logs of a case, and what of it counts."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_case(Path(folder), "rig", case)
        found = diagnose(Path(folder) / "cases" / "rig" / "description.toml", jobs=1)
    truth, hidden = ({one.name for one in some} for some in (case.acting, case.hidden))
    named, members = set(found.selection.taken.effects), set(found.verdict.members)
    decided = found.verdict.kind in (EFFECT, EFFECTS)
    return found, {
        "verdict": found.verdict.kind,
        "named": sorted(named),
        "rivals": [list(one.effects) for one in found.undecided],
        "left": found.selection.taken.evidence.rms,
        "right_and_alone": decided and truth <= named and named | members <= truth | hidden,
        "seconds": time.perf_counter() - begin,
    }


def rows(seed: int, jobs: int, known: Sequence[Row]) -> Iterator[Row]:
    """What is known, then further rigs without end, in order."""
    yield from known
    numbers = count(len(known))
    if jobs == 1:
        yield from (examined(seed, number) for number in numbers)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        ahead = [pool.submit(examined, seed, next(numbers)) for _ in range(2 * jobs)]
        try:
            while True:
                yield ahead.pop(0).result()
                ahead.append(pool.submit(examined, seed, next(numbers)))
        finally:
            pool.shutdown(cancel_futures=True)


def table(found: Sequence[Row]) -> str:
    """The figures of all tiers and of each."""
    lines = [
        "tier | rigs | open after the first log | no command tells | right and alone: asked"
        " | control | asked alone, control alone | McNemar p | truth no candidate"
        " | asked, where the command is expected to leave the truth alone"
    ]
    for tier in ("all", *CLEAN):
        here = [row for row in found if tier in ("all", row["tier"])]
        cases = [row for row in here if ASKED in row]
        open_ = [row for row in here if "planned" in row]
        right = {arm: [row[arm]["right_and_alone"] for row in cases] for arm in (ASKED, CONTROL)}
        pairs = list(zip(right[ASKED], right[CONTROL]))
        better, worse = pairs.count((True, False)), pairs.count((False, True))
        p = binomtest(better, better + worse).pvalue if better + worse else 1.0
        truths = [_truth(row) for row in cases]
        alone = [
            flag
            for row, i, flag in zip(cases, truths, right[ASKED])
            if i is not None and sum(row["told"][i]) == len(row["told"]) - 1
        ]
        figures = " | ".join(map(_share, right.values()))
        lines.append(
            f"{tier} | {len(here)} | {len(open_)} | {len(open_) - len(cases)} | {figures}"
            f" | {better}, {worse} | {p:.3g} | {truths.count(None)} | {_share(alone)}"
        )
    return "\n".join(lines)


def _truth(row: Row) -> int | None:
    """Which of the explanations that the command is designed for is the true one."""
    truth, hidden = set(row["truth"]), set(row["hidden"])
    for i, effects in enumerate(row["explanations"]):
        if truth <= set(effects) <= truth | hidden:
            return i
    return None


def _share(flags: Sequence[bool]) -> str:
    found = share(flags)
    if found.value is None:
        return "-"
    return f"{found.value:.3f} ({found.low:.3f} to {found.high:.3f}) of {found.n}"


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=60, help="rigs that are asked for a log")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--folder", type=Path, default=Path("second_log"))
    given = parser.parse_args()
    path = given.folder / f"{given.seed}.jsonl"
    if path.exists() and not given.resume:
        parser.error(f"'{path}' is there already: give --resume to go on, or another --folder")
    given.folder.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    found: list[Row] = []
    with path.open("a") as file:
        for row in rows(given.seed, given.jobs, known):
            found.append(row)
            if len(found) > len(known):
                file.write(json.dumps(row) + "\n")
                file.flush()
            done = sum(ASKED in one for one in found)
            print(f"\r{len(found)} rigs, {done}/{given.cases} cases", end="", flush=True)
            if done == given.cases:
                break
    print("\n" + table(found))


if __name__ == "__main__":
    main()
