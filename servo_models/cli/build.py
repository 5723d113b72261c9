"""servo-models build"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import (
    Params,
    Settings,
    Trust,
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
    set_: Settings = None,
    params: Params = None,
    trust: Trust = False,
    out: Annotated[
        Path, typer.Option(metavar="PATH", help="Folder of the FMUs, or one file .fmu.")
    ] = Path("fmus"),
) -> None:
    """Build FMUs (FMI 2.0 co-simulation).

    sg90.fmu is the default variant, sg90_printed.fmu another one.

    Examples:

    servo-models build

    servo-models build sg90 --variant linear --set feedback_coefficient=0.15 --out mine

    servo-models build --params identified.toml
    """
    from servo_models.build import build as write
    from servo_models.build import path_of
    from servo_models.cli.console import progress
    from servo_models.core.catalogue import actuators
    from servo_models.core.simulate import model

    if actuator or params:
        models = [chosen_model(actuator, variant, set_, params, trust)]
    elif variant or set_:
        raise UserError("--variant and --set belong to one actuator: name it")
    elif out.suffix == ".fmu":
        raise UserError(f"'{out}' is the file of one actuator: name it, or give a folder")
    else:
        models = [model(name) for name in actuators()]
    with progress("building") as report:
        for done, chosen in enumerate(models):
            report(done, len(models), f"building {chosen.actuator.name}")
            print(write(chosen, path_of(chosen, out)), flush=True)
