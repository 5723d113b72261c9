"""Learn what probability the model weight of an effect stands for: calibration.json.

    servo-models blind --cases 900 --seed 31 --folder runs/31 --json runs/31.json
    python -m studies calibrate runs/*.json                           # how well it would do
    python -m studies calibrate runs/*.json --commit dc14424 --write  # the shipped maps
    python -m studies calibrate                                       # from withheld/before

Use seeds for nothing else: figures of a study on the same seeds would look too good.  The figures
printed are of maps that have not seen the seed they are judged on.  Needs scipy 1.12.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs

from servo_models.core.types import Array
from servo_models.diagnosis.calibration import DATA, MOST_PROBABILITY, Map, probability
from servo_models.diagnosis.verdict import OUTSIDE
from servo_models.files import write_whole
from servo_models.withheld.score import (
    Case,
    calibration_error,
    log_loss,
    sure_ones_right,
    told_surely,
)
from studies.blind import BEFORE, case_of, known_cases, known_runs, row_of

FIGURES = (calibration_error, sure_ones_right, log_loss, told_surely)
FOLDS, FEWEST_SEEDS = 6, 3
"""Parts of the seeds, each left out in turn."""
DIGITS = 4  # of a probability, which no study knows better


class Run(NamedTuple):
    """Cases of one seed, and the commit that made their diagnoses."""

    seed: int
    commit: str
    cases: list[Case]


def learn(weights: Array, there: Array, counts: Array) -> Map:
    """Return the monotone map from weights to how often the effect was ``there`` (0 or 1).

    ``counts`` says for how much each one counts.  Only the ends of each level part are kept.
    """
    from scipy.optimize import isotonic_regression

    known, place = np.unique(weights, return_inverse=True)
    total = np.bincount(place, counts)
    level = isotonic_regression(np.bincount(place, counts * there) / total, weights=total)
    ends = np.unique(np.concatenate([level.blocks[:-1], level.blocks[1:] - 1]))
    return known[ends], np.minimum(level.x[ends], MOST_PROBABILITY)


def learnt(cases: Iterable[Case]) -> dict[str, Map]:
    """Return the map of each kind of verdict; every tier counts alike."""
    told = [
        (case.said.verdict, case.tier, weight, name in case.truth | case.hidden)
        for case in cases
        if case.kind in ("one", "two") and case.said.verdict != OUTSIDE
        for name, weight in case.said.chances.items()
    ]
    verdicts, tiers = (np.array([one[k] for one in told]) for k in (0, 1))
    weights, there = (np.array([one[k] for one in told], dtype=float) for k in (2, 3))
    share = {tier: 1.0 / np.mean(tiers == tier) for tier in np.unique(tiers)}
    counts = np.array([share[tier] for tier in tiers])
    return {
        str(kind): learn(weights[own], there[own], counts[own])
        for kind in np.unique(verdicts)
        for own in [verdicts == kind]
    }


def with_probabilities(case: Case, maps: dict[str, Map]) -> Case:
    """Return a case as these maps would have told it."""
    by, weights = maps.get(case.said.verdict), case.said.chances
    told = probability(np.array(list(weights.values())), by).tolist() if by and weights else []
    return replace(case, said=structs.replace(case.said, probabilities=dict(zip(weights, told))))


def cross_validated(runs: Sequence[Run]) -> list[Case]:
    """Return every case as told by maps that its seed had no part in."""
    seeds = sorted({run.seed for run in runs})
    folds = min(FOLDS, len(seeds))
    fold = {seed: k % folds for k, seed in enumerate(seeds)}
    found = []
    for k in range(folds):
        others = [case for run in runs if fold[run.seed] != k for case in run.cases]
        own = [case for run in runs if fold[run.seed] == k for case in run.cases]
        maps = learnt(others)
        found += [with_probabilities(case, maps) for case in own]
    return found


def before(cases: Iterable[Case]) -> list[Case]:
    """The same cases with their weights told as if they were probabilities, where any are told."""
    return [
        replace(case, said=structs.replace(case.said, probabilities=case.said.chances))
        if case.said.probabilities
        else case
        for case in cases
    ]


def figures(cases: Sequence[Case]) -> dict[str, dict[str, float]]:
    """Return the figures of each tier, where there are any."""
    found: dict[str, dict[str, float]] = {}
    for tier in sorted({case.tier for case in cases}):
        own = [define([case for case in cases if case.tier == tier]) for define in FIGURES]
        values = {define.__name__: one.value for define, one in zip(FIGURES, own)}
        found[tier] = {name: round(value, DIGITS) for name, value in values.items() if value}
    return found


def table(title: str, cases: Sequence[Case]) -> None:
    print(f"\n{title}")
    for tier in sorted({case.tier for case in cases}):
        own = [case for case in cases if case.tier == tier]
        for define in FIGURES:
            found = define(own)
            if found.value is not None:
                span = f"{found.low:.4f} to {found.high:.4f}"
                print(f"{tier:5} {define.__name__:18} {found.value:.4f}  ({span})  n={found.n}")


def kept_runs() -> list[Run]:
    """Runs of the diagnosis before, in the tables of the study."""
    return [
        Run(int(row["seed"]), row["commit"], known_cases([row], BEFORE))
        for row in known_runs(BEFORE)
    ]


def run_of(path: Path, commit: str) -> Run:
    """A run as ``servo-models blind --json`` has written it."""
    known = json.loads(path.read_text(encoding="utf-8"))
    return Run(known["seed"], commit, [case_of(row_of(case)) for case in known["cases"]])


def document(runs: Sequence[Run], judged: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Return the maps of all runs with where they are from, and what ``cross_validated`` is."""
    every = [case for run in runs for case in run.cases]
    tiers = sorted({case.tier for case in every})
    return {
        "about": "made by studies/calibrate.py for servo_models/diagnosis/calibration.py",
        "date": str(date.today()),
        "commits": sorted({run.commit for run in runs}),
        "seeds": sorted({run.seed for run in runs}),
        "cases": {tier: sum(case.tier == tier for case in every) for tier in tiers},
        "cross_validated": judged,
        "maps": {
            kind: {"weight": weights.tolist(), "probability": told.round(DIGITS).tolist()}
            for kind, (weights, told) in learnt(every).items()
        },
        "doubted": json.loads(DATA.read_text(encoding="utf-8"))["doubted"],  # of another study
    }


