"""Measured files: one file here = one log format.

A format is a module with ``SUFFIXES``, the ends of its files' names, and ``read``, which
returns the tables of a ``Source``.  Nothing else has to know of it.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import os
import pkgutil
from pathlib import Path
from types import ModuleType

from servo_models.data.readers.columns import Columns, Source
from servo_models.errors import UserError
from servo_models.files import read_regular

__all__ = ["Columns", "read_columns", "suffixes"]


def read_columns(path: Path, table: str | None = None, header: bool | None = None) -> Columns:
    """Read the columns of a measured file, of a format told by the end of its name.

    Args:
        path: the file.
        table: one of a file with several tables, such as a topic.  Without it all of them
            are read and their columns are called ``table.column``.
        header: whether the first row of a text file names the columns; found out if None.

    Raises:
        UserError: a file that is missing, damaged or empty, of an unknown format or one
            whose extra is not installed; an unknown table.
    """
    path = Path(path)
    known = _formats()
    if os.path.isdir(path):
        raise UserError(
            f"'{path}' is a folder, and no LeRobot data set with a meta/info.json: name a file in it"
        )
    if path.suffix.lower() not in known:
        raise UserError(
            f"'{path}' is of no known format: its name may end in {', '.join(suffixes())}"
        )
    content = read_regular(path)
    source = Source(path, content, table, header)
    tables = known[path.suffix.lower()].read(source)
    prefixed = len(tables.cells) > 1
    cells = [
        column.alias(f"{name}.{column.name}") if prefixed else column
        for name, columns in tables.cells.items()
        for column in columns
    ]
    if not any(map(len, cells)):
        raise UserError(f"{source.place} has no rows of numbers: record it again")
    digest = hashlib.sha256(content).hexdigest()
    return Columns(path, tuple(cells), tables.first_row, table or "", digest, tables.aliases)


def suffixes() -> tuple[str, ...]:
    """Return the ends of the names of all files that can be read, in lower case."""
    return tuple(sorted(_formats()))


@functools.cache
def _formats() -> dict[str, ModuleType]:
    """Every format by the ends of its files' names."""
    names = [module.name for module in pkgutil.iter_modules(__path__)]
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    return {suffix: module for module in modules for suffix in getattr(module, "SUFFIXES", ())}
