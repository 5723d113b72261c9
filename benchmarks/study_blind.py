"""Withheld checks as a page: docs/studies/blind.md.

    servo-models blind --cases 250 --seed 7 --tiers easy --folder runs/7 --json runs/7.json
    python benchmarks/study_blind.py runs/7.json runs/8.json    # adds these runs to the page
    python benchmarks/study_blind.py                            # writes it again

A run adds what was said of each case, and what is true of it, to the folder ``blind`` beside the
page (a table per run, one row a case), so later runs of the same diagnosis add to the figures.
What is to be said about the runs is in ``notes.md`` there.
"""

from __future__ import annotations

import csv
import io
import json
import platform
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from servo_models.blind.interval import Figure
from servo_models.blind.oracle import Known
from servo_models.blind.said import Said
from servo_models.blind.score import FIGURES, Case, calibration, confusion
from servo_models.blind.sheet import BARS, MOST_WANTED, met
from servo_models.files import write_whole

PAGE = Path(__file__).parents[1] / "docs" / "studies" / "blind.md"
TABLES = PAGE.with_suffix("")
RUNS, NOTES = TABLES / "runs.csv", TABLES / "notes.md"
HEAD = """# Withheld checks of the diagnosis

What `servo-models blind` has found, on rigs of a generator that shares no simulation code with
the models: other friction laws, another integrator, its own parameters. The diagnosis has seen
logs and the nominal model. Thresholds were set on cases of other seeds.

`first_place`, `both_named` and the recalls count cases in which the noise-free log separates the
truth from its best rival; `servo_models/blind/score.py` defines every figure in a sentence.
Intervals are 95 %. A bar is open where fewer than {most} cases stand behind a figure.
"""
SHOWN = 15
SURE = 5e-4
"""Probabilities below it are not kept."""


def row_of(case: Mapping[str, Any]) -> dict[str, str]:
    """A case of a run's JSON as one row: what its score is made of."""
    said, known = case["said"], case["oracle"] or {}
    return {
        "case": said["case"],
        "tier": case["tier"],
        "actuator": case["actuator"],
        "kind": case["kind"],
        "truth": " ".join(case["truth"]),
        "hidden": " ".join(case["hidden"]),
        "verdict": said["verdict"],
        "named": " ".join(said["named"]),
        "members": " ".join(said["members"]),
        "chances": " ".join(f"{k}={v:.4g}" for k, v in said["chances"].items() if v >= SURE),
        "before": f"{said['before']:.4g}",
        "after": f"{said['after']:.4g}",
        "seconds": f"{said['seconds']:.2f}",
        "separated": str(int(known.get("separated", 0))),
        "absorbed": str(int(known.get("absorbed", 0))),
        "truth_leaves": number(known.get("truth")),
        "parameters_leave": number(known.get("parameters")),
        "rival": " ".join(known.get("rival_effects", ())),
        "rival_leaves": number(known.get("rival")),
        "after_when_told": number(known.get("after")),
        "left_out": known.get("without", ""),
    }


def number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def case_of(row: Mapping[str, str]) -> Case:
    chances = dict(entry.split("=") for entry in row["chances"].split())
    said = Said(
        case=row["case"],
        verdict=row["verdict"],
        seconds=float(row["seconds"]),
        named=row["named"].split(),
        members=row["members"].split(),
        chances={name: float(chance) for name, chance in chances.items()},
        before=float(row["before"]),
        after=float(row["after"]),
    )
    known = Known(
        case=row["case"],
        truth=float(row["truth_leaves"]) if row["truth_leaves"] else None,
        parameters=float(row["parameters_leave"] or 0.0),
        rival=float(row["rival_leaves"] or 0.0),
        rival_effects=row["rival"].split(),
        separated=row["separated"] == "1",
        absorbed=row["absorbed"] == "1",
        after=float(row["after_when_told"]) if row["after_when_told"] else None,
        without=row["left_out"],
    )
    return Case(
        tier=row["tier"],
        actuator=row["actuator"],
        kind=row["kind"],
        truth=frozenset(row["truth"].split()),
        hidden=frozenset(row["hidden"].split()),
        said=said,
        known=known if row["rival_leaves"] else None,
    )


