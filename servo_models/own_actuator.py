"""A user's own actuator: a Python file that defines ``ACTUATOR``."""

from __future__ import annotations

import importlib.util
import os.path
import sys
from dataclasses import replace
from pathlib import Path

from servo_models.actuator import Actuator
from servo_models.errors import UserError


def load_actuator(path: Path) -> Actuator:
    """Run a Python file and return its ``ACTUATOR``, which then knows the file.

    Raises:
        UserError: no such file, a fault in it, or no actuator.
    """
    if not path.is_file():
        raise UserError(f"cannot read '{path}': no such file; name one that defines ACTUATOR")
    name = f"own_actuator_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's file may raise
        raise UserError(f"'{path}' does not run: {type(error).__name__}: {error}") from error
    found = getattr(module, "ACTUATOR", None)
    if not isinstance(found, Actuator):
        raise UserError(f"'{path}' defines no ACTUATOR: set it to an Actuator")
    return replace(found, file=path.resolve())


def key_from(actuator: Actuator, folder: Path) -> str:
    """Return what a text in ``folder`` calls an actuator: its name, or the path of its file."""
    if not actuator.file:
        return actuator.name
    try:
        return Path(os.path.relpath(actuator.file, folder.resolve())).as_posix()
    except ValueError:  # on another drive
        return actuator.file.as_posix()
