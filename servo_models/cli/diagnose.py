"""servo-models diagnose"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from datetime import date
from itertools import count
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servo_models.cli.options import Format, Largest, Trust, check_outputs
from servo_models.errors import UserError

if TYPE_CHECKING:
    from servo_models.data.log import Log
    from servo_models.diagnosis.experiments.experiment import Experiment

GAP_FOUND = 1


def diagnose(
    description: Annotated[
        Path, typer.Argument(help="Description of model and logs, see 'check LOG --init'.")
    ],
    json: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write everything as JSON, commands of next experiments beside it (.csv).",
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a report with pictures (.html), commands beside it as well.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the diagnosed model as a parameter file (.toml)."),
    ] = None,
    format_: Annotated[
        Format, typer.Option("--format", help="How the result is printed.")
    ] = Format.TEXT,
    tolerance: Annotated[
        float | None,
        typer.Option(min=0.0, help="Gap in noise floors that counts as none; default 2."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of intervals and random commands.")] = 0,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Simulations at once; default: all processors.")
    ] = None,
    trust: Trust = False,
    largest: Largest = None,
) -> int:
    """Find out where a model and logs of the real thing differ, and why.

    Nominal parameters are re-tuned inside the uncertainties that the
    description gives; what they leave is explained by effects.  Figures are
    of stretches that no fit has seen.

    Exit code 0: no gap, 1: a gap, 2: could not run.

    Examples:

    servo-models diagnose mine.toml

    servo-models diagnose mine.toml --out PARAMS.toml --json diagnosis.json

    servo-models build --params PARAMS.toml
    """
    from servo_models.cli.console import progress, show
    from servo_models.data.description import read_description
    from servo_models.data.parameters import write_parameters
    from servo_models.diagnosis.confirm import confirm
    from servo_models.diagnosis.diagnose import diagnose as run
    from servo_models.diagnosis.experiments.experiment import next_experiments
    from servo_models.diagnosis.page import diagnosis_page
    from servo_models.diagnosis.search.causes import TOLERANCE
    from servo_models.diagnosis.telling.document import document, github
    from servo_models.diagnosis.telling.parameters import parameter_set
    from servo_models.diagnosis.telling.sheet import diagnosis_sheet
    from servo_models.diagnosis.where import where
    from servo_models.files import write_whole
    from servo_models.report.conditions import conditions
    from servo_models.report.interchange import finite_json

    check_outputs((json, ".json"), (report, ".html"), (out, ".toml"), description=description)
    allowed = TOLERANCE if tolerance is None else tolerance
    if not isfinite(allowed):
        raise UserError(f"--tolerance {allowed}: give a number of noise floors, such as 2")
    with progress("diagnosing") as bar:
        rig = read_description(description, trust)
        found = run(rig, allowed, seed, jobs, tell=lambda it: bar(0, None, it))
        bar(0, None, "running the FMU with the diagnosed parameters")
        try:
            confirmed = confirm(found)
            found = replace(found, unconfirmed=confirmed.doubt)
        except UserError as error:  # no FMUs on this platform; what took minutes is told
            why = (
                f"cannot be run here: all figures are those of the simulation without one ({error})"
            )
            confirmed, found = None, replace(found, unconfirmed=why)
        bar(0, None, "looking for the next experiment")
        next_ = next_experiments(found.undecided, seed)
    places, versions, today = where(found.causes), conditions(), date.today()
    folders = {file.parent for file in (json, report) if file}
    if folders:
        next_ = _with_tables(next_, description.stem, found.logs, folders)
    told = finite_json(document(found, confirmed, places, next_, seed, versions))
    texts = {json: f"{told}\n"} if json else {}
    if report:
        texts[report] = diagnosis_page(
            description.stem,
            found,
            places,
            next_,
            confirmed,
            conditions=versions,
            date=today.isoformat(),
        )
    for folder in folders:
        for experiment in next_:
            experiment.write(folder)
    for file, text in texts.items():
        write_whole(file, text.encode())
    if out:
        write_parameters(parameter_set(found, today), out)
    if format_ is Format.JSON:
        print(told)
    elif format_ is Format.GITHUB:
        print("\n".join(github(found, next_)))
    else:
        show(diagnosis_sheet(found, confirmed, places, next_))
    return 0 if found.within_tolerance else GAP_FOUND


def _with_tables(
    experiments: Iterable[Experiment], stem: str, logs: Iterable[Log], folders: Iterable[Path]
) -> tuple[Experiment, ...]:
    """Name a table for each experiment.  An earlier one that was played and filled stays: it is
    a log by now, or holds more than a command."""
    from servo_models.diagnosis.experiments.experiment import is_filled

    taken, places = {log.path.name for log in logs}, tuple(folders)
    names = (f"{stem}_next_{k}.csv" for k in count(1))
    free = (
        name
        for name in names
        if name not in taken and not any(is_filled(folder / name) for folder in places)
    )
    return tuple(replace(one, file=name) for one, name in zip(experiments, free))
