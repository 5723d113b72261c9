"""Parquet files: an item of a list is a column, an episode of a LeRobot data set is a table."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from servo_models.data.readers.columns import NUMBER, Source, Tables, no_stack
from servo_models.data.readers.lerobot import OF_FRAMES, read_info, root_of
from servo_models.files import check_size

if TYPE_CHECKING:
    import polars as pl

SUFFIXES = (".parquet",)
MOST_ITEMS = 64  # mean length of a list of joints, at most: a longer one is a scan or an image
FOOTER = 8  # bytes at the end of a file: the size of its description, and "PAR1"


def read(source: Source) -> Tables:
    """Read a Parquet file; what is nested deeper than in lists of numbers stays in its cells."""
    import polars as pl

    try:
        with no_stack():
            types = pl.read_parquet_schema(io.BytesIO(source.content))
            rows = pl.scan_parquet(io.BytesIO(source.content)).select(pl.len()).collect().item()
            check_size(source.path, float(rows) * len(types) * NUMBER)
            short = _short_lists(source.content, types, rows)
            flat = [name for name, dtype in types.items() if not dtype.is_nested() or name in short]
            frame = pl.read_parquet(io.BytesIO(source.content), columns=flat)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise source.damaged("Parquet") from error
    names = read_info(root_of(source.path)).names if short else {}
    aliases: dict[str, str] = {}
    columns: list[pl.Series] = []
    nested = pl.Series([], dtype=pl.List(pl.Null)).extend_constant(None, rows)
    for name in types:
        if name in short:
            items = _items(source, frame[name])
            item_names = names.get(name, ())
            if len(item_names) == len(items):
                aliases |= {item.name: f"{name}.{it}" for item, it in zip(items, item_names)}
            columns += [item.alias(aliases.get(item.name, item.name)) for item in items]
        else:
            columns.append(frame[name] if name in flat else nested.alias(name))
    if not OF_FRAMES.issubset(types):
        source.wanted([""])
        return Tables({"": columns}, aliases=aliases)
    return _by_episode(source, columns, frame["episode_index"], aliases)


def _by_episode(
    source: Source, columns: list[pl.Series], episode: pl.Series, aliases: Mapping[str, str]
) -> Tables:
    """The frames of each episode; rows count from 0, as ``frame_index`` does."""
    numbers = [number for number in episode.unique().sort().to_list() if number is not None]
    tables = {f"episode {number}": number for number in numbers}
    if not tables:
        return Tables({"": columns}, 0, aliases)
    wanted = source.wanted(tables)
    return Tables(
        {name: [it.filter(episode == tables[name]) for it in columns] for name in wanted},
        0,
        aliases,
    )


def _items(source: Source, lists: pl.Series) -> list[pl.Series]:
    """A column of lists as a column for each item, ``action[0]``, empty where a list is shorter."""
    import polars as pl

    lists = lists.cast(pl.List(lists.dtype.inner))  # type: ignore[attr-defined]
    longest = int(lists.list.len().max() or 0)  # type: ignore[arg-type]
    check_size(source.path, float(len(lists)) * longest * NUMBER)
    return [lists.list.get(i, null_on_oob=True).alias(f"{lists.name}[{i}]") for i in range(longest)]


def _short_lists(content: bytes, types: Mapping[str, Any], rows: int) -> set[str]:
    """Columns of lists of numbers, of no more than ``MOST_ITEMS`` in the mean."""
    import polars as pl

    inner = {n: it.inner for n, it in types.items() if isinstance(it, pl.List | pl.Array)}
    lists = {name for name, of in inner.items() if of.is_numeric()}
    if not lists:
        return set()
    items = _items_in_all(content)
    return {name for name in lists if items.get(name, math.inf) <= MOST_ITEMS * rows}


def _items_in_all(content: bytes) -> dict[str, int]:
    """Numbers in the whole of a column, by its name, as the end of a file tells without unpacking.

    Source: Apache Parquet, parquet.thrift: FileMetaData.row_groups (4), RowGroup.columns (1),
    ColumnChunk.meta_data (3), ColumnMetaData.path_in_schema (3) and num_values (5).
    """
    size = int.from_bytes(content[-FOOTER:-4], "little")
    stream = io.BytesIO(content[-FOOTER - size : -FOOTER])
    items: dict[str, int] = {}
    try:
        for group in _struct(stream)[4]:
            for chunk in group[1]:
                name = chunk[3][3][0].decode()
                items[name] = items.get(name, 0) + chunk[3][5]
    except (LookupError, TypeError, AttributeError, UnicodeError, RecursionError):
        return {}  # a damaged end, which polars did not look at
    return items


def _struct(stream: io.BytesIO) -> dict[int, Any]:
    """Fields of a structure by number.

    Source: Apache Thrift, compact protocol encoding.
    """
    fields: dict[int, Any] = {}
    number = 0
    while (head := stream.read(1)[0]) != 0:
        number = number + (head >> 4) if head >> 4 else _whole(stream)
        fields[number] = _value(stream, head & 15)
    return fields


def _value(stream: io.BytesIO, kind: int) -> Any:
    if kind in (1, 2):
        return kind == 1
    if kind == 3:
        return stream.read(1)
    if kind in (4, 5, 6):
        return _whole(stream)
    if kind == 7:
        return stream.read(8)
    if kind == 8:
        return stream.read(_natural(stream))
    if kind in (9, 10):
        head = stream.read(1)[0]
        count = head >> 4 if head >> 4 < 15 else _natural(stream)
        of_bytes = head & 15 in (1, 2)  # a flag of a list is a byte
        return [_value(stream, 3 if of_bytes else head & 15) for _ in range(count)]
    return _struct(stream)


def _natural(stream: io.BytesIO) -> int:
    value = shift = 0
    while True:
        byte = stream.read(1)[0]
        value |= (byte & 127) << shift
        if byte < 128:
            return value
        shift += 7


def _whole(stream: io.BytesIO) -> int:
    """A number with its sign in the last bit."""
    value = _natural(stream)
    return (value >> 1) ^ -(value & 1)
