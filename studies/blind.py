"""Withheld checks as a page: docs/studies/blind.md.

    servo-models blind --cases 250 --seed 7 --tiers easy --folder runs/7 --json runs/7.json
    python -m studies blind dc14424 runs/7.json runs/8.json    # adds runs to the page
    python -m studies blind                                    # writes it again

A run adds what was said of each case, and what is true of it, to the folder ``withheld`` beside
this script (a table per run, one row a case), with the commit that made the diagnoses: runs of the
same diagnosis add up.  To begin with another one is to move them to ``withheld/before``, of which
the page shows a column.  What is to be said about them is in ``notes.md``.
"""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from servo_models.diagnosis.verdict import OUTSIDE
from servo_models.files import write_whole
from servo_models.withheld.oracle import Diagnosed, Known
from servo_models.withheld.score import FIGURES, Case, calibration, confusion
from servo_models.withheld.sections import BARS, MOST_WANTED, standing

PAGE = Path(__file__).parents[1] / "docs" / "studies" / "blind.md"
TABLES = Path(__file__).with_name("blind_runs")
BEFORE = TABLES / "before"  # runs of the diagnosis before, of which ``calibrate.py`` learns
RUNS, NOTES = "runs.csv", TABLES / "notes.md"
HEAD = """# Withheld checks of the diagnosis

What `servo-models blind` has found, on rigs of a generator that shares no simulation code with
the models: other laws of friction, play and hysteresis, another integrator, its own parameters
(other effects have one law only). The diagnosis has seen logs and the nominal model. Thresholds
were set on rigs of other seeds.

A case is of one of these rigs:

| rig | variant | judged | may be logged as well | causes of the catalogue |
|---|---|---|---|---|
| `sg90` | `measured` | angle from outside | motor voltage, feedback voltage | 32 |
| `torque_motor` | `measured` | angle | current | 32 |
| `smart_servo` | `sts3215` | angle from outside | duty | 24 |
| `second_order_servo` | `pulse` | angle from outside | rate of a gyro | 30 |
| `dc_motor_speed` | `direct` | speed from the motor's encoder | current | 19 |
| `dc_motor` | `geared` | angle from the motor's encoder | current | 24 |
| `dc_motor_current` | `direct` | angle from the motor's encoder | current | 22 |

Nothing holds the last two: what they play, and their load, goes both ways for equal times, so that
they come back.

A rig has nothing wrong, one effect, two, or a cause *outside the catalogue*, and its parameters are
off by their uncertainty. What a cause does alone to the noise-free reading is its gap (RMS), and
the noise follows from it:

| tier | gap [noise floors] | noise | rows per fastest time constant | command |
|---|---|---|---|---|
| easy | 5 to 20 | white, 1 floor | 20 or more | steps, triangles, chirp |
| hard | 5 to 20 | coloured, 3 floors; a reading quantum | 5 or more | steps, triangles, chirp |
| poor | 5 to 20 | white, 1 floor | 20 or more | one large step there and back |
| rough | 5 to 20 | white, 1 floor | 20 or more, before faults | steps, triangles, chirp |

The recording of a *rough* case has one or two faults: uneven rows, dropped rows, a command and a
judged reading in coarse steps, rows stamped as they arrive, single wild readings, a constant that
is 2 to 4 standard deviations from its nominal value (`servo_models/withheld/generator/faults.py`).

On the hard tier a single cause, of the catalogue or not, comes with a *hidden* effect of 30 % of
its gap. A cause is *separated* from its best rival where the two, both fitted to the log without
noise, are so far apart that an observer who knows both would confuse them in fewer than 1 of 160
logs, and the cause leaves less than half of the rival's error, which one outside the catalogue does
by definition. The observer takes errors to change slowly beside coloured noise, so more could be
told apart. Rivals are the four nearest explanations by no more effects that the diagnosis itself
has tried, so one that searches wider separates fewer. A cause is *absorbed* where such an observer
confuses it with parameters alone. Intervals are 95 %.
Where fewer than {most} cases stand behind a figure its bar is met or missed *so far*.
"""
Row = dict[str, str]
UNASKED = "?"  # what a row says of effects that parameters imitate where none was looked for


