"""servo-models compare"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import check_outputs, write_result


def compare(
    files: list[Path],
    on: Path | None = None,
    report: Path | None = None,
    json: Path | None = None,
    trust: bool = False,
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
