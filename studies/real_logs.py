"""What the diagnosis says of real actuators and of the papers' own gap, against what is known.

Each case begins with the simple model of its description: those of measured logs are in
``examples/real_logs/diagnosis``, those of the papers in ``examples/papers_gap``; ``known_logs`` has
what is known of them.

Run: ``SERVO_MODELS_DATA=LOGS python -m studies real_logs [--folder DONE] [CASE ...]``
(half an hour).  LOGS is the folder of the measured logs, which are no part of the repository;
default: ``logs`` beside the descriptions.  It prints the page; without CASE it writes
``docs/studies/real_logs.md`` as well.  With DONE, sections are kept there, and those that are there
are not made again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.data.audit import LEAST_GAP
from servo_models.data.description import read_description
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.files import write_whole
from studies.known_logs import CASES, MEAN_ABSOLUTE, PAPERS, REAL, ROOT, Bar, Case

PAGE = ROOT / "docs" / "studies" / "real_logs.md"


def folder_of_logs() -> Path:
    return Path(os.environ.get("SERVO_MODELS_DATA", REAL / "logs")).resolve()


@dataclass(frozen=True)
class Told:
    """All that ``servo-models diagnose`` works out, and how long that took [s]."""

    found: Diagnosis
    seconds: float
    usual: Diagnosis
    """With the usual tolerance."""


def placed(case: Case, folder: Path) -> Path:
    """Write a case's description into a folder, with its logs where they are; return its path."""
    text = case.file.read_text(encoding="utf-8")
    if case.file.parent == PAPERS:
        subprocess.run([sys.executable, PAPERS / "make_logs.py", folder], check=True)
    path = folder / case.file.name
    path.write_text(text.replace('"../logs/', f'"{folder_of_logs().as_posix()}/'))
    return path


def diagnosed(case: Case) -> Told:
    """Diagnose a case, its logs taken from their folder."""
    with tempfile.TemporaryDirectory() as made:
        told = read_description(placed(case, Path(made)))
    begin = time.perf_counter()
    found = diagnose(told, case.tolerance, fmu=True)
    found.document()
    seconds = time.perf_counter() - begin
    usual = found if case.tolerance == LEAST_GAP else diagnose(told)
    return Told(found, seconds, usual)


def named(found: Diagnosis) -> tuple[str, ...]:
    """Effects that are taken, or in the set with those."""
    return tuple(dict.fromkeys((*found.selection.taken.effects, *found.verdict.members)))


def faults(case: Case, found: Diagnosis) -> Iterator[str]:
    """Where a diagnosis is not what is known."""
    names = named(found)
    if found.verdict.kind == NO_GAP:
        yield "finds no gap"
    for group in case.named:
        if not group & set(names):
            yield f"does not name {' or '.join(sorted(group))}"
    for name in sorted(case.absent & set(names)):
        yield f"names {name}, which these logs cannot show"
    known = frozenset().union(*case.named, case.absent, case.possible)
    for name in names:
        if name not in known:
            yield f"names {name}, of which nothing is known"


def held_out(found: Diagnosis, one: FittedModel, bar: Bar) -> float:
    """Error of an explanation on samples that no fit of the diagnosis has seen, in its unit."""
    errors = []
    for log, response in zip(found.logs, one.problem.responses(one.evidence.vector)):
        if bar.output in log.outputs:
            errors.append((response[bar.output] - log.outputs[bar.output])[log.checked])
    every = np.abs(np.concatenate(errors)) / bar.scale
    return float(np.mean(every) if bar.measure == MEAN_ABSOLUTE else np.sqrt(np.mean(every**2)))


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    head = [f"| {' | '.join(columns)} |", f"{'|---' * len(columns)}|"]
    return ["", *head, *(f"| {' | '.join(row)} |" for row in rows), ""]


def bars(case: Case, found: Diagnosis) -> list[str]:
    """Held-out errors against their bars."""
    rows = [
        (
            f"{bar.output}, {bar.measure} [{bar.unit}]",
            f"{held_out(found, found.selection.retuned, bar):.3g}",
            f"{held_out(found, found.selection.taken, bar):.3g}",
            f"{bar.limit:g}",
            "met" if held_out(found, found.selection.taken, bar) <= bar.limit else "missed",
        )
        for bar in case.bars
    ]
    return table(("held out", "parameters alone", "with effects", "bar", ""), rows) if rows else []


def parameters(found: Diagnosis) -> list[str]:
    known, doubts = found.model.plant.parameters, summary.doubts(found)
    rows = [
        (
            f"`{one.name}`",
            f"{one.nominal:.4g}",
            f"{one.value:.4g}",
            f"{one.standard_error:.2g}" if np.isfinite(one.standard_error) else "",
            known[one.name].param.unit,
            doubts.get(one.name, ""),
        )
        for one in found.found
    ]
    return table(("parameter", "nominal", "found", "standard error", "unit", ""), rows)


def effects(found: Diagnosis) -> list[str]:
    rows = [
        (
            f"`{one.name}`",
            "" if one.probability is None else f"{one.probability:.2f}",
            f"{one.gap_after:.3g}",
            "taken" if one.taken else "in the set" if one.in_set else "",
        )
        for one in found.ranking
    ]
    before = f"noise floors left, of {found.selection.before.rms:.3g}"
    return table(("effect", "probability", before, ""), rows) if rows else []


