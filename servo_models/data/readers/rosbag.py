"""Bags of ROS 2, in MCAP or sqlite3, with ``metadata.yaml`` or as one ``.db3``: a topic is a table.

Besides the fields of its messages a table has ``log_time``, when a message arrived, and
``header_stamp`` if it has a header, in ns since the first message.  Rows count from 1.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from servo_models.data.readers.columns import Source, Tables
from servo_models.data.readers.ros import message_columns, plain
from servo_models.errors import UserError, extra
from servo_models.files import check_size

SUFFIXES = (".db3",)
FOLDER = "metadata.yaml"  # file by which a folder is a bag
LARGEST_MESSAGE = 16 << 10  # bytes of a message; larger ones (images, scans) are read if asked for


def read(source: Source) -> Tables:
    """Read a bag."""
    rosbags, stores = extra("ros", "rosbags.highlevel"), extra("ros", "rosbags.typesys")
    usual = stores.get_typestore(stores.Stores.LATEST)
    with (
        source.read_by_library(
            "ROS 2",
            "damaged, cut short or no bag of {}: 'ros2 bag reindex' mends metadata.yaml and 'mcap"
            " recover' an .mcap, or record it again",
        ),
        rosbags.AnyReader([Path(source.path)], default_typestore=usual) as bag,
    ):
        return _tables(source, bag)


def _tables(source: Source, bag: Any) -> Tables:
    size = 0
    times: dict[str, list[int]] = {}
    records: dict[str, list[Any]] = {}
    unknown: dict[str, str] = {}
    large = ""
    wanted = [it for it in bag.connections if source.table in (None, it.topic)]
    first = min(bag.start_time, 2**63 - 1)
    for connection, arrived, raw in bag.messages(connections=wanted) if wanted else ():
        topic = connection.topic
        if source.table is None and len(raw) > LARGEST_MESSAGE:
            large = topic
            continue
        if topic in unknown:
            continue
        size += len(raw)
        check_size(source.path, size)
        try:
            message = bag.deserialize(raw, connection.msgtype)
        except KeyError:
            unknown[topic] = connection.msgtype
            continue
        times.setdefault(topic, []).append(arrived)
        records.setdefault(topic, []).append(plain(message))
    if source.table in unknown:
        raise UserError(
            f"{source.place}: the bag does not describe its type '{unknown[source.table]}': record"
            " it as MCAP"
        )
    if large and not records:
        raise UserError(
            f"'{source.path}' has messages above {LARGEST_MESSAGE >> 10} kB only: name their topic"
            f" in a description, as table = '{large}'"
        )
    known = dict.fromkeys([*records, *(it.topic for it in bag.connections)])
    names = [name for name in source.wanted(known) if name in records or source.table]
    return Tables.of(
        {
            name: message_columns(
                source, {"log_time": times.get(name, [])}, records.get(name, []), first
            )
            for name in names
        }
    )
