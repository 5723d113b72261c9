"""servo-models import"""

from __future__ import annotations

from pathlib import Path

from servo_models.cli.options import check_outputs


def import_(
    file: str, inertia: str = "0", out: Path | None = None, largest: int | None = None
) -> None:
    """Read nominal values from a simulator's file, each with what it came from.

    A description takes them by params = "FILE.toml"; its diagnosis then says what the
    simulator's joint lacks.

    Examples:

    servo-models import robot.xml#elbow --inertia "0.002 kg.m2" --out elbow.toml
    """
    from servo_models.cli.console import show
    from servo_models.data.parameters import write_parameters
    from servo_models.data.sections import parameter_report
    from servo_models.simulators.nominal import import_nominal

    check_outputs((out, ".toml"))
    parameters = import_nominal(file, inertia)
    if out:
        write_parameters(parameters, out)
        print(f"wrote '{out}': name it in a description, params = \"{out.name}\"")
    show(parameter_report(parameters))
