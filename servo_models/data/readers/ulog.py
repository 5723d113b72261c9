"""ULog files of PX4: a topic is a table.

A further instance of a topic is called ``topic.1``, ``topic.2`` and so on.  Times stand in
``timestamp``, in us.  Rows count the topic's messages from 1.
"""

from __future__ import annotations

import io
import struct

from servo_models.data.readers.columns import Source, Tables, array_column
from servo_models.errors import UserError, extra

SUFFIXES = (".ulg", ".ulog")
HEADER = 16  # bytes of the header of a file
DEFINITIONS = b"BFIMPQ"  # types of messages that define others
FIRST_DATA = b"ALC"  # types of messages with which the data begin


def read(source: Source) -> Tables:
    """Read a ULog file."""
    pyulog = extra("ulog", "pyulog")
    if not _is_defined(source.content):
        raise source.damaged("ULog")
    if not _is_whole(source.content):
        raise UserError(
            f"'{source.path}' ends within a message: copy it again; of a recording that was cut"
            " off, ulog2csv of pyulog writes the part before the cut as CSV"
        )
    with source.read_by_library("ULog"):
        topics = pyulog.ULog(io.BytesIO(source.content)).data_list
    named = {t.name if t.multi_id == 0 else f"{t.name}.{t.multi_id}": t for t in topics}
    return Tables(
        {
            name: [array_column(field, values) for field, values in named[name].data.items()]
            for name in source.wanted(named)
        }
    )


def _is_defined(content: bytes) -> bool:
    """Whether the definitions are whole; pyulog does not return from damaged ones.

    Source: PX4 User Guide, ULog File Format, definition section.
    """
    place = HEADER
    while place + 3 <= len(content):
        size, kind = struct.unpack_from("<HB", content, place)
        if kind in FIRST_DATA:
            return True
        if kind not in DEFINITIONS:
            return False
        place += 3 + size
    return False


def _is_whole(content: bytes) -> bool:
    """Whether the last message ends where the file does."""
    place = HEADER
    while place + 3 <= len(content):
        place += 3 + int.from_bytes(content[place : place + 2], "little")
    return place == len(content)
