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
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

from servo_models.core import block, plant
from servo_models.core.plant import Actuator
from servo_models.errors import UserError
from servo_models.files import read_regular


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
    name = f"own_actuator_{hashlib.sha256(f'{path}'.encode() + content).hexdigest()[:16]}"
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(path)
    # where files written for version 0.2 look for their names
    sys.modules |= {"servo_models.block": block, "servo_models.actuator": plant}
    try:
        text = content.decode()
        # blocks are inlined from this text, whatever becomes of the file meanwhile
        linecache.cache[str(path)] = (len(text), None, text.splitlines(keepends=True), str(path))
        exec(compile(text, str(path), "exec"), vars(module))  # the user's own file: see above
    except (Exception, SystemExit) as error:  # whatever a user's file may raise
        del sys.modules[name]
        raise UserError(
            f"'{path}' does not run: {type(error).__name__}: {error}; correct it"
        ) from error
    found = getattr(module, "ACTUATOR", None)
    if not isinstance(found, Actuator):
        raise UserError(f"'{path}' defines no ACTUATOR: set it to an Actuator")
    return replace(found, file=path)


def is_file(name: str) -> bool:
    """Whether an actuator is called by its Python file."""
    return name.endswith(".py")


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
