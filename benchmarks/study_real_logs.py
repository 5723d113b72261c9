"""What the diagnosis says of real actuators and of the papers' own gap, against what is known.

Each case begins with the simple model of its description: those of measured logs are in
``examples/real_logs/diagnosis``, those of the papers in ``examples/papers_gap``.  What a log
is known to show comes from its authors, or from fits that the diagnosis has no part in.

Run: ``SERVO_MODELS_DATA=LOGS python benchmarks/study_real_logs.py [CASE ...]`` (ten to twenty
minutes).  LOGS is the folder of the measured logs, which are no part of the repository; default:
``logs`` beside the descriptions.  It prints the page; without CASE it writes
``docs/studies/real_logs.md`` as well.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from servo_models.description import read_description
from servo_models.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.experiments.experiment import next_experiments
from servo_models.diagnosis.fitting.explanation import Explanation
from servo_models.diagnosis.telling import words
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.diagnosis.where import where
from servo_models.files import write_whole

Array = NDArray[np.float64]

ROOT = Path(__file__).parent.parent
REAL = ROOT / "examples" / "real_logs"
PAPERS = ROOT / "examples" / "papers_gap"
PAGE = ROOT / "docs" / "studies" / "real_logs.md"
MEAN_ABSOLUTE, RMS = "mean absolute", "RMS"
COUNT = np.radians(7.75)
"""Rate [rad/s] that the description of the SG90 takes for a count of its gyro."""


@dataclass(frozen=True)
class Bar:
    """A held-out error to reach: of an output, in ``unit`` of size ``scale`` [SI]."""

    output: str
    limit: float
    unit: str
    scale: float
    measure: str = RMS


@dataclass(frozen=True)
class Case:
    """A log, and what is known of it.

    Attributes:
        file: of the description.
        known: in words, with its origin.
        named: of each group an effect has to be named.
        absent: effects that must not be named.
        possible: known effects that a log need not show.
        bars: held-out errors to reach.
    """

    title: str
    file: Path
    known: str
    named: tuple[frozenset[str], ...] = ()
    absent: frozenset[str] = frozenset()
    possible: frozenset[str] = frozenset()
    bars: tuple[Bar, ...] = ()


def one_of(*names: str) -> frozenset[str]:
    return frozenset(names)


def joint(name: str, limit: float) -> Case:
    """A joint of the SO-101 arm."""
    return Case(
        f"SO-101, {name.replace('_', ' ')}",
        REAL / "diagnosis" / f"so101_{name}.toml",
        "A dead zone of the error and Coulomb friction explain these motions alike, so both"
        " belong in the set; neither explains the motions of ±0.04 rad.",
        (one_of("error_dead_zone"), one_of("coulomb_friction")),
        bars=(Bar("angle_reading", limit, "mrad", 1e-3),),
    )


CASES = {
    "emps": Case(
        "EMPS: a linear drive in its position loop",
        REAL / "diagnosis" / "emps.toml",
        "Its authors give Coulomb friction of 20.4 N and an offset of -3.16 N; friction that"
        " falls with speed has not been shown, a fit of it comes out with the wrong sign.",
        (one_of("coulomb_friction"),),
        one_of("stribeck_friction"),
        bars=(Bar("position", 3.7, "um", 1e-6), Bar("drive", 0.15, "V", 1.0)),
    ),
    "sg90_steps": Case(
        "SG90: steps read by a gyro",
        REAL / "diagnosis" / "sg90_steps.toml",
        "[Fits of their own](sg90_measured.md) say drive saturation, a delay and the frame, of"
        " 20.002 ms by all 52 steps; the half that is fitted, 8 s apart, cannot tell a period from"
        " its aliases. Steps as large as these cannot show a dead zone or Coulomb friction.",
        (one_of("supply_limit", "drive_saturation"), one_of("transport_delay")),
        one_of("drive_dead_zone", "dead_band", "coulomb_friction"),
        one_of("sample_hold"),
        (Bar("rate_reading", 4.5, "counts", COUNT),),
    ),
    "sg90_video": Case(
        "SG90, filmed: what the variant `measured` misses of another unit",
        REAL / "diagnosis" / "sg90_video.toml",
        "[The film](sg90_measured.md) swings by 180 degrees with 0.1 and 0.8 degrees of overshoot;"
        " the variant overshoots by 5.8. Why is not known, and the clock of the commands is late.",
    ),
    "so101_wrist_roll": joint("wrist_roll", 5.0),
    "so101_rotation": joint("rotation", 4.7),
    "xl330": Case(
        "XL330: a smart servo with a pendulum",
        REAL / "diagnosis" / "xl330.toml",
        "Duclusaud et al. found friction that grows with the load; Coulomb friction alone gains"
        " nothing on the gain held out. No model in reach gets below 20 steps of the encoder.",
        (one_of("load_friction"),),
        bars=(Bar("angle_reading", 34.0, "mrad", 1e-3, MEAN_ABSOLUTE),),
    ),
    "torque_motor": Case(
        "The valve paper: Table 1 as the simulation, eq. 12 as the plant",
        PAPERS / "torque_motor.toml",
        "A transport delay of 1.1 ms is all that the model lacks; K_t is 19 % and L 12 % lower"
        " than measured one by one.",
        (one_of("transport_delay"),),
    ),
    "sg90": Case(
        "The servo paper: linear eq. 7 as the simulation, the printed nonlinear servo as the plant",
        PAPERS / "sg90.toml",
        "Left out of the plant one at a time, the dead zone changes this angle by 328 noise"
        " levels, the asymmetry of its edges by 54, the levels of the command by 19, the top speed"
        " by 7 and the frame by 0, since the log's rows fall on the frames: it can show all but"
        " the frame.",
        (
            one_of("drive_dead_zone"),
            one_of("direction_asymmetry"),
            one_of("command_quantisation"),
            one_of("drive_saturation", "supply_limit"),
        ),
    ),
}


def folder_of_logs() -> Path:
    return Path(os.environ.get("SERVO_MODELS_DATA", REAL / "logs")).resolve()


def diagnosed(case: Case) -> tuple[Diagnosis, float]:
    """Diagnose a case, its logs taken from their folder; also how long it took [s]."""
    text = case.file.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        if case.file.parent == PAPERS:
            subprocess.run([sys.executable, PAPERS / "make_logs.py", folder], check=True)
        path = folder / case.file.name
        path.write_text(text.replace('"../logs/', f'"{folder_of_logs().as_posix()}/'))
        told = read_description(path)
    begin = time.perf_counter()
    found = diagnose(told)
    return found, time.perf_counter() - begin


def named(found: Diagnosis) -> tuple[str, ...]:
    """Effects that are taken, or in the set with those."""
    return tuple(dict.fromkeys((*found.causes.taken.effects, *found.verdict.members)))


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


def held_out(found: Diagnosis, one: Explanation, bar: Bar) -> float:
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
            f"{held_out(found, found.causes.retuned, bar):.3g}",
            f"{held_out(found, found.causes.taken, bar):.3g}",
            f"{bar.limit:g}",
            "met" if held_out(found, found.causes.taken, bar) <= bar.limit else "missed",
        )
        for bar in case.bars
    ]
    return table(("held out", "parameters alone", "with effects", "bar", ""), rows) if rows else []


def parameters(found: Diagnosis) -> list[str]:
    known, doubts = found.model.plant.parameters, words.doubts(found)
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
            f"{one.probability:.2f}",
            f"{one.gap_after:.3g}",
            "taken" if one.taken else "in the set" if one.in_set else "",
        )
        for one in found.claims
    ]
    before = f"noise floors left, of {found.causes.before.rms:.3g}"
    return table(("effect", "probability", before, ""), rows) if rows else []


def places(found: Diagnosis) -> list[str]:
    """Where the error lies, and motions held out and regimes that the model makes worse."""
    breakdowns = where(found.causes)
    lines = [f"- Along {one.dimension}: {one.sentence}" for one in breakdowns if len(one.bins) > 1]
    lines += [
        f"- Worse than by parameters alone, held out of log '{one.log}': {one.retuned:.3g} ->"
        f" {one.after:.3g} noise floors."
        for one in found.held_out
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


def section(case: Case, found: Diagnosis, seconds: float) -> list[str]:
    wrong = list(faults(case, found))
    return [
        f"## {case.title}",
        "",
        f"**Claimed** (`{found.verdict.kind}`, {seconds:.0f} s): {words.sentence(found)}",
        "",
        f"**Known:** {case.known}",
        "",
        f"**Wrong:** {'; '.join(wrong) if wrong else 'nothing'}.",
        *bars(case, found),
        *effects(found),
        *parameters(found),
        *places(found),
        *(f"\n*Next experiment:* {one.text}" for one in next_experiments(found.verdict)),
        "",
    ]


def main(chosen: Sequence[str]) -> None:
    page = [
        "# Real logs and the papers' own gap, diagnosed",
        "",
        "Made by `python benchmarks/study_real_logs.py`; the measured logs are not in this"
        " repository. Each diagnosis begins with a simple model. *Held out* are samples that no"
        " fit has seen (noise floors and codes are taken from whole logs). *Wrong* compares the"
        " effects named, those in the set included, with those that were known; values are not"
        " compared. The table of effects has for each"
        " one its probability, and the error that is left with the best explanation that has it,"
        " on blocks of the fitted samples that its fit has not seen; it may exceed the gap at the"
        " start. A probability also counts what a fit spends, and how far blocks differ.",
        "",
    ]
    for name in chosen or CASES:
        case = CASES[name]
        page += (part := section(case, *diagnosed(case)))
        print("\n".join(part), flush=True)
    if not chosen:
        write_whole(PAGE, "\n".join(page).replace("\n\n\n", "\n\n").encode())


if __name__ == "__main__":
    main(sys.argv[1:])