def read(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write(path: Path, rows: Sequence[Mapping[str, str]]) -> None:
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue().encode())


def keep(paths: Iterable[Path]) -> None:
    """Add runs to the tables; one that is there is written again."""
    runs = {row["seed"]: row for row in read(RUNS)}
    TABLES.mkdir(exist_ok=True)
    for path in paths:
        run = json.loads(path.read_text(encoding="utf-8"))
        seed = str(run["seed"])
        write(TABLES / f"{seed}.csv", [row_of(case) for case in run["cases"]])
        versions = ", ".join(f"{name} {number}" for name, number in run["versions"].items())
        runs[seed] = {
            "seed": seed,
            "tiers": " ".join(run["tiers"]),
            "cases": str(run["n"]),
            "seal": run["seal"],
            "date": str(date.today()),
            "machine": f"{platform.machine()}; {versions}",
        }
    if runs:
        write(RUNS, [runs[seed] for seed in sorted(runs, key=int)])


def verdict(figure: Figure, bar: tuple[str, float]) -> str:
    said = "met" if met(figure, bar) else "missed"
    return said if figure.n >= MOST_WANTED else f"{said} so far"


def figures(tier: str, cases: Sequence[Case]) -> Iterator[str]:
    yield f"## {tier.capitalize()}, {len(cases)} cases\n"
    yield "| figure | value | 95 % | cases | bar | |\n|---|---|---|---|---|---|"
    for define in FIGURES:
        found, bar = define(cases), BARS[tier].get(define.__name__)
        if found.value is None:
            continue
        beside = f"{bar[0]} {bar[1]:g} | {verdict(found, bar)}" if bar else " | "
        span = f"{found.low:.3f} to {found.high:.3f}"
        yield f"| {define.__name__} | {found.value:.3f} | {span} | {found.n} | {beside} |"
    yield ""


def mistakes(cases: Sequence[Case]) -> Iterator[str]:
    """Separated single effects that are not at first place, the most frequent first."""
    wrong = [it for it in cases if it.kind == "one" and it.separated and it.first not in it.truth]
    rows = [
        (count, truth, answer)
        for truth, answers in confusion(wrong).items()
        for answer, count in answers.items()
    ]
    yield "## Single effects not at first place\n"
    yield "| truth | said | cases |\n|---|---|---|"
    for count, truth, answer in sorted(rows, reverse=True)[:SHOWN]:
        yield f"| {truth} | {answer} | {count} |"
    yield ""


def curve(cases: Sequence[Case]) -> Iterator[str]:
    yield "## Calibration, all tiers\n"
    yield "| probability said | mean | the effect is there | 95 % | cases |\n|---|---|---|---|---|"
    for one in calibration(cases):
        right = one.right
        yield (
            f"| {one.low:g} to {one.high:g} | {one.probability:.3f} | {right.value:.3f} |"
            f" {right.low:.3f} to {right.high:.3f} | {right.n} |"
        )
    yield ""


def runs_made(runs: Sequence[Mapping[str, str]]) -> Iterator[str]:
    yield "## Runs\n"
    yield "| seed | tiers | cases | date | seal of the answers (SHA-256) |\n|---|---|---|---|---|"
    for run in runs:
        table = f"[{run['seed']}](blind/{run['seed']}.csv)"
        yield f"| {table} | {run['tiers']} | {run['cases']} | {run['date']} | `{run['seal']}` |"
    yield ""
    yield from (f"{machine}.\n" for machine in dict.fromkeys(run["machine"] for run in runs))


def main(paths: Sequence[Path]) -> None:
    keep(paths)
    runs = read(RUNS) or sys.exit(__doc__)
    cases = [case_of(row) for run in runs for row in read(TABLES / f"{run['seed']}.csv")]
    lines = [HEAD.format(most=MOST_WANTED)]
    for tier in BARS:
        own = [case for case in cases if case.tier == tier]
        if own:
            lines += figures(tier, own)
    lines += [*mistakes(cases), *curve(cases), *runs_made(runs)]
    lines.append(NOTES.read_text(encoding="utf-8") if NOTES.exists() else "")
    write_whole(PAGE, ("\n".join(lines).rstrip() + "\n").encode())


if __name__ == "__main__":
    main([Path(word) for word in sys.argv[1:]])
