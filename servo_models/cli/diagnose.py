"""servo-models diagnose"""

from __future__ import annotations

import sys
from datetime import date
from math import isfinite
from pathlib import Path

from servo_models.cli.options import Format, check_outputs, write_result
from servo_models.errors import UserError


def diagnose(
    description: Path,
    json: Path | None = None,
    report: Path | None = None,
    out: Path | None = None,
    map_: Path | None = None,
    signals: Path | None = None,
    format_: Format = "text",
    tolerance: float | None = None,
    seed: int = 0,
    jobs: int | None = None,
    quick: bool = False,
    time_limit: float | None = None,
    trust: bool = False,
    largest: int | None = None,
) -> int:
    """Find out where a model and logs of the real thing differ, and why.

    Nominal parameters are re-tuned inside the uncertainties that the
    description gives; what they leave is explained by effects.  Figures are
    of what the description holds out, then of blocks that a fit left out.
    Commands of the next experiments are written beside --json and --report
    (.csv).

    A first answer is told on standard error and then refined.  Ctrl-C, or a
    limit, ends the search: the best so far is told and written, with what was
    not tried.  A second Ctrl-C gives up.

    Exit code 0: no gap, 1: a gap, or stopped, 2: could not run.

    Examples:

    servo-models diagnose mine.toml

    servo-models diagnose mine.toml --time-limit 60s

    servo-models diagnose mine.toml --out PARAMS.toml --json diagnosis.json

    servo-models build --params PARAMS.toml
    """
    from servo_models.cli.console import print_commands, progress, show
    from servo_models.core.stop import BY_CTRL_C
    from servo_models.data.audit import LEAST_GAP
    from servo_models.data.description import read_description
    from servo_models.data.parameters import write_parameters
    from servo_models.diagnosis.diagnose import diagnose as run
    from servo_models.diagnosis.document import github
    from servo_models.diagnosis.search.selection import FIRST_ANSWER

    toml = ((out, ".toml"), (map_, ".toml"))
    check_outputs((json, ".json"), (report, ".html"), *toml, description=description)
    if signals:
        _check_signals(signals, description)
    allowed = LEAST_GAP if tolerance is None else tolerance
    if not isfinite(allowed):
        raise UserError(f"--tolerance {allowed}: give a number of noise floors, such as 2")
    with progress("diagnosing") as bar:

        def tell(text: str, *_: object) -> None:
            bar(text)
            if text.startswith(FIRST_ANSWER):
                print(f"{text}{'' if quick else '; refining'}", file=sys.stderr, flush=True)

        rig = read_description(description, trust)
        result = run(
            rig, allowed, seed, jobs, tell=tell, fmu=True, time_limit=time_limit, quick=quick
        )
        folders = {path.parent for path in (json, report) if path}
        try:
            bar("looking for the next experiment")
            result = result.with_commands(*folders)
        except KeyboardInterrupt:  # the search is over, and nothing of it is to be lost
            result = result.without_next(BY_CTRL_C)
    today = date.today()
    write_result(result, json=json, report=report)
    if out:
        write_parameters(result.parameter_set(today), out)
    if signals:
        result.write_signals(signals)
    if map_ and result.residual_map:
        write_parameters(result.map_parameter_set(today), map_)
    if format_ == "json":
        print(result.to_json())
    elif format_ == "github":
        print_commands(github(result))
    else:
        show(result.report())
    return 0 if result.within_tolerance else 1


def _check_signals(path: Path, description: Path) -> None:
    """Check the name of a file of signals, and that the library for it is installed."""
    from servo_models.data.plotjuggler import LAYOUT, LIBRARY
    from servo_models.errors import extra

    known = path.suffix in (".csv", ".parquet", ".mcap")
    outputs = [(path, path.suffix if known else ".csv, .parquet or .mcap")]
    if path.suffix == ".mcap":
        outputs.append((path.with_suffix(LAYOUT), LAYOUT))
        extra("mcap", LIBRARY)
    check_outputs(*outputs, description=description)