def text_of(known: dict[str, Any]) -> str:
    """Return a document as JSON, one line an entry and two a map."""
    maps = ",\n".join(
        f'  "{kind}": {{\n   "weight": {json.dumps(one["weight"])},\n'
        f'   "probability": {json.dumps(one["probability"])}\n  }}'
        for kind, one in known["maps"].items()
    )
    rest = [f' "{key}": {json.dumps(value)}' for key, value in known.items() if key != "maps"]
    return ",\n".join(["{\n" + rest[0], *rest[1:], f' "maps": {{\n{maps}\n }}']) + "\n}\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("runs", nargs="*", type=Path, help="JSON of servo-models blind")
    parser.add_argument("--commit", default="", help="that made the diagnoses of these runs")
    parser.add_argument("--write", action="store_true", help=f"write {DATA.name}")
    given = parser.parse_args()
    if given.runs and given.write and not given.commit:
        parser.error("--write needs the --commit that made the diagnoses")
    runs = [run_of(path, given.commit) for path in given.runs] or kept_runs()
    if len({run.seed for run in runs}) < FEWEST_SEEDS:
        parser.error(f"give runs of {FEWEST_SEEDS} seeds or more: some are left out to be judged")
    told = cross_validated(runs)
    table("weights told as probabilities", before(told))
    table("calibrated, seeds left out in turn", told)
    if given.write:
        write_whole(DATA, text_of(document(runs, figures(told))).encode())
        print(f"\n{DATA} is written")


if __name__ == "__main__":
    main()
