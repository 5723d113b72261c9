"""A zoo of diagnosed servos: what each real log says, as files that a simulator takes.

For each set of ``examples/real_logs/diagnosis`` it writes a page with the verdict, the parameters
with their standard errors and the files of simulators; for sets whose licence allows it also the
curves, and a page in which the model runs beside them.

Run: ``SERVO_MODELS_DATA=LOGS python -m studies zoo --out FOLDER [--quick] [CASE ...]``
(an hour and a quarter; some minutes with ``--quick``).  What is in FOLDER and was made of the same
description, logs and options is not made again.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
from dataclasses import dataclass
from pathlib import Path

from servo_models.data.audit import audits, noise_floors
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.data.parameters import ParameterSet, read_parameters, write_parameters
from servo_models.data.schema import named_files
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.sections import pictures, tables
from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.identification.live import live_logs
from servo_models.identification.starts import with_starts
from servo_models.report.html import page
from servo_models.report.live import Live
from servo_models.report.result import Report
from servo_models.report.sections import Section
from servo_models.report.style import colour, figure
from servo_models.simulators.export import export
from studies.known_logs import CASES, REAL, Case
from studies.real_logs import parameters, placed, table

FILES = {
    "mujoco": "mujoco.xml",
    "isaaclab": "isaaclab.py.txt",
    "jsbsim": "jsbsim.xml",
    "ardupilot": "ardupilot.parm",
}
"""File of each simulator; a part of a Python file is no Python file."""
PARAMETERS, CURVES, LIVE, PAGE = "parameters.toml", "curves.svg", "live.html", "README.md"
STOPPED = "stopped"  # first word of the warning of a search that has not tried everything
ROWS = 700  # most rows of a curve in a live page
LONGEST_S = 0.04  # longest time between them, where the log has shorter ones
KEPT_ONE_OF = 2  # rows of a log of which at most one is in a live page
LOGS = 4  # most logs in a live page


@dataclass(frozen=True)
class Terms:
    """Under which terms curves of a set are shown, and whose they are."""

    licence: str
    source: str


SO101 = Terms("Apache-2.0", "two joints of an SO-101 arm, see examples/real_logs")
XL330 = Terms("Apache-2.0", "Duclusaud et al., Extended friction models, github.com/Rhoban/bam")
ODRIVE = Terms("MIT", "copyright (c) 2016-2018 ODrive Robotics")
SHARED = {
    "so101_wrist_roll": SO101,
    "so101_rotation": SO101,
    "xl330": XL330,
    "odrive_nocomp": ODRIVE,
    "odrive_comp": ODRIVE,
}
"""Sets whose curves may be shown; of the others there are figures only."""


def real() -> dict[str, Case]:
    """Cases of measured logs, by name."""
    return {name: case for name, case in CASES.items() if REAL in case.file.parents}


def digest(case: Case, description: Path, quick: bool) -> str:
    """What an entry is made of: its description, logs and options."""
    logs = sorted({*named_files(description)} - {description})
    parts = [case.file.read_bytes(), *(log.read_bytes() for log in logs)]
    sizes = f"{quick}, {case.tolerance}".encode()
    return hashlib.sha256(
        b"".join(hashlib.sha256(it).digest() for it in (*parts, sizes))
    ).hexdigest()


def simulators(folder: Path) -> list[str]:
    """Write the files of simulators, and tell what each keeps."""
    rows = []
    try:
        for name, file in FILES.items():
            made = export(folder / PARAMETERS, name)
            write_whole(folder / file, made.lines.encode())
            rows.append((f"[{made.simulator.title}]({file})", made.report().sentence))
    except UserError:  # it follows no goal angle
        return [
            "",
            "Simulators take servos that follow a goal angle, so there are no lines: build the"
            " FMU.",
            "",
        ]
    return [
        "",
        "Fitted to steps and a sweep of the diagnosed model; `servo-models export"
        f" {PARAMETERS} --to mujoco --log YOURS.toml` fits them to your commands.",
        *table(("file", "what it keeps"), rows),
    ]


def curves(found: Diagnosis, path: Path) -> None:
    """Draw the response that is missed most."""
    picture = pictures.responses(found)[0]
    figure(picture).savefig(path, facecolor=colour("paper"), metadata={"Date": None})


def thinned(log: Log) -> Log:
    """A log with few of its rows: what a reader sees of a curve, and nobody's raw data."""
    wanted, most = -(-len(log.times) // ROWS), int(LONGEST_S / log.interval)
    every = max(KEPT_ONE_OF, min(wanted, most))
    return log.at(slice(0, every * ROWS, every))


def lively(described: Description, told: ParameterSet, terms: Terms) -> Report:
    """A page in which the model runs beside some of the logs, thinned."""
    chosen, every = described.model, described.logs
    logs = [thinned(log) for log in sorted(every, key=lambda it: not it.held_out.any())[:LOGS]]
    fitted = [it for it in told.estimates if it.origin == "diagnosed"]
    models = live_logs(
        chosen,
        with_starts(chosen, logs),
        {"diagnosed": told.model().values},
        {it.name: it.standard_error for it in fitted if it.standard_error},
        {it.name for it in fitted},
        noise_floors(audits(every, chosen.plant)),
    )
    panel = Live(
        "Measured and simulated",
        "Move a parameter or switch an effect: the model runs in this page.",
        models,
    )
    first = [f"{it[:1].upper()}{it[1:]}." for it in told.warnings if it.startswith(STOPPED)]
    return Report(
        described.path.stem,
        told.method.removeprefix("diagnosis, "),
        remarks=(
            f"Measured curves: {terms.source}; licence {terms.licence}. They are thinned: at most"
            f" every {KEPT_ONE_OF}nd row, and {ROWS} rows from the beginning, of {len(logs)} of"
            f" {len(every)} logs. So errors differ a little from those of the diagnosis, which saw"
            " every row.",
            *first,
        ),
        sections=(Section("", live=panel),),
    )


def entry(name: str, case: Case, told: Description, found: Diagnosis, folder: Path) -> list[str]:
    """Write the files of a set, and return its page."""
    values = found.parameter_set()
    write_parameters(values, folder / PARAMETERS)
    lines = [f"# {case.title}", "", f"**{found.verdict.kind}**: {summary.sentence(found)}", ""]
    if terms := SHARED.get(name):
        curves(found, folder / CURVES)
        write_whole(folder / LIVE, page(lively(told, values, terms)).encode())
        drawn = "Dashed: the nominal model; solid: the diagnosed one; broad: measured"
        lines += [
            f"![{drawn}]({CURVES})",
            "",
            f"{drawn}. [Move it]({LIVE}): thinned curves; {terms.source}, {terms.licence}.",
            "",
        ]
    else:
        lines += ["The terms of these logs are not stated, so there are figures and no curves.", ""]
    gap = tables.gap(found)
    lines += ["## Errors", "", "RMS, with 95 % intervals, on blocks that a fit left out."]
    lines += table(gap.headings, gap.texts)
    lines += ["## Parameters", "", f"Those that were fitted; [{PARAMETERS}]({PARAMETERS}) has all."]
    lines += parameters(found)
    lines += [
        "## Simulators",
        "",
        f"All of it is in the FMU: `servo-models build --params {PARAMETERS}`.",
    ]
    lines += simulators(folder)
    lines += ["## Before you use it", ""]
    lines += [f"- {text[:1].upper()}{text[1:]}." for text in summary.warnings(found)]
    lines += [f"- Known of this set: {case.known.replace('](', '](../../studies/')}"]
    return [*lines, ""]


def index(folder: Path) -> list[str]:
    """The page that lists the entries there are."""
    rows = []
    for name, case in real().items():
        place = folder / name
        if not (place / PAGE).exists():
            continue
        told = read_parameters(place / PARAMETERS)
        first = any(text.startswith(STOPPED) for text in told.warnings)
        files = [PARAMETERS, *(it for it in FILES.values() if (place / it).exists())]
        shown = (
            f"[page]({name}/{LIVE}), {SHARED[name].licence}" if name in SHARED else "figures only"
        )
        rows.append(
            (
                f"[{case.title}]({name}/{PAGE})",
                f"{told.actuator}, {told.variant}",
                told.method.removeprefix("diagnosis, "),
                "first answer" if first else "whole",
                ", ".join(f"[{it}]({name}/{it})" for it in files),
                shown,
            )
        )
    return [
        "# A zoo of diagnosed servos",
        "",
        "Do you have one of these? Take its parameters or its lines for your simulator. Made by"
        " `python -m studies zoo --out docs/zoo`; the measured logs are"
        " [public sets](../../examples/real_logs), and not in this repository.",
        "",
        *table(("set", "model", "verdict, and what it took", "search", "files", "curves"), rows),
        "`outside-catalogue` says that something is left that no effect of the catalogue explains:"
        " the model is the nearest, not the truth. Standard errors count noise, and not what the"
        " model lacks. A search that ended at its first answer (`--quick`) tried effects one at a"
        " time only: [whole ones](../studies/real_logs.md) may take more effects, and leave less.",
        "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    parser.add_argument("--quick", action="store_true", help="end searches at the first answer")
    parser.add_argument("cases", nargs="*", metavar="CASE", help="default: all")
    options = parser.parse_args()
    cases = real()
    for name in {*options.cases} - {*cases}:
        parser.error(f"no case '{name}': there are {', '.join(cases)}")
    for name in options.cases or cases:
        case, folder = cases[name], options.out / name
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as made:
            description = placed(case, Path(made))
            mark = f"<!-- {digest(case, description, options.quick)} -->"
            kept = folder / PAGE
            if kept.exists() and kept.read_text("utf-8").rstrip().endswith(mark):
                print(f"{name}: is there", flush=True)
                continue
            told = read_description(description)
            found = diagnose(told, case.tolerance, fmu=True, quick=options.quick)
            lines = entry(name, case, told, found, folder)
        write_whole(kept, "\n".join([*lines, mark, ""]).encode())  # last: so it is whole
        print(f"{name}: {summary.sentence(found)}", flush=True)
    write_whole(options.out / PAGE, "\n".join(index(options.out)).encode())


if __name__ == "__main__":
    main()
