"""JSON files: a list of records, lists of numbers by name, or one record a line.

A list of records may stand anywhere in the file, beside what else was noted there; its
place, such as ``entries``, is the name of the table.  Rows count from 1.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from servo_models.data.readers.columns import Source, Tables, column_of, columns_of
from servo_models.errors import UserError

if TYPE_CHECKING:
    import polars as pl

SUFFIXES = (".json", ".jsonl", ".ndjson")
OF_LINES = SUFFIXES[1:]  # suffixes of files with a record a line


def read(source: Source) -> Tables:
    """Read a JSON file; one record a line is recognised whatever the file is called."""
    try:
        text = source.content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise source.damaged("JSON") from error
    if source.path.suffix.lower() in OF_LINES:
        return _lines(source, text)
    try:
        document = _parsed(source, text)
    except UserError:
        if _is_a_line(text):
            return _lines(source, text)
        raise
    lists = dict(_lists("", document))
    records = {name: found for name, found in lists.items() if _are_records(found)}
    if records:
        return Tables({name: columns_of(source, records[name]) for name in source.wanted(records)})
    source.wanted([""])
    if not lists:
        raise UserError(
            f"'{source.path}' holds no records: give a list of objects, or lists by name"
        )
    return Tables({"": [one for name in lists for one in _columns(source, name, lists[name])]})


def _parsed(source: Source, text: str, row: int = 1) -> Any:
    try:
        return json.loads(text, parse_int=float)
    except json.JSONDecodeError as error:
        raise UserError(
            f"'{source.path}', row {row + error.lineno - 1}: no JSON, {error.msg}; write it again"
        ) from error
    except RecursionError as error:
        raise UserError(f"'{source.path}' is nested too deeply: give a list of records") from error


def _is_a_line(text: str) -> bool:
    """Whether the first line of a text is JSON by itself, and more follows."""
    first, _, more = text.partition("\n")
    try:
        json.loads(first)
    except (json.JSONDecodeError, RecursionError):
        return False
    return bool(more.strip())


def _lines(source: Source, text: str) -> Tables:
    """The records of a text that has one a line."""
    source.wanted([""])
    records = []
    for row, line in enumerate(text.rstrip().split("\n") if text.strip() else [], start=1):
        if not line.strip():
            raise UserError(f"'{source.path}', row {row} is empty: remove it")
        records.append(_parsed(source, line, row))
        if not isinstance(records[-1], dict | list | type(None)):
            raise UserError(f"'{source.path}', row {row}: no record; give an object a line")
    return Tables({"": columns_of(source, records)})


def _columns(source: Source, name: str, values: list[Any]) -> list[pl.Series]:
    """A list as a column, or as several where there are lists or objects in it."""
    if any(isinstance(value, dict | list) for value in values):
        return columns_of(source, values, name)
    return [column_of(name, values)]


def _lists(name: str, value: Any) -> Iterator[tuple[str, list[Any]]]:
    """Every list by its dotted place, not those inside of lists."""
    if isinstance(value, list):
        yield name, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _lists(f"{name}.{key}" if name else key, inner)


def _are_records(items: list[Any]) -> bool:
    kinds = {type(item) for item in items}
    return dict in kinds and kinds <= {dict, type(None)}
