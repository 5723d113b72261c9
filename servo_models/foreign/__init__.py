"""Any simulation as the model: an FMU, a Python function or an MJCF joint, with effects around it.

``load`` returns the actuator of ``x.fmu``, ``sim.py:simulate`` or ``robot.xml#joint``.  Its inside
is a closed box.  Effects of the border, on the command before it and on the readings behind it, are
those of the catalogue.
"""

from __future__ import annotations

import functools
from pathlib import Path

from servo_models.core.plant import Actuator
from servo_models.errors import told_at
from servo_models.files import read_regular
from servo_models.foreign.border import actuator_around
from servo_models.foreign.box import Box
from servo_models.foreign.fmu import FmuBox
from servo_models.foreign.function import FunctionBox
from servo_models.foreign.mjcf import MjcfBox


def load(file: Path, part: str) -> Actuator:
    """Return the actuator around a simulation: ``part`` is a function or a joint, "" for an FMU.

    Raises:
        UserError: a file that is missing or no such simulation; it names the cure.
    """
    return _loaded(file.resolve(), part, read_regular(file))


@functools.lru_cache(maxsize=16)
def _loaded(file: Path, part: str, content: bytes) -> Actuator:
    """One that is unchanged is loaded once a process."""
    box: Box
    if file.suffix == ".fmu":
        box, called = FmuBox(file), str(file)
    elif file.suffix == ".py":
        box, called = FunctionBox(file, part), f"{file}:{part}"
    else:
        box, called = MjcfBox(file, part), f"{file}#{part}"
    with told_at(f"'{file}'", ValueError):
        return actuator_around(box, Path(called))
