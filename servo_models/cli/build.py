"""servo-models build"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import Settings, Variant, assignments, complete_actuator
from servo_models.errors import UserError


def build(
    actuator: Annotated[
        str | None,
        typer.Argument(help="Name of an actuator; default all.", autocompletion=complete_actuator),
    ] = None,
    variant: Variant = None,
    set_: Settings = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the FMUs.")] = Path("fmus"),
) -> None:
    """Build FMUs (FMI 2.0 co-simulation).

    Examples:

    servo-models build

    servo-models build sg90 --variant linear --set feedback_coefficient=0.15 --out mine
    """
    from servo_models.build import build as write
    from servo_models.catalogue import actuators
    from servo_models.cli.console import progress
    from servo_models.simulate import model

    if not actuator and (variant or set_):
        raise UserError("--variant and --set belong to one actuator: name it")
    names = [actuator] if actuator else list(actuators())
    settings = assignments("--set", set_ or ())
    models = [model(name, variant, settings) for name in names]
    with progress("building") as report:
        for done, chosen in enumerate(models):
            report(done, len(models), f"building {chosen.actuator.name}")
            print(write(chosen, out / f"{chosen.actuator.name}.fmu"))
