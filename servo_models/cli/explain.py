"""servo-models explain"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servo_models.cli.options import complete_name


def explain(
    name: Annotated[
        str,
        typer.Argument(help="Name of an actuator or an effect.", autocompletion=complete_name),
    ],
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw its response to .svg, .png or .pdf.", metavar="FILE"),
    ] = None,
) -> None:
    """Explain an actuator or an effect: equations, parameters, sources, a picture.

    Examples:

    servo-models explain torque_motor

    servo-models explain backlash --picture backlash.svg
    """
    from servo_models.cli.console import progress, show
    from servo_models.explain import explain as sheet_of

    show(sheet_of(name))
    if picture:
        from servo_models.demonstration import portrait
        from servo_models.pictures import check_suffix, save

        check_suffix(picture)
        with progress(f"drawing {name}"):
            save(portrait(name), picture)
