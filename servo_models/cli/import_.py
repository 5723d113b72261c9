"""servo-models import"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import Largest, check_outputs, file_option


def import_(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE[#JOINT]",
            help="An MJCF, an Isaac Lab configuration, a JSBSim file, a .parm or BAM's JSON.",
        ),
    ],
    inertia: Annotated[
        str, typer.Option(metavar="INERTIA", help="That the joint carries beside its armature.")
    ] = "0",
    out: Annotated[
        Path | None, file_option("Write a parameter file, .toml; default: show it.")
    ] = None,
    largest: Largest = None,
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