def row_of(case: Mapping[str, Any]) -> Row:
    """Return a case of a run's JSON as a row; errors are in noise floors, times in seconds.

    Without an oracle, since nothing was wrong with the rig, its columns are empty.
    """
    said, known = case["said"], case["oracle"] or {}
    imitated = said.get("imitated")  # earlier runs have not looked
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
        "chances": _shares(said["chances"]),
        "probabilities": _shares(said.get("probabilities", said["chances"])),
        "before": _text(said["before"]),
        "after": _text(said["after"]),
        "seconds": _text(round(said["seconds"], 3)),
        "separated": _text(known.get("separated")),
        "absorbed": _text(known.get("absorbed")),
        "truth_leaves": _text(known.get("truth")),
        "parameters_leave": _text(known.get("parameters")),
        "rival": " ".join(known.get("rival_effects", ())),
        "rival_leaves": _text(known.get("rival")),
        "after_when_told": _text(known.get("after")),
        "when_left_out": known.get("without", ""),
        "imitated": UNASKED if imitated is None else " ".join(imitated),
    }


def case_of(row: Mapping[str, str]) -> Case:
    """Return the case of a row, without what no figure asks for, such as all that was tried."""
    imitated = row.get("imitated", UNASKED)  # no column in tables of earlier runs
    chances = row["chances"]  # earlier runs told them as probabilities
    said = Diagnosed(
        case=row["case"],
        verdict=row["verdict"],
        seconds=float(row["seconds"]),
        named=row["named"].split(),
        members=row["members"].split(),
        chances=_by_name(chances),
        probabilities=_by_name(row.get("probabilities", chances)),
        before=_number(row["before"]),
        after=_number(row["after"]),
        imitated=None if imitated == UNASKED else imitated.split(),
    )
    known = Known(
        case=row["case"],
        truth=_number(row["truth_leaves"]) if row["truth_leaves"] else None,
        parameters=_number(row["parameters_leave"]),
        rival=_number(row["rival_leaves"]),
        rival_effects=row["rival"].split(),
        separated=row["separated"] == "True",
        absorbed=row["absorbed"] == "True",
        after=_number(row["after_when_told"]) if row["after_when_told"] else None,
        without=row["when_left_out"],
    )
    return Case(
        tier=row["tier"],
        actuator=row["actuator"],
        kind=row["kind"],
        truth=frozenset(row["truth"].split()),
        hidden=frozenset(row["hidden"].split()),
        said=said,
        known=known if row["separated"] else None,
    )


def _shares(by_name: Mapping[str, float]) -> str:
    return " ".join(f"{name}={one!r}" for name, one in by_name.items())


def _by_name(text: str) -> dict[str, float]:
    return {name: float(one) for name, _, one in (entry.partition("=") for entry in text.split())}


def _text(value: float | None) -> str:
    """JSON has no number for what is infinite: it comes as None."""
    return "" if value is None else repr(value)


def _number(text: str) -> float:
    return float(text) if text else float("inf")


def read(path: Path) -> list[Row]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write(path: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue().encode())


def known_runs(folder: Path = TABLES) -> list[Row]:
    """Return the runs in a folder of tables."""
    return read(folder / RUNS) if (folder / RUNS).exists() else []


def known_cases(runs: Iterable[Row], folder: Path = TABLES) -> list[Case]:
    """Return the cases of some runs in a folder of tables."""
    return [case_of(row) for run in runs for row in read(folder / run["table"])]


def keep(commit: str, paths: Iterable[Path]) -> None:
    """Add runs to the tables; one that is there is written again."""
    runs = {row["table"]: row for row in known_runs()}
    for path in paths:
        run = json.loads(path.read_text(encoding="utf-8"))
        table = f"{run['seed']}-{'-'.join(run['tiers'])}.csv"
        if runs.get(table, run)["seal"] != run["seal"]:
            sys.exit(
                f"{path}: {TABLES / RUNS} holds other cases of seed {run['seed']}: use another seed"
            )
        TABLES.mkdir(exist_ok=True)
        write(TABLES / table, [row_of(case) for case in run["cases"]])
        runs[table] = {
            "table": table,
            "seed": str(run["seed"]),
            "tiers": " ".join(run["tiers"]),
            "cases": str(run["n"]),
            "seal": run["seal"],
            "commit": commit,
            "added": str(date.today()),
            "made with": ", ".join(f"{name} {found}" for name, found in run["versions"].items()),
        }
    write(TABLES / RUNS, sorted(runs.values(), key=lambda row: (row["tiers"], int(row["seed"]))))


def figures(tier: str, cases: Sequence[Case], before: Sequence[Case]) -> Iterator[str]:
    yield f"## {tier.capitalize()}, {len(cases)} cases\n"
    yield f"Before: {len(before)} cases, other seeds.\n"
    yield "| figure | before | now | 95 % | cases | bar | |\n|---|---|---|---|---|---|---|"
    for define in FIGURES:
        found, was, bar = define(cases), define(before).value, BARS[tier].get(define.__name__)
        if found.value is None:
            continue
        beside = f"{bar[0]} {bar[1]:g} | {standing(found, bar)}" if bar else " | "
        span = f"{found.low:.3f} to {found.high:.3f}"
        old = "" if was is None else f"{was:.3f}"
        yield f"| {define.__name__} | {old} | {found.value:.3f} | {span} | {found.n} | {beside} |"
    yield ""


