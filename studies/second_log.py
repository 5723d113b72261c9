"""Does the second log that a diagnosis asks for decide what the first one leaves open?

    python -m studies second_log --seed 1 --cases 60 [--tiers poor] [--jobs 1] [--resume]
        [--folder DIR]

A case is a withheld rig with one or two effects of the catalogue (tiers in turn) whose first log
leaves more than one explanation, the true one among them.  Its diagnosis asks for an action: a
command, a condition, further signals; the generator plays that on the same rig, with the same
sensors and noise, and both logs are diagnosed together.  The control is a second log of the first
command's kind and of the same length.  *Right and alone*: the verdict is ``effect`` or ``effects``,
those named and those of the confidence set are the true ones (a hidden one of the hard tier may be
among them), and none is missing.

Told apart, and no cases: rigs whose first log has ruled out the truth, and those whose diagnosis
says that nothing tells its explanations apart.  Intervals are Wilson's (J. American Statistical
Association 22 (1927) 209), the paired difference is tested by McNemar's exact test (Psychometrika
12 (1947) 153).  ``DIR/SEED.jsonl`` holds a line a rig; ``--resume`` goes on after the last one.
The table is of all seeds in ``DIR``.
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
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.verdict import EFFECT, EFFECTS
from servo_models.withheld.generator.cases import (
    CLEAN,
    Case,
    another_command,
    draw_case,
    kind_of,
    with_log,
)
from servo_models.withheld.generator.files import write_case
from servo_models.withheld.score import share

ASKED, CONTROL = "asked", "control"
CONTROL_COMMAND, NOISE = 1, 2
"""What a random generator of a rig is for, beside the rig itself."""
Row = dict[str, Any]


def examined(seed: int, tiers: Sequence[str], number: int) -> Row:
    """What the first log of a rig and either second one lead to."""
    row: Row = {"number": number, "tier": tiers[number % len(tiers)]}
    if kind_of(seed, number) not in ("one", "two"):
        return row
    case = draw_case(seed, number, row["tier"])
    row |= {
        "actuator": case.experiment.rig.actuator,
        "truth": sorted(acting.name for acting in case.acting),
        "hidden": sorted(acting.name for acting in case.hidden),
    }
    first, row["first"] = _diagnosed(case)
    if row["first"]["right_and_alone"] or len(first.undecided) < 2:
        return row
    row["open"] = True
    if not any(map(partial(_true, row), row["first"]["rivals"])):
        return row
    begin = time.perf_counter()
    asked = first.next_experiments[0]
    row |= {
        "design_seconds": time.perf_counter() - begin,
        "text": asked.text,
        "telling": asked.telling,
        "decides": asked.decides,
        "explanations": [list(effects) for effects in asked.explanations],
        "imitated": asked.imitated,
        "told": asked.told.tolist(),
    }
    if not asked.telling:
        return row
    further = [name for name in asked.floors if name not in first.floors]
    again = case
    for plan in asked.plans:
        changed = plan.constants if plan is not asked.plans[0] else {}
        rng = _random(seed, number, NOISE + len(again.further))
        again = with_log(again, asked.command, rng, changed, further)
    rows = len(asked.command) * len(asked.plans)
    control = another_command(case, rows, _random(seed, number, CONTROL_COMMAND))
    control_case = with_log(case, control, _random(seed, number, NOISE))
    for arm, one in ((ASKED, again), (CONTROL, control_case)):
        _, row[arm] = _diagnosed(one)
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


def rows(seed: int, tiers: Sequence[str], jobs: int, known: Sequence[Row]) -> Iterator[Row]:
    """What is known, then further rigs without end, in order."""
    yield from known
    numbers = count(len(known))
    if jobs == 1:
        yield from (examined(seed, tiers, number) for number in numbers)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context) as pool:
        ahead = [pool.submit(examined, seed, tiers, next(numbers)) for _ in range(2 * jobs)]
        try:
            while True:
                yield ahead.pop(0).result()
                ahead.append(pool.submit(examined, seed, tiers, next(numbers)))
        finally:
            pool.shutdown(cancel_futures=True)


def table(found: Sequence[Row]) -> str:
    """The figures of all tiers and of each."""
    lines = [
        "tier | rigs | open after the first log | truth no candidate | nothing tells | right and"
        " alone: asked | control | asked alone, control alone | McNemar p | expected"
    ]
    for tier in ("all", *CLEAN):
        here = [row for row in found if tier in ("all", row["tier"])]
        cases = [row for row in here if ASKED in row]
        open_ = [row for row in here if "open" in row]
        lost = [row for row in open_ if "telling" not in row]
        right = {arm: [row[arm]["right_and_alone"] for row in cases] for arm in (ASKED, CONTROL)}
        pairs = list(zip(right[ASKED], right[CONTROL]))
        better, worse = pairs.count((True, False)), pairs.count((False, True))
        p = binomtest(better, better + worse).pvalue if better + worse else 1.0
        figures = " | ".join(map(_share, right.values()))
        expected = f"{np.mean([row['decides'] for row in cases]):.2f}" if cases else "-"
        lines.append(
            f"{tier} | {len(here)} | {len(open_)} | {len(lost)}"
            f" | {len(open_) - len(lost) - len(cases)} | {figures} | {better}, {worse} | {p:.3g}"
            f" | {expected}"
        )
    return "\n".join(lines)


def _true(row: Row, effects: Sequence[str]) -> bool:
    """Whether an explanation is the true one; what is hidden may be a part of it."""
    truth, hidden = {*row["truth"]}, {*row["hidden"]}
    return truth <= {*effects} <= truth | hidden


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
    parser.add_argument("--tiers", default=",".join(CLEAN), help="in turn")
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
        for row in rows(given.seed, given.tiers.split(","), given.jobs, known):
            found.append(row)
            if len(found) > len(known):
                file.write(json.dumps(row) + "\n")
                file.flush()
            done = sum(ASKED in one for one in found)
            print(f"\r{len(found)} rigs, {done}/{given.cases} cases", end="", flush=True)
            if done == given.cases:
                break
    every = sorted(given.folder.glob("*.jsonl"))
    print("\n" + table([json.loads(line) for it in every for line in it.read_text().splitlines()]))


if __name__ == "__main__":
    main()
