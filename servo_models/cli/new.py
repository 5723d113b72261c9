"""servo-models new"""

from __future__ import annotations

import os.path
from importlib.resources import files
from pathlib import Path
from typing import Literal

TEMPLATE = "my_servo"  # text beside this file, and the name of the actuator in it


def new(thing: Literal["actuator", "example"], file: Path) -> None:
    """Begin an actuator of your own, or with an example: write working files, to be adapted.

    The actuator is a position servo with the usual effects; every other command takes its file in
    place of a name. The example is a log of a servo with worn gears, and its description.

    Examples:

    servo-models new actuator mine.py

    servo-models new example servo.toml
    """
    if thing == "actuator":
        write_template(file)
        print(f"wrote '{file}': adapt it, then 'servo-models explain {file}'")
    else:
        from servo_models.data.example import write_example

        log = write_example(file)
        print(f"wrote '{log}' and '{file}': look at both, then 'servo-models diagnose {file}'")


def write_template(path: Path) -> None:
    """Write a position servo to ``path``, named like the file; it runs as it is.

    A folder that is missing is made.

    Raises:
        UserError: no .py, a name that no actuator can have or that one of the catalogue has, a
            file that is there, or a folder that cannot be written.
    """
    from servo_models.catalogue import all_actuators
    from servo_models.core.plant import check_actuator_name
    from servo_models.errors import UserError, told_at
    from servo_models.files import write_whole

    if not path.name.endswith(".py"):
        raise UserError(f"'{path}' is no Python file: let the name end in .py")
    with told_at(f"'{path}' names its actuator", ValueError):
        check_actuator_name(path.stem)
    if path.stem in all_actuators():
        raise UserError(
            f"'{path}' is called like the actuator '{path.stem}' of the catalogue, and its"
            " FMU too: choose another name"
        )
    if os.path.lexists(path):  # also a link that leads nowhere
        raise UserError(f"'{path}' is there, and is not overwritten: choose another name")
    text = files(__package__).joinpath(f"{TEMPLATE}.txt").read_text(encoding="utf-8")
    write_whole(path, text.replace(TEMPLATE, path.stem).encode())
