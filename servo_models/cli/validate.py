"""servo-models validate"""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Annotated, Any

import typer

from servo_models.cli.options import Format, Trust
from servo_models.errors import UserError
from servo_models.validation.host_process import LIMITS, Limits


def validate(
    fmus: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FMU]...", help="FMUs to validate; default: all actuators."),
    ] = None,
    params: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Parameter file, .toml: validate its FMU as well."),
    ] = None,
    trust: Trust = False,
    actuator: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Python file of your own actuator, for its FMU files."),
    ] = None,
    timeout: Annotated[
        float,
        typer.Option(metavar="SECONDS", min=0.1, help="Longest run of an FMU for one case."),
    ] = LIMITS.seconds,
    memory: Annotated[
        float, typer.Option(metavar="MB", min=64.0, help="Most memory of an FMU's process.")
    ] = LIMITS.megabytes,
    unpacked: Annotated[
        float, typer.Option(metavar="MB", min=1.0, help="Most that an FMU may unpack to.")
    ] = LIMITS.unpacked_megabytes,
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the result as JUnit XML.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a report with pictures, HTML.")
    ] = None,
    format_: Annotated[
        Format, typer.Option("--format", help="How the result is printed.")
    ] = Format.TEXT,
    every: Annotated[
        bool, typer.Option("--all", help="Print every figure, not one a case.")
    ] = False,
    brief: Annotated[
        bool,
        typer.Option(
            "--brief", help="Print the verdict and what failed; name each job as it begins."
        ),
    ] = False,
) -> int:
    """Validate FMUs against the simulation, the models against references.

    The code of an FMU runs in a process of its own, with these limits; that guards against
    its faults, not against malice.

    Exit code 0: within all limits, 1: not, 2: could not run.

    Examples:

    servo-models validate

    servo-models validate fmus/sg90.fmu --report report.html --junit junit.xml
    """
    from servo_models.cli.console import NARROW, progress, show
    from servo_models.core.catalogue import actuator as find_actuator
    from servo_models.data.parameters import read_parameters
    from servo_models.files import check_writable
    from servo_models.validation import formats, sections
    from servo_models.validation.runner import validate as run

    for file in (junit, report):
        if file:
            check_writable(file)
    if actuator and not fmus:
        raise UserError("--actuator tells of what FMU files are: name them as well")
    subjects: list[Any] = [*(fmus or ())]
    if params:
        subjects.append(read_parameters(params, trust).model())
    own = find_actuator(str(actuator)) if actuator else None
    limits = Limits(timeout, memory, unpacked)
    with progress("validating", lines=brief) as on_progress:
        try:
            result = run(subjects or None, on_progress=on_progress, own=own, limits=limits)
        except UserError as error:
            if own or "unknown actuator" not in str(error):
                raise
            raise UserError(f"{error}; or name the file of your own with --actuator") from error
    if junit:
        formats.write_junit(result, junit)
    if report:
        result.write_report(report, date.today().isoformat())
    if format_ is Format.JSON:
        print(result.to_json())
    elif format_ is Format.GITHUB:
        print("\n".join(formats.github(result)))
    elif brief:
        show(sections.summary(result), NARROW)
    else:
        show(sections.report(result, every=every))
        print(f"\n{sections.sentence(result)}")
    return 0 if result.passed else 1
