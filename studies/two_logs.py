"""Do two logs of different kinds make a diagnosis worse?

    python -m studies two_logs --seed 1 --cases 30 [--folder DIR]

A case is a withheld rig with one or two effects of the catalogue, tiers in turn.  Its first log is
diagnosed alone, and beside a second one, on the same rig, whose command is of another kind: a
family, a size and a pace of those that a diagnosis asks for, drawn at random.  Where both leave
much, the true effects are fitted from their true values: what they leave tells a failure of the
search from logs that nothing explains.  ``DIR/SEED.jsonl`` holds a line a case, which is not done
again.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import warnings
from collections.abc import Sequence
from itertools import count, islice
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.data.audit import LEAST_GAP
from servo_models.data.description import Description, read_description
from servo_models.diagnosis.design.commands import FAMILIES, Command
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.identification.problem import prior_parameters
from servo_models.withheld.generator.cases import CLEAN, Case, draw_case, kind_of, with_log
from servo_models.withheld.generator.files import write_case
from servo_models.withheld.score import Statistic, share

SIZES = (1.0, 0.3)  # sizes of a command over the half range of the first one
PACES = (0.004, 0.012, 0.04, 0.12)  # paces over the length of a log
COMMAND, NOISE = 3, 4
"""What a random generator of a rig is for, beside the rig itself."""
Row = dict[str, Any]


def examined(seed: int, number: int) -> Row:
    """What one log of a rig and two of different kinds lead to."""
    case = draw_case(seed, number, CLEAN[number % len(CLEAN)])
    random = np.random.default_rng([seed, number, COMMAND])
    two = case
    while two is case or not np.isfinite(two.logs[-1]).all():  # from some commands a rig runs away
        command = drawn(case, random)
        values = command.values(times(case))
        values[0] = case.experiment.rig.rest
        two = with_log(case, values, np.random.default_rng([seed, number, NOISE]))
    return {
        "number": number,
        "tier": case.tier,
        "actuator": case.experiment.rig.actuator,
        "truth": sorted(acting.name for acting in case.acting),
        "hidden": sorted(acting.name for acting in case.hidden),
        "command": command.family,
        "one": diagnosed(case),
        "two": diagnosed(two),
    }


def times(case: Case) -> Array:
    """Times [s] of a second log, as long as the first."""
    plan = case.experiment.plans[0]
    rows = len(case.logs[0])
    return plan.stride * case.experiment.rig.step * np.arange(rows, dtype=np.float64)


def drawn(case: Case, random: np.random.Generator) -> Command:
    """A command of a kind that a diagnosis asks for, in the range of the first one."""
    first = case.experiment.plans[0].command
    low, high = float(first.min()), float(first.max())
    duration = float(times(case)[-1])
    return Command(
        str(random.choice([*FAMILIES])),
        0.5 * (low + high),
        0.5 * (high - low) * float(random.choice(SIZES)),
        float(random.choice(PACES)) * duration,
        int(random.integers(1 << 30)),
    )


def diagnosed(case: Case) -> Row:
    """The diagnosis of all logs of a case, and what of it counts."""
    begin = process_time()
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_case(Path(folder), "rig", case)
        told = read_description(Path(folder) / "cases" / "rig" / "description.toml")
        found = diagnose(told, jobs=1)
        seconds = process_time() - begin
        left = found.selection.taken.evidence.rms
        truth, hidden = ({it.name for it in some} for some in (case.acting, case.hidden))
        names = {*found.selection.taken.effects, *found.verdict.members}
        known = None if truth <= names else truth_left(found, told, case)
    return {
        "verdict": found.verdict.kind,
        "named": [*found.selection.taken.effects],
        "rivals": [it.effects for it in found.undecided],
        "left": left,
        "truth_left": known,
        "in_set": truth <= names,
        "right": truth <= names <= truth | hidden,
        "seconds": seconds,
    }


def truth_left(found: Diagnosis, told: Description, case: Case) -> float | None:
    """RMS [noise floors] that the true effects leave, fitted from their true values; None where the
    model lacks one."""
    fitter = Fitter(found.model, found.logs, prior_parameters(told), found.floors)
    every = {it.name: it for it in candidates(found.model, found.logs)}
    acting = (*case.acting, *case.hidden)
    if not all(it.name in every for it in acting):
        return None
    free = [one for it in acting for one in every[it.name].at(it.parameters(case.experiment.rig))]
    fitted = fitter.surveyed().fit(tuple(it.name for it in acting), free)
    return float(fitted.evidence.rms)


def table(rows: Sequence[Row]) -> str:
    """The figures of all tiers and of each."""
    lines = [
        "tier | cases | truth in the set: one log | two | right alone: one log | two"
        " | lost, gained | two leave more than 2 noise floors | and the truth less | seconds"
    ]
    for tier in ("all", *CLEAN):
        here = [row for row in rows if tier in ("all", row["tier"])]
        shares = [
            told(share([row[logs][key] for row in here]))
            for key in ("in_set", "right")
            for logs in ("one", "two")
        ]
        pairs = [(row["one"]["in_set"], row["two"]["in_set"]) for row in here]
        far = [row for row in here if row["two"]["left"] > LEAST_GAP]
        failed = [row for row in far if is_failure(row["two"])]
        lines.append(
            f"{tier} | {len(here)} | {' | '.join(shares)}"
            f" | {pairs.count((True, False))}, {pairs.count((False, True))}"
            f" | {len(far)} | {len(failed)} | {sum(row['two']['seconds'] for row in here):.0f}"
        )
    return "\n".join(lines)


def is_failure(found: Row) -> bool:
    """Whether much is left that the truth would not leave."""
    return found["truth_left"] is not None and found["truth_left"] < 0.8 * found["left"]


def told(found: Statistic) -> str:
    if found.value is None:
        return "-"
    return f"{found.value:.2f} ({found.low:.2f} to {found.high:.2f})"


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--folder", type=Path, default=Path("two_logs"))
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    path = given.folder / f"{given.seed}.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    numbers = (k for k in count() if kind_of(given.seed, k) in ("one", "two"))
    for number in islice(numbers, given.cases):
        if number in (row["number"] for row in rows):
            continue
        rows.append(examined(given.seed, number))
        with path.open("a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(rows[-1], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
