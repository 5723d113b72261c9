"""servo-models export"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import check_outputs, write_result


def export(
    params: Path,
    to: str,
    log: Path | None = None,
    time_step: str | None = None,
    out: Path | None = None,
    json: Path | None = None,
    trust: bool = False,
    largest: int | None = None,
) -> None:
    """Write the native fields of a simulator, refitted to a diagnosed actuator.

    Then it tells which effects are exact, approximate and lost. With --log the errors of the
    nominal model, the diagnosed one and the native law are measured.

    Examples:

    servo-models export PARAMS.toml --to mujoco --log mine.toml

    servo-models export PARAMS.toml --to ardupilot --out servo.parm
    """
    from servo_models.cli.console import progress, show
    from servo_models.files import write_whole
    from servo_models.simulators import simulator
    from servo_models.simulators.export import export as run

    simulator(to)
    check_outputs((json, ".json"), (out, ""), description=log, read=[params])
    with progress(f"fitting {to}"):
        result = run(params, to, log, time_step, trust)
    if out:
        write_whole(out, result.lines.encode())
        print(f"wrote '{out}'\n")
    else:
        print(result.lines)
    write_result(result, json=json)
    show(result.report())
