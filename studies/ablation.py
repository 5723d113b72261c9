"""What each rule of the search is worth: withheld cases diagnosed without it.

    python -m studies ablation CASES --out FOLDER             # every rule, resumable
    python -m studies ablation CASES --out FOLDER --only exchange,grids
    python -m studies ablation CASES --out FOLDER --table     # what was found, as Markdown

CASES is a folder that ``python -m studies withheld.generator`` has made.  A rule is taken out
by replacing its function, or by a setting with which it does nothing.  The file
``FOLDER/NAME.jsonl`` has the answers without rule NAME, ``FOLDER/all.jsonl`` those with all rules.

The diagnosis with all rules notes in which cases each of them did something, and a rule is tried
on those alone: on the first ``--limit`` of them.  A rule that is a setting is tried on the first
cases whatever it did.  In the table an answer *differs* in any number.  A case is *lost* where its
answer is right with the rule alone, and *gained* where it is right without it alone, as
``servo_models.withheld.score.good`` says.  Processor seconds are over those with all rules on the
same cases.  Lines are those of the functions that would go.
"""

from __future__ import annotations

import argparse
import inspect
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process a processor is all there is

import numpy as np

from servo_models.diagnosis import diagnose as diagnosis
from servo_models.diagnosis import residual_regression, verdict
from servo_models.diagnosis.search import (
    fitting,
    grid_search,
    joint_fits,
    limit_cycle,
    residuals,
    screening,
    selection,
)
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.identification import resolution
from servo_models.identification.problem import discontinuous
from studies.golden import answered, change, read_rows, truths, withheld

ALL = "all"  # name of the answers with all rules
Search = selection.SubsetSelection


class Rule(NamedTuple):
    """A rule, correction or stage of the search.

    Attributes:
        changes: what takes it out: a module or class, a name in it, what stands there instead.
        parts: functions that would go with it.
        settings: with which it does nothing.
        effects: of the catalogue, which are left out.
        called: it acts wherever it is called; a rule without acts where its result is another than
            that of what stands there instead.
    """

    changes: Sequence[tuple[Any, str, Any]] = ()
    parts: Sequence[Callable[..., Any]] = ()
    settings: Settings = DEFAULT
    effects: Sequence[str] = ()
    called: bool = False


def nothing(*_: Any, **__: Any) -> None:
    """Stand for a function that does something, or finds something."""


def same(_: Any, found: Any, *__: Any) -> Any:
    """Stand for a function that makes its second argument better."""
    return found


RULES = {
    "exchange in every size": Rule(
        [(Search, "exchange_best", nothing)], [Search.exchange_best], called=True
    ),
    "race": Rule([(Search, "to_reach", lambda *_: float("inf"))], [Search.to_reach]),
    "exchange": Rule(
        [(Search, "exchange", lambda search, model, rivals=False: search.exchanged.add(model))],
        [Search.exchange],
        called=True,
    ),
    "wider priors": Rule(
        [(fitting.Fitter, "widened", nothing)],
        [fitting.Fitter.widened, Search.widen],
    ),
    "unsure inputs": Rule(
        [(fitting.Fitter, "with_unsure_inputs", lambda fitter, _: fitter)],
        [fitting.Fitter.with_unsure_inputs, resolution._with_unsure_inputs],
        called=True,
    ),
    "parameters put back": Rule([(fitting.Fitter, "put_back", same)], [fitting.Fitter.put_back]),
    "several bases": Rule(parts=[Search.bases], settings=Settings(bases=1)),
    "grids": Rule(
        [(Search, "search_grids", nothing)],
        [Search.search_grids, *vars(grid_search).values()],
        called=True,
    ),
    "grids beside others": Rule(
        [(Search, "search_grids_beside", nothing)], [Search.search_grids_beside], called=True
    ),
    "screening from nominal": Rule(
        [(selection, "survey", lambda retuned, _, every: screening.survey(retuned, (), every))],
        [screening._at_best],
        called=True,
    ),
    "corrected grids": Rule(
        [(screening, "corrected_changes", screening.changes)],
        [screening.corrected_changes, screening._corrected],
        called=True,
    ),
    "half jumps": Rule(
        [(joint_fits, "_half_jumps", lambda *_: iter(()))], [joint_fits._half_jumps]
    ),
    "thorough starts": Rule(
        [
            (
                joint_fits,
                "best_start",
                lambda result, thorough=True: joint_fits._start(
                    result, result.share or 1.0, thorough=False
                ),
            )
        ],
        [joint_fits.best_start],
    ),
    "delay by samples": Rule([(fitting, "shifted", nothing)], [fitting.shifted, fitting._periods]),
    "past an edge": Rule([(fitting, "past_an_edge", nothing)], [fitting.past_an_edge]),
    "smooth twin": Rule(
        [(fitting, "discontinuous", lambda _: {})],
        [discontinuous, fitting.Fitter._twin],
    ),
    "sharpened": Rule([(fitting, "sharpened", lambda _, vector, *__: vector)], [fitting.sharpened]),
    "bound costs": Rule(
        parts=[vars(fitting.FittedModel)["held_by_bound"].func],
        settings=Settings(entry_share_on_bound=0.0, loss_factor_on_bound=1.0),
    ),
    "shape costs": Rule([(fitting, "shape_cost", lambda _: 0.0)], [fitting.shape_cost]),
    "friction that gives": Rule(effects=["presliding_friction"]),
    "strangeness": Rule([(fitting, "_strangeness", lambda *_: 0.0)], [fitting._strangeness]),
    "trials counted": Rule([(selection, "log", lambda _: 0.0)]),
    "conditions left out": Rule(
        [(selection, "leave_one_condition_out", lambda *_: 0.0)],
        [fitting.leave_one_condition_out, fitting.conditions, Search.carries_over],
    ),
    "entry: blocks agree": Rule(settings=Settings(entry_probability=2.0)),
    "entry: advantage": Rule(settings=Settings(entry_advantage=0.0)),
    "entry: part of the gap": Rule(settings=Settings(entry_gap_share=0.0)),
    "entry: third effect": Rule(settings=Settings(entry_share_of_third=Settings.entry_share)),
    "fits alone: ten": Rule(settings=Settings(fits_alone=5)),
    "fits beside: four": Rule(settings=Settings(fits_beside=2)),
    "fifth effect": Rule(settings=Settings(most_effects=3)),
    "look-alikes once": Rule([(selection, "SAME_COSINE", 2.0)], [selection.same]),
    "errors that follow": Rule([(verdict, "not_followed", lambda *_: [])]),
    "locked to the command": Rule(
        [(verdict, "command_locked", lambda *_: residual_regression.LockedTest(1.0, 0.0, 0.0, ""))],
        [residual_regression.command_locked],
    ),
    "limit cycle": Rule([(verdict, "unrepeatable", lambda *_: 0.0)], [limit_cycle.unrepeatable]),
    "structured part": Rule([(verdict, "lacks", lambda *_: False)], [residuals.unmodelled]),
}


