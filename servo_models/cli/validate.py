"""servo-models validate"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from servo_models.cli.options import Format, check_outputs, write_result
from servo_models.errors import UserError
from servo_models.fmu.fmu import LIMITS, Limits

if TYPE_CHECKING:
    from servo_models.validation.any_fmu.experiment import Against


def validate(
    fmus: list[Path] | None = None,
    params: Path | None = None,
    trust: bool = False,
    actuator: Path | None = None,
    timeout: float = LIMITS.seconds,
    memory: float = LIMITS.megabytes,
    unpacked: float = LIMITS.unpacked_megabytes,
    inputs: Path | None = None,
    reference: Path | None = None,
    tolerance: Path | None = None,
    step: float | None = None,
    cross_check: Path | None = None,
    write_cross_check: Path | None = None,
    static_only: bool = False,
    junit: Path | None = None,
    summary: Path | None = None,
    report: Path | None = None,
    format_: Format = "text",
    every: bool = False,
    brief: bool = False,
) -> int:
    """Validate FMUs: ours against simulation and references, any against a reference of yours.

    The code of an FMU runs in a process of its own, with these limits; that guards against
    its faults, not against malice.

    Exit code 0: within all limits, 1: not, 2: could not run.

    Examples:

    servo-models validate

    servo-models validate fmus/sg90.fmu --report report.html --junit junit.xml

    servo-models validate any.fmu --inputs in.csv --reference ref.csv --tolerance tol.toml

    servo-models validate any.fmu --cross-check folder --format github

    servo-models validate any.fmu --static-only
    """
    from servo_models.catalogue import actuator as find_actuator
    from servo_models.cli.console import NARROW, print_commands, progress, show
    from servo_models.data.parameters import read_parameters
    from servo_models.validation import formats, sections
    from servo_models.validation.any_fmu.experiment import Against
    from servo_models.validation.any_fmu.static import inspect
    from servo_models.validation.runner import validate as run

    check_outputs((junit, ""), (report, ""), (summary, ""))
    if actuator and not fmus:
        raise UserError("--actuator tells of what FMU files are: name them as well")
    asked = Against(inputs, reference, tolerance, cross_check, step, write_cross_check)
    against = None if asked == Against() else asked
    _check(fmus, against, static_only)
    subjects: list[Any] = [*(fmus or ())]
    if params:
        subjects.append(read_parameters(params, trust).model())
    own = find_actuator(str(actuator)) if actuator else None
    limits = Limits(timeout, memory, unpacked)
    with progress("validating", lines=brief) as on_progress:
        try:
            if static_only:
                result = inspect(fmus or (), limits)
            else:
                result = run(subjects or None, on_progress, own, limits, against)
        except UserError as error:
            if own or "unknown actuator" not in str(error):
                raise
            raise UserError(
                f"{error}; or name the file of your own with --actuator; any other FMU takes"
                " --reference ref.csv, or --static-only"
            ) from error
    if junit:
        formats.write_junit(result, junit)
    if summary:
        formats.write_summary(result, summary)
    write_result(result, report=report)
    if format_ == "json":
        print(result.to_json())
    elif format_ == "github":
        print_commands(formats.github(result))
    elif brief:
        show(sections.summary(result), NARROW)
    else:
        show(sections.report(result, every=every))
        print(f"\n{sections.sentence(result)}")
    return 0 if result.passed else 1


def _check(fmus: list[Path] | None, against: Against | None, static_only: bool) -> None:
    """Refuse options that exclude each other."""
    if (against or static_only) and not fmus:
        raise UserError("no FMU: name the file that is to be looked at")
    if against and static_only:
        raise UserError("--static-only runs nothing: leave the reference and its options out")
    if against and against.cross_check and (against.reference or against.inputs):
        raise UserError("--cross-check names reference and inputs: leave the others out")
