"""Measured files: one file here = one log format.

A format is a module with ``SUFFIXES``, the ends of its files' names, and ``read``, which
returns the tables of a ``Source``; a damaged file, or one without the table that is asked for, is a
UserError.  Nothing else has to know of it.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import os
import pkgutil
from pathlib import Path
from types import ModuleType

from servo_models.data.readers import rosbag
from servo_models.data.readers.columns import Columns, Source, Tables
from servo_models.errors import UserError
from servo_models.files import check_size, read_regular

__all__ = ["Columns", "is_bag", "read_columns", "read_tables", "suffixes"]


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
    tables, digest = _read(Path(path), table, header)
    prefixed = len(tables.cells) > 1
    cells = [
        column.alias(f"{name}.{column.name}") if prefixed else column
        for name, columns in tables.cells.items()
        for column in columns
    ]
    return Columns(Path(path), tuple(cells), tables.first_row, table or "", digest, tables.aliases)


def read_tables(path: Path) -> dict[str, Columns]:
    """Read every table of a measured file by its name, ``""`` for one that has none.

    Raises:
        UserError: see ``read_columns``.
    """
    tables, digest = _read(path, None, None)
    return {
        name: Columns(path, tuple(cells), tables.first_row, name, digest, tables.aliases)
        for name, cells in tables.cells.items()
    }


def _read(path: Path, table: str | None, header: bool | None) -> tuple[Tables, str]:
    """The tables of a file or folder, and the SHA-256 of its bytes."""
    if os.path.isdir(path):
        content, reader = _folder(path)
    else:
        known = _formats()
        if path.suffix.lower() not in known:
            raise UserError(
                f"'{path}' is of no known format: its name may end in {', '.join(suffixes())}"
            )
        content, reader = read_regular(path), known[path.suffix.lower()]
    source = Source(path, content, table, header)
    tables = reader.read(source)
    if not any(len(column) for columns in tables.cells.values() for column in columns):
        raise UserError(f"{source.place} has no rows of numbers: record it again")
    return tables, hashlib.sha256(content).hexdigest()


def is_bag(path: Path) -> bool:
    """Whether a folder is one that is read like a file."""
    return os.path.isfile(path / rosbag.FOLDER)


def _folder(path: Path) -> tuple[bytes, ModuleType]:
    """The bytes of all files of a bag."""
    if not is_bag(path):
        raise UserError(
            f"'{path}' is a folder, and neither a LeRobot data set, with meta/info.json, nor a bag"
            f" of ROS 2, with {rosbag.FOLDER} ('ros2 bag reindex' writes a lost one): name a file"
        )
    files = [file for file in sorted(path.iterdir()) if not os.path.isdir(file)]
    check_size(path, sum(file.stat().st_size for file in files if os.path.isfile(file)))
    return b"".join(map(read_regular, files)), rosbag


def suffixes() -> tuple[str, ...]:
    """Return the ends of the names of all files that can be read, in lower case."""
    return tuple(sorted(_formats()))


@functools.cache
def _formats() -> dict[str, ModuleType]:
    """Every format by the ends of its files' names."""
    names = [module.name for module in pkgutil.iter_modules(__path__)]
    modules = [importlib.import_module(f"{__name__}.{name}") for name in names]
    return {suffix: module for module in modules for suffix in getattr(module, "SUFFIXES", ())}