def by_actuator(cases: Sequence[Case]) -> Iterator[str]:
    """Every figure that has a bar, for each actuator alone."""
    actuators = sorted({case.actuator for case in cases})
    yield "## Each actuator alone\n"
    yield f"| tier | figure | bar | {' | '.join(actuators)} |\n|{'---|' * (3 + len(actuators))}"
    known = {case.tier for case in cases}
    for tier, bars in ((tier, bars) for tier, bars in BARS.items() if tier in known):
        for define in (it for it in FIGURES if it.__name__ in bars):
            own = [
                define([c for c in cases if (c.tier, c.actuator) == (tier, a)]) for a in actuators
            ]
            said = [f"{it.value:.3f} of {it.n}" if it.n else "" for it in own]
            way, limit = bars[define.__name__]
            yield f"| {tier} | {define.__name__} | {way} {limit:g} | {' | '.join(said)} |"
    yield ""


def meanings() -> Iterator[str]:
    """What each figure counts, as its function says."""
    yield "## What the figures count\n"
    yield "| figure | cases: what is counted |\n|---|---|"
    for define in FIGURES:
        text = " ".join((define.__doc__ or "").split()).replace("``", "`")
        yield f"| {define.__name__} | {text} |"
    yield ""


def confusions(cases: Sequence[Case]) -> Iterator[str]:
    """What was said of separated single causes: the confusion matrix without its zeros."""
    yield "## What single causes were taken for\n"
    yield "Separated ones of all tiers. On the hard tier an effect beside may be the hidden one.\n"
    for kind, right in (("one", "named alone"), ("foreign", OUTSIDE)):
        yield f"| truth | cases | {right} | otherwise |\n|---|---|---|---|"
        own = [case for case in cases if case.kind == kind and case.separated]
        for truth, answers in confusion(own).items():
            good = truth if kind == "one" else OUTSIDE
            others = ", ".join(f"{said} {count}" for said, count in answers.items() if said != good)
            yield f"| {truth} | {sum(answers.values())} | {answers.get(good, 0)} | {others} |"
        yield ""


def curve(cases: Sequence[Case]) -> Iterator[str]:
    yield "## Calibration, all tiers\n"
    asked = [case for case in cases if case.kind in ("one", "two")]
    true = [(case, name) for case in asked for name in case.truth | case.hidden]
    unsaid = sum(name not in case.said.chances for case, name in true)
    yield (
        "Every effect that was given a probability on a rig with one or two effects of the"
        " catalogue: those of explanations by as many effects as were taken. Of"
        f" {len(true)} true effects, hidden ones included, {unsaid} were given none.\n"
    )
    yield "| probability said | mean | effect is there | 95 % | effects |\n|---|---|---|---|---|"
    for one in calibration(cases):
        right = one.right
        yield (
            f"| {one.low:g} to {one.high:g} | {one.probability:.3f} | {right.value:.3f} |"
            f" {right.low:.3f} to {right.high:.3f} | {right.n} |"
        )
    yield ""


def runs_made(runs: Sequence[Row]) -> Iterator[str]:
    yield "## Runs\n"
    yield "| seed | tiers | cases | commit | seal of the answers (SHA-256) |\n|---|---|---|---|---|"
    for run in runs:
        seed = f"[{run['seed']}](../../studies/blind_runs/{run['table']})"
        yield f"| {seed} | {run['tiers']} | {run['cases']} | {run['commit']} | `{run['seal']}` |"
    yield ""
    for day, versions in dict.fromkeys((run["added"], run["made with"]) for run in runs):
        yield f"{day}, two processors; {versions}.\n"


def main(words: Sequence[str]) -> None:
    if words:
        keep(words[0], [Path(word) for word in words[1:]] or sys.exit(__doc__))
    runs = known_runs() or sys.exit(__doc__)
    cases, before = known_cases(runs), known_cases(known_runs(BEFORE), BEFORE)
    lines = [HEAD.format(most=MOST_WANTED)]
    for tier in BARS:
        own, was = ([case for case in them if case.tier == tier] for them in (cases, before))
        if own:
            lines += figures(tier, own, was)
    lines += [*by_actuator(cases), *meanings(), *confusions(cases), *curve(cases), *runs_made(runs)]
    lines.append(NOTES.read_text(encoding="utf-8") if NOTES.exists() else "")
    write_whole(PAGE, ("\n".join(lines).rstrip() + "\n").encode())


if __name__ == "__main__":
    main(sys.argv[1:])
