"""servo-models survey"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import write_result


def survey(
    path: Path,
    out: Path | None = None,
    actuator: str | None = None,
    before: Path | None = None,
    seed: int = 0,
    jobs: int | None = None,
    scheduler: str | None = None,
    quick: bool = False,
    time_limit: float | None = None,
    reports: bool = True,
    trust: bool = False,
    largest: int | None = None,
) -> int:
    """Diagnose all joints, episodes and units, and compare them.

    A joint without a description gets a first one; one that is there is kept:
    correct it and start again, and what depends on it is done anew.  Stopped
    at any moment and started again, it goes on where it was, and several may
    work on one folder.

    Written are index.html, survey.json, a table of joints and one of their
    parameters (.csv, .parquet), and for each joint its diagnosis and its page.

    Exit code 0: no gap, 1: a gap, or a joint that failed, 2: could not run.

    Examples:

    servo-models survey my_data_set

    servo-models survey fleet --before fleet_last_month_survey

    servo-models survey fleet.csv --jobs 2 --time-limit 60s
    """
    from servo_models.cli.console import progress, show
    from servo_models.diagnosis.verdict import NO_GAP
    from servo_models.survey.survey import survey as run

    with progress("surveying", lines=True) as bar:
        limits = (seed, quick, time_limit, trust)
        found = run(path, out, actuator, jobs, scheduler, reports, before, *limits, bar)
        files = found.folder / "survey.json", found.folder / "index.html"
        write_result(found, json=files[0], report=files[1])
    show(found.report())
    print(f"see '{files[1]}'")
    return 0 if all(one.verdict == NO_GAP for one in found.outcomes) else 1
