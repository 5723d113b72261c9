"""Withheld checks as a page: docs/studies/blind.md.

    servo-models blind --cases 1800 --seed 7 --folder runs/7 --json runs/7.json   # hours
    python benchmarks/study_blind.py runs/7.json runs/8.json "A note on these runs."

Cases of all files count together; every seed and seal is told, and each note is a paragraph.
"""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Iterator, Sequence
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
HEAD = """# Withheld checks of the diagnosis

What `servo-models blind` has found, on rigs of a generator that shares no simulation code with
the models: other friction laws, another integrator, its own parameters. The diagnosis has seen
logs and the nominal model. Thresholds were set on cases of other seeds.

`first_place`, `both_named` and the recalls count cases in which the noise-free log separates the
truth from its best rival; `servo_models/blind/score.py` defines every figure in a sentence.
Intervals are 95 %. A bar is open where fewer than {most} cases stand behind a figure.
"""
SHOWN = 15


def case_of(row: dict[str, Any]) -> Case:
    known = row["oracle"]
    return Case(
        row["tier"],
        row["actuator"],
        row["kind"],
        frozenset(row["truth"]),
        frozenset(row["hidden"]),
        Said(**row["said"]),
        Known(**known) if known else None,
    )


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


def main(paths: Sequence[Path], notes: Sequence[str]) -> None:
    runs = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    cases = [case_of(row) for run in runs for row in run["cases"]]
    lines = [HEAD.format(most=MOST_WANTED)]
    for tier in BARS:
        own = [case for case in cases if case.tier == tier]
        if own:
            lines += figures(tier, own)
    lines += [*mistakes(cases), *curve(cases), "## Runs\n"]
    lines += ["| seed | cases | seal of the answers (SHA-256) |\n|---|---|---|"]
    lines += [f"| {run['seed']} | {run['n']} | `{run['seal']}` |" for run in runs]
    versions = ", ".join(f"{name} {number}" for name, number in runs[0]["versions"].items())
    lines += ["", f"{date.today()}, {platform.machine()}, two processors; {versions}.", ""]
    lines += [f"{note}\n" for note in notes]
    write_whole(PAGE, "\n".join(lines).encode())


if __name__ == "__main__":
    words = sys.argv[1:]
    files = [Path(word) for word in words if word.endswith(".json")]
    main(files or sys.exit(__doc__), [word for word in words if not word.endswith(".json")])
