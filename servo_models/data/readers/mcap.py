"""MCAP files with messages in JSON or of ROS 2: a topic is a table.

Besides the fields of its messages a table has ``log_time``, ``publish_time`` and, if they have a
header, ``header_stamp`` in ns since the first message of the file.  Rows count the messages of
the topic from 1.
"""

from __future__ import annotations

import functools
import io
import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from servo_models.data.readers.columns import Source, Tables
from servo_models.data.readers.ros import message_columns, plain
from servo_models.errors import UserError, extra
from servo_models.files import check_size

if TYPE_CHECKING:
    import polars as pl

SUFFIXES = (".mcap",)
ENCODINGS = ("json", "cdr")


def read(source: Source) -> Tables:
    """Read an MCAP file."""
    reader = extra("mcap", "mcap.reader")
    with source.read_by_library("MCAP"):
        opened = reader.make_reader(io.BytesIO(source.content))
        summary = opened.get_summary()
        chunks = summary.chunk_indexes if summary else ()
        check_size(source.path, sum(chunk.uncompressed_size for chunk in chunks))
        messages = list(opened.iter_messages())
    topics: dict[str, list[Any]] = {}
    for item in messages:
        if item[1].message_encoding in ENCODINGS or item[1].topic == source.table:
            topics.setdefault(item[1].topic, []).append(item)
    first = min((message.log_time for _, _, message in messages), default=0)
    return Tables.of(
        {name: _columns(source, topics[name], first) for name in source.wanted(topics)}
    )


def _columns(
    source: Source, items: list[Any], first: int
) -> tuple[list[pl.Series], dict[str, str]]:
    times = {
        name: [getattr(message, name) for _, _, message in items]
        for name in ("log_time", "publish_time")
    }
    decoders: dict[int, Callable[[bytes], Any]] = {}
    with source.read_by_library("MCAP"):
        for schema, channel, _ in items:
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(source, schema, channel)
        records = [decoders[channel.id](message.data) for _, channel, message in items]
    return message_columns(source, times, records, first)


def _decoder(source: Source, schema: Any, channel: Any) -> Callable[[bytes], Any]:
    if channel.message_encoding == "json":
        return functools.partial(json.loads, parse_int=float)
    if channel.message_encoding not in ENCODINGS:
        raise UserError(
            f"'{source.path}': messages of '{channel.topic}' are encoded as"
            f" '{channel.message_encoding}': record them as JSON or by ROS 2"
        )
    factory = extra("mcap", "mcap_ros2.decoder").DecoderFactory()
    decode = factory.decoder_for(channel.message_encoding, schema)
    return lambda data: plain(decode(data))
