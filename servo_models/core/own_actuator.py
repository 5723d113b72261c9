"""A user's own actuator: a Python file that defines ``ACTUATOR``, and who may have it run.

To use such a file is to run it.  A file that somebody names in a command or in Python is run.
Where a description or a parameter file names it, it is run if it lies in the same folder, else
only if it is said to be trusted.  Nothing inside an FMU can name one.
"""

from __future__ import annotations

import functools
import hashlib
import linecache
import os.path
import re
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from servo_models.core import block, plant
from servo_models.core.plant import Actuator
from servo_models.errors import UserError
from servo_models.files import read_regular

SIMULATION = re.compile(r"(.+\.fmu)|(.+\.py):(\w+)|(.+\.xml)#(.+)")
"""``x.fmu``, ``sim.py:function`` and ``robot.xml#joint``."""


def load_actuator(path: Path) -> Actuator:
    """Run a Python file and return its ``ACTUATOR``, which then knows the file.

    A file is run once a process, and again only when its content has changed.

    Raises:
        UserError: no such file, a fault in it (also one that ends the process), or no actuator.
    """
    if not os.path.exists(path):  # which also takes a text that is no name at all
        raise UserError(f"cannot read '{path}': no such file; name one that defines ACTUATOR")
    return _run(path.resolve(), read_regular(path))


@functools.lru_cache(maxsize=16)
def _run(path: Path, content: bytes) -> Actuator:
    # where files written for version 0.2 look for their names
    sys.modules |= {"servo_models.block": block, "servo_models.actuator": plant}
    try:
        module = executed(content.decode(), str(path))
    except (Exception, SystemExit) as error:  # whatever a user's file may raise
        raise UserError(
            f"'{path}' does not run: {type(error).__name__}: {error}; correct it"
        ) from error
    defined = getattr(module, "ACTUATOR", None)
    if not isinstance(defined, Actuator):
        raise UserError(f"'{path}' defines no ACTUATOR: set it to an Actuator")
    return replace(defined, file=path)


def executed(text: str, path: str) -> ModuleType:
    """Run Python text as a module of its own, from which blocks can be printed.

    Raises:
        Exception: whatever the text raises.
    """
    name = f"own_actuator_{hashlib.sha256(f'{path}{text}'.encode()).hexdigest()[:16]}"
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = path
    # blocks are inlined from this text, whatever becomes of the file meanwhile
    linecache.cache[path] = (len(text), None, text.splitlines(keepends=True), path)
    try:
        exec(compile(text, path, "exec"), vars(module))  # the user's own file: see above
    except BaseException:
        del sys.modules[name]
        raise
    return module


def is_file(name: str) -> bool:
    """Whether an actuator is called by its file: Python, or a simulation that is not ours."""
    return name.endswith(".py") or simulation(name) is not None


def simulation(name: str) -> tuple[Path, str] | None:
    """Return the file of a simulation that is not ours and what part of it a name means, else None.

    Example:
        >>> simulation("arm/robot.xml#elbow")
        (PosixPath('arm/robot.xml'), 'elbow')
    """
    parts = SIMULATION.fullmatch(name)
    if not parts:
        return None
    fmu, python, function, mjcf, joint = parts.groups()
    return Path(fmu or python or mjcf), function or joint or ""


def check_trust(code: Path, named_in: Path, trust: bool) -> None:
    """Refuse a Python file that another file names, unless it lies beside that or is trusted.

    Raises:
        UserError: it lies elsewhere.
    """
    is_there = os.path.exists(code)  # what is not there, nobody can run
    if is_there and not trust and code.resolve().parent != named_in.resolve().parent:
        raise UserError(
            f"'{named_in.name}' would run the Python file '{code}', which does not lie beside it:"
            " read that file, then say --trust, or trust=True where Python reads"
            f" '{named_in.name}'"
        )


def key_from(actuator: Actuator, folder: Path) -> str:
    """Return what a text in ``folder`` calls an actuator: its name, or the path of its file."""
    if not actuator.file:
        return actuator.name
    try:
        return Path(os.path.relpath(actuator.file, folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return actuator.file.as_posix()
