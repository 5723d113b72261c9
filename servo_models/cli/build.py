"""servo-models build"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import (
    Params,
    Trust,
    Values,
    Variant,
    chosen_model,
    complete_actuator,
)
from servo_models.errors import UserError


def build(
    actuator: Annotated[
        str | None,
        typer.Argument(
            help="An actuator, or your own .py file; default all.", autocompletion=complete_actuator
        ),
    ] = None,
    variant: Variant = None,
    set_: Values = None,
    params: Params = None,
    trust: Trust = False,
    out: Annotated[
        Path, typer.Option(metavar="PATH", help="Folder of the FMUs, or one file .fmu.")
    ] = Path("fmus"),
    native: Annotated[
        bool, typer.Option("--native", help="Native FMUs alone; refused without a C compiler.")
    ] = False,
    fmi: Annotated[
        int,
        typer.Option(min=2, max=3, metavar="2|3", help="Version of FMI; what is of 3 is native."),
    ] = 2,
) -> None:
    """Build FMUs for co-simulation.

    sg90.fmu is Python; sg90.native.fmu beside it is compiled, for hosts without Python.

    A native one needs a C compiler: the machine's own, or the extra "native" for all platforms.

    sg90 is the default variant, sg90_printed another one; sg90_torque is for physics engines.

    Examples:

    servo-models build

    servo-models build sg90 --variant linear --set feedback_coefficient=0.15 --out mine

    servo-models build --params identified.toml

    servo-models build sg90 --native --out sg90.fmu

    servo-models build --fmi 3

    servo-models build sg90_torque --native
    """
    from servo_models.build import build as write
    from servo_models.build import kinds_for, path_of
    from servo_models.catalogue import actuators, model
    from servo_models.cli.console import progress

    if actuator or params:
        models = [chosen_model(actuator, variant, set_, params, trust)]
    elif variant or set_:
        raise UserError("--variant and --set belong to one actuator: name it")
    elif out.suffix == ".fmu":
        raise UserError(f"'{out}' is the file of one actuator: name it, or give a folder")
    else:
        models = [model(name) for name in actuators()]
    jobs = [(chosen, kind) for chosen in models for kind in kinds_for(out, native, fmi)]
    with progress("building") as report:
        for done, (chosen, kind) in enumerate(jobs):
            report(done, len(jobs), f"building {chosen.actuator.name}")
            print(write(chosen, path_of(chosen, out, kind), kind), flush=True)
