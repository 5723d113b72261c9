"""servo-models blind"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import check_outputs, write_result


def blind(
    cases: int,
    seed: int,
    json: Path | None = None,
    tiers: str = "easy,hard,poor",
    folder: Path | None = None,
    jobs: int | None = None,
) -> int:
    """Score the diagnosis on cases whose cause is withheld.

    A generator that shares no simulation code with the models writes logs of
    rigs with nothing, one effect, two, or one outside the catalogue. The
    SHA-256 of the answers is printed before anything is diagnosed, and
    checked when they are opened.

    Exit code 0: done, 1: cases whose diagnosis failed, 2: could not run.

    Examples:

    servo-models blind --cases 12 --seed 1

    servo-models blind --cases 1800 --seed 7 --folder runs/7 --json blind.json
    """
    from servo_models.cli.console import progress, show
    from servo_models.files import scratch
    from servo_models.withheld.run import Asked, check_tiers, run_blind

    check_outputs((json, ".json"))
    asked = Asked(cases, seed, check_tiers(tiers))
    with scratch() as place, progress("generating") as bar:
        done = run_blind(
            folder or place / "blind",
            asked,
            jobs,
            lambda seal: print(f"seal of the answers, SHA-256: {seal}", flush=True),
            bar,
        )
    write_result(done, json=json)
    show(done.report())
    return 1 if any(case.said.why for case in done.cases) else 0
