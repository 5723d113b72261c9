"""servo-models new"""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer


class Thing(str, Enum):
    """What can be begun."""

    ACTUATOR = "actuator"


def new(
    thing: Annotated[Thing, typer.Argument(help="What to begin.")],
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Python file to write, named as the actuator.")
    ],
) -> None:
    """Begin an actuator of your own: write a working file, to be adapted.

    It is a position servo with the usual effects; every other command takes the file in place of
    a name.

    Examples:

    servo-models new actuator mine.py

    servo-models explain mine.py
    """
    from servo_models.core.template import write_template

    write_template(file)
    print(f"wrote '{file}': adapt it, then 'servo-models explain {file}'")