def file_of(out: Path, name: str) -> Path:
    """Where the answers without a rule are."""
    return out / f"{name.replace(' ', '_').replace(':', '')}.jsonl"


def watched(name: str, rule: Rule, instead: Any, what: Any, acting: set[str]) -> Any:
    """A function of a rule that adds the rule's name to ``acting`` where it acts."""

    def run(*given: Any, **named: Any) -> Any:
        found = what(*given, **named)
        if rule.called or not np.array_equal(found, instead(*given, **named)):
            acting.add(name)
        return found

    return run


def with_all(cases: Path, out: Path) -> None:
    """Diagnose every case with all rules, noting which of them act."""
    done = read_rows(out) if out.exists() else {}
    for job in withheld(cases):
        if job.name in done:
            continue
        acting: set[str] = set()
        with ExitStack() as stack:
            for name, rule in RULES.items():
                for place, part, instead in rule.changes:
                    if inspect.isroutine(what := getattr(place, part)):
                        noting = watched(name, rule, instead, what, acting)
                        stack.enter_context(patch.object(place, part, noting))
            row = answered(job)
        add(out, row | {"acting": sorted(acting)})


def without(cases: Path, out: Path, name: str, limit: int) -> None:
    """Diagnose the first cases in which a rule acts without it; those done already stay."""
    rule, path = RULES[name], file_of(out, name)
    done = read_rows(path) if path.exists() else {}
    seen = any(inspect.isroutine(getattr(place, part)) for place, part, _ in rule.changes)
    every = read_rows(file_of(out, ALL))
    acts = {case for case, row in every.items() if name in row["acting"] or not seen}
    first = [job for job in withheld(cases) if job.name in acts][:limit]
    for job in (job for job in first if job.name not in done):
        with ExitStack() as stack:
            told = partial(diagnosis.diagnose, settings=rule.settings, left_out=rule.effects)
            for place, part, instead in (*rule.changes, (diagnosis, "diagnose", told)):
                stack.enter_context(patch.object(place, part, instead))
            row = answered(job)
        add(path, row)


def add(path: Path, row: dict[str, Any]) -> None:
    """Append a row to a file of answers."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def lines_of(rule: Rule) -> int:
    """Lines of the functions that would go."""
    return sum(
        len(inspect.getsource(part).splitlines())
        for part in rule.parts
        if inspect.isfunction(part) and part.__module__.startswith("servo_models.")
    )


def table(cases: Path, out: Path) -> Iterator[str]:
    """Lines of the table, the rules that lose most first."""
    truth, whole = truths(cases), read_rows(out / f"{ALL}.jsonl")
    yield "| without | lines | acts in | tried | differ | lost | gained | processor seconds |"
    yield "|---|---|---|---|---|---|---|---|"
    rows = []
    for name, rule in RULES.items():
        path = file_of(out, name)
        if not path.exists():
            continue
        tried = {case: row for case, row in read_rows(path).items() if case in whole}
        was = {case: whole[case]["answer"] for case in tried}
        now = {case: row["answer"] for case, row in tried.items()}
        changed = [change(truth[case], was[case], now[case]) for case in tried]
        acts = sum(name in row["acting"] for row in whole.values()) or ""
        differ = sum(was[case] != now[case] for case in tried)
        seconds = [sum(rows_[case]["seconds"] for case in tried) for rows_ in (tried, whole)]
        lost, gained = changed.count("lost"), changed.count("gained")
        text = (
            f"| {name} | {lines_of(rule)} | {acts} | {len(tried)} | {differ} | {lost} | {gained} |"
        )
        rows.append((gained - lost, f"{text} {seconds[0] / max(seconds[1], 1e-9):.2f} |"))
    yield from (text for _, text in sorted(rows, key=lambda row: row[0]))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("cases", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", default="", help="rules, with commas between")
    parser.add_argument("--limit", type=int, default=10_000, help="cases for each rule")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    names = given.only.split(",") if given.only else [ALL, *RULES]
    unknown = [name for name in names if name != ALL and name not in RULES]
    if unknown:
        parser.error(f"no rule {', '.join(unknown)}; there are {', '.join(RULES)}")
    given.out.mkdir(parents=True, exist_ok=True)
    for name in names if not given.table else ():
        print(name, file=sys.stderr, flush=True)
        if name == ALL:
            with_all(given.cases, file_of(given.out, ALL))
        else:
            without(given.cases, given.out, name, given.limit)
    for line in table(given.cases, given.out) if given.table else ():
        print(line)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
