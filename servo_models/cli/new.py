"""servo-models new"""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def new(thing: Literal["actuator", "example"], file: Path) -> None:
    """Begin an actuator of your own, or with an example: write working files, to be adapted.

    The actuator is a position servo with the usual effects; every other command takes its file in
    place of a name. The example is a log of a servo with worn gears, and its description.

    Examples:

    servo-models new actuator mine.py

    servo-models new example servo.toml
    """
    if thing == "actuator":
        from servo_models.core.template import write_template

        write_template(file)
        print(f"wrote '{file}': adapt it, then 'servo-models explain {file}'")
    else:
        from servo_models.data.example import write_example

        log = write_example(file)
        print(f"wrote '{log}' and '{file}': look at both, then 'servo-models diagnose {file}'")
