"""servo-models compare"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import Json, Report, Trust, check_outputs, write_result


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
    report: Report = None,
    json: Json = None,
    trust: Trust = False,
) -> None:
    """Compare diagnoses and parameter sets on the same logs.

    It tells the errors that each leaves and the values in which they differ; what
    has changed since a file was written is said, and which are of different logs.

    Examples:

    servo-models compare monday.json friday.json --report change.html

    servo-models compare fitted.toml --on mine.toml
    """
    from servo_models.cli.console import progress, show
    from servo_models.diagnosis.comparison.compare import compare as run

    check_outputs((report, ".html"), (json, ".json"), description=on)
    with progress("comparing"):
        result = run(files, on, trust)
    write_result(result, json=json, report=report)
    show(result.report())
