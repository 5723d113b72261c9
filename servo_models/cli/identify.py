"""servo-models identify"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import check_outputs, write_result
from servo_models.errors import UserError


def identify(
    description: Path,
    free: str = "",
    search: str = "local",
    starts: int = 1,
    seed: int = 0,
    jobs: int | None = None,
    out: Path | None = None,
    report: Path | None = None,
    trust: bool = False,
    largest: int | None = None,
) -> int:
    """Estimate parameters from measured files.

    The description tells what is measured: logs of a run (fitted by
    simulation), frequency responses (a transfer function), or tables of
    single elements.

    Examples:

    servo-models identify mine.toml --out PARAMS.toml --report fit.html

    servo-models identify mine.toml --free torque_constant,coulomb_friction --search global

    Ctrl-C ends the search and keeps the best values so far.

    Exit code 0: done, 1: the values are doubtful, and the report says first why, 2: could not
    run.
    """
    from servo_models.cli.console import progress, show
    from servo_models.data.description import read_description
    from servo_models.identification.identify import identify as run

    check_outputs((out, ".toml"), (report, ".html"), description=description)
    names = [name.strip() for name in free.split(",") if name.strip()]
    with progress("identifying") as bar:
        told = read_description(description, trust)
        outcome = run(told, names, search, starts, seed, jobs, bar)
    written = []
    try:  # files come first: whoever reads the text may have seen enough and go
        if out and outcome.parameters:
            outcome.write_parameters(out)
            written.append(f"parameters: {out}")
        if report:
            write_result(outcome, report=report)
            written.append(f"report: {report}")
    finally:
        show(outcome.report())
        for line in written:
            print(line)
    if out and not outcome.parameters:
        raise UserError(
            f"'{out}' is not written: no parameter of this actuator was found this way, see above"
        )
    return 0 if outcome.believable else 1
