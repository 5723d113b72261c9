"""servo-models compare"""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import Trust, check_outputs


def compare(
    files: Annotated[
        list[Path],
        typer.Argument(help="Diagnoses (.json) and parameter files (.toml).", metavar="FILE..."),
    ],
    on: Annotated[
        Path | None,
        typer.Option(
            metavar="DESCRIPTION",
            help="The logs; default: the description that a diagnosis names, beside its file.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page with a panel (.html).")
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write values and errors in SI (.json).")
    ] = None,
    trust: Trust = False,
) -> None:
    """Compare diagnoses and parameter sets on the same logs.

    It tells the errors that each leaves and the values in which they differ; what
    has changed since a file was written is said.

    Examples:

    servo-models compare monday.json friday.json --report change.html

    servo-models compare fitted.toml --on mine.toml
    """
    from servo_models.cli.console import progress, show
    from servo_models.diagnosis.comparison.compare import compare as run
    from servo_models.files import write_whole

    check_outputs((report, ".html"), (json, ".json"), description=on)
    with progress("comparing"):
        found = run(files, on, trust)
    if report:
        found.write_report(report, date.today().isoformat())
    if json:
        write_whole(json, f"{found.to_json()}\n".encode())
    show(found.report())
