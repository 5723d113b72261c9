"""servo-models rehearse"""

from __future__ import annotations

from typing import Annotated

import typer

from servo_models.cli.options import (
    Described,
    Jobs,
    Json,
    Largest,
    Report,
    Seed,
    Trust,
    assignments,
    check_outputs,
    time_option,
    write_result,
)


def rehearse(
    description: Described,
    noise: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="Standard deviation of an output, such as angle=0.1deg; may be repeated.",
        ),
    ] = None,
    gap: Annotated[
        list[float] | None,
        typer.Option(help="Gap to be made [noise floors]; may be repeated; default 3 and 10."),
    ] = None,
    effects: Annotated[
        str | None, typer.Option(metavar="A,B", help="Effects to try; default: all that are off.")
    ] = None,
    json: Json = None,
    report: Report = None,
    seed: Seed = 0,
    jobs: Jobs = None,
    time_limit: Annotated[float | None, time_option("For each diagnosis, such as 60s.")] = None,
    trust: Trust = False,
    largest: Largest = None,
) -> int:
    """Ask what these commands would show, before anything is measured.

    Each effect is put into the model, large enough to make a gap of so many
    noise floors, and its log is made with your command and noise and
    diagnosed: which would be found, which not, which are confused.  The log
    may hold times and inputs alone; it then takes --noise, or the scale of
    a column as its resolution.

    The same equations make and fit the logs: no real log shows more.

    Exit code 0: all was tried, 1: stopped by Ctrl-C, or one failed, 2: could
    not run.

    Examples:

    servo-models rehearse mine.toml --report rehearsal.html

    servo-models rehearse plan.toml --noise angle=0.1deg --gap 10

    servo-models rehearse mine.toml --effects backlash,sensor_lag
    """
    from servo_models.cli.console import progress, show
    from servo_models.survey.rehearsal.rehearse import FAILED, GAPS
    from servo_models.survey.rehearsal.rehearse import rehearse as run

    check_outputs((json, ".json"), (report, ".html"), description=description)
    with progress("rehearsing", lines=True) as bar:
        found = run(
            description,
            assignments("--noise", noise or ()),
            gap or GAPS,
            effects.split(",") if effects else (),
            jobs,
            seed,
            time_limit,
            trust,
            tell=bar,
        )
    write_result(found, json=json, report=report)
    show(found.report())
    failed = any(answer.told == FAILED for answer in found.answers)
    return 1 if failed or found.unfinished else 0
