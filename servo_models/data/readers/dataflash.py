"""DataFlash logs of ArduPilot: a message is a table, and so is each instance of one, ``CSRV[2]``.

Times stand in ``TimeUS``, in us.  Rows count the messages of a table from 1.
"""

from __future__ import annotations

import contextlib
import io
from typing import Any

from servo_models.data.readers.columns import NUMBER, Source, Tables, column_of
from servo_models.errors import extra
from servo_models.files import check_size

SUFFIXES = (".bin",)


def read(source: Source) -> Tables:
    """Read a log; what a crash has cut off at its end is left out."""
    reader = extra("ardupilot", "pymavlink.DFReader").DFReader_binary
    # the compiled indexer prints past sys.stderr
    in_python = type("Reader", (reader,), {"init_arrays_fast": reader.init_arrays})
    with source.read_by_library("DataFlash"), contextlib.redirect_stderr(io.StringIO()):
        tables = _tables(source, in_python(str(source.path)))
    if not tables:
        raise source.damaged("DataFlash")
    return Tables(
        {
            name: [column_of(field, values) for field, values in tables[name].items()]
            for name in source.wanted(tables)
        }
    )


def _tables(source: Source, log: Any) -> dict[str, dict[str, list[Any]]]:
    """Values by field, by message or instance of one; only messages with a time."""
    tables: dict[str, dict[str, list[Any]]] = {}
    size = 0
    while (message := log.recv_msg()) is not None:
        fields = message.get_fieldnames()
        if "TimeUS" not in fields:  # it describes others
            continue
        of = message.fmt.instance_field
        name = message.get_type() + (f"[{getattr(message, of)}]" if of else "")
        size += NUMBER * len(fields)
        check_size(source.path, size)
        columns = tables.setdefault(name, {field: [] for field in fields})
        for field in fields:
            columns[field].append(getattr(message, field))
    return tables
