"""servo-models rehearse"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import assignments, check_outputs, write_result


def rehearse(
    description: Path,
    noise: list[str] | None = None,
    gap: list[float] | None = None,
    effects: str | None = None,
    json: Path | None = None,
    report: Path | None = None,
    seed: int = 0,
    jobs: int | None = None,
    time_limit: float | None = None,
    trust: bool = False,
    largest: int | None = None,
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
        noises, tried = assignments("--noise", noise or ()), effects.split(",") if effects else ()
        found = run(description, noises, gap or GAPS, tried, jobs, seed, time_limit, trust, bar)
    write_result(found, json=json, report=report)
    show(found.report())
    failed = any(answer.told == FAILED for answer in found.answers)
    return 1 if failed or found.unfinished else 0