def motions(found: Diagnosis) -> list[str]:
    """How far each effect that is taken moves the outputs, on all samples."""
    taken, plant = found.selection.taken, found.model.plant
    rows = []
    for name in taken.effects:
        switches = {it.name for it in plant.parameters.values() if it.owner == name}
        off = {it: 0.0 for it in switches if plant.parameters[it].param.switch}
        for output in found.floors:
            runs = [run for run in taken.problem.runs if output in run.log.outputs]
            column = [list(run.log.outputs).index(output) for run in runs]
            apart = [
                (run.outputs(taken.values) - run.outputs({**taken.values, **off}))[:, k]
                for run, k in zip(runs, column)
            ]
            scale, unit = display(plant.wire[output])
            size = scale * np.sqrt(np.mean(np.concatenate(apart) ** 2))
            rows.append((f"`{name}`", output, f"{size:.3g} {unit}"))
    return table(("effect", "moves", "by, RMS"), rows) if rows else []


def learnt(found: Diagnosis) -> list[str]:
    """The residual map, and what it leaves of the samples that the description holds out."""
    one = found.residual_map
    if one is None:
        return []
    sizes = [
        f"{np.sqrt(np.mean(squares)):.3g}"
        for model in (found.selection.taken, one.fitted)
        for logs in [model.problem.held_out_squares(model.values)]
        if len(squares := np.concatenate([it.ravel() for it in logs]))
    ]
    held = f"; held out by the description: {' -> '.join(sizes)}" if sizes else ""
    return [
        "",
        f"**Learnt:** {one.sentence}: {one.before:.3g} -> {one.after:.3g} noise floors on blocks"
        f" that the fit has not seen{held}.",
    ]


def places(told: Told) -> list[str]:
    """Where the error lies, and motions held out and regimes that the model makes worse."""
    breakdowns = told.found.localisation
    lines = [f"- Along {one.dimension}: {one.sentence}" for one in breakdowns if len(one.bins) > 1]
    lines += [
        f"- Worse than by parameters alone, held out of log '{one.log}': {one.retuned:.3g} ->"
        f" {one.after:.3g} noise floors."
        for one in told.found.held_out
        if one.worse
    ]
    lines += [
        f"- Worse than by the nominal model at {one.dimension} {each.label}:"
        f" {each.rms_before:.3g} -> {each.rms_after:.3g} noise floors."
        for one in breakdowns
        for each in one.bins
        if each.worse
    ]
    return ["", *lines] if lines else []


def _usual(found: Diagnosis) -> Iterator[str]:
    yield f"With the usual tolerance it claims `{found.verdict.kind}`: {summary.sentence(found)}"


def section(case: Case, told: Told) -> list[str]:
    found = told.found
    wrong = list(faults(case, found))
    asked = "" if case.tolerance == LEAST_GAP else f", `--tolerance {case.tolerance:g}`"
    return [
        f"## {case.title}",
        "",
        f"**Claimed** (`{found.verdict.kind}`, {told.seconds:.0f} s{asked}):"
        f" {summary.sentence(found)}",
        "",
        *([f"**Before:** {case.before}.", ""] if case.before else []),
        f"**Known:** {case.known}",
        "",
        f"**Wrong:** {'; '.join(wrong) if wrong else 'nothing'}.",
        *(f"\n*Warning:* {text}." for text in summary.warnings(found)),
        *([] if told.usual is found else ["", *_usual(told.usual)]),
        *(["", f"*Looked into by hand:* {case.remark}"] if case.remark else []),
        *learnt(found),
        *bars(case, found),
        *effects(found),
        *motions(found),
        *parameters(found),
        *places(told),
        *(f"\n*Next experiment:* {one.text}" for one in told.found.next_experiments),
        "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("cases", nargs="*", metavar="CASE")
    options = parser.parse_args()
    for name in {*options.cases} - {*CASES}:
        parser.error(f"no case '{name}': there are {', '.join(CASES)}")
    page = [
        "# Real logs and the papers' own gap, diagnosed",
        "",
        "Made by `python -m studies real_logs`; the measured logs are not in this"
        " repository. Each diagnosis begins with a simple model. *Held out* are samples that no"
        " fit has seen (noise floors and codes are taken from whole logs). *Before* is the"
        " diagnosis of commit cae452d, in noise floors on blocks. *Wrong* compares the"
        " effects named, those in the set included, with those that were known; values are not"
        " compared. The table of effects has for each"
        " one its probability, and the error that is left with the best explanation that has it,"
        " on blocks of the fitted samples that its fit has not seen; it may exceed the gap at the"
        " start. A probability also counts what a fit spends, and how far blocks differ. The"
        " seconds are those of all that the command does, but for reading the logs and drawing its"
        " report.",
        "",
    ]
    for name in options.cases or CASES:
        kept = options.folder / f"{name}.md" if options.folder else None
        if kept and kept.exists():
            part = kept.read_text(encoding="utf-8")
        else:
            part = "\n".join(section(CASES[name], diagnosed(CASES[name]))) + "\n"
            if kept:
                write_whole(kept, part.encode())
        page.append(part)
        print(part, flush=True)
    if not options.cases:
        write_whole(PAGE, "\n".join(page).replace("\n\n\n", "\n\n").encode())


if __name__ == "__main__":
    main()
