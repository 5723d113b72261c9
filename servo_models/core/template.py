"""Begin an actuator of one's own: write a working file, to be adapted."""

from __future__ import annotations

import os.path
from importlib.resources import files
from pathlib import Path

from servo_models.core.catalogue import all_actuators
from servo_models.core.plant import check_actuator_name
from servo_models.errors import UserError
from servo_models.files import write_whole

TEMPLATE = "my_servo"  # module among the actuators that is written, and the name that it defines


def write_template(path: Path) -> None:
    """Write a position servo to ``path``, named like the file; it runs as it is.

    A folder that is missing is made.

    Raises:
        UserError: no .py, a name that no actuator can have or that one of the catalogue has, a
            file that is there, or a folder that cannot be written.
    """
    if not path.name.endswith(".py"):
        raise UserError(f"'{path}' is no Python file: let the name end in .py")
    try:
        check_actuator_name(path.stem)
    except ValueError as error:
        raise UserError(f"'{path}' names its actuator: {error}") from error
    if path.stem in all_actuators():
        raise UserError(
            f"'{path}' is called like the actuator '{path.stem}' of the catalogue, and its"
            " FMU too: choose another name"
        )
    if os.path.lexists(path):  # also a link that leads nowhere
        raise UserError(f"'{path}' is there, and is not overwritten: choose another name")
    text = files("servo_models.actuators").joinpath(f"{TEMPLATE}.py").read_text(encoding="utf-8")
    write_whole(path, text.replace(TEMPLATE, path.stem).encode())
