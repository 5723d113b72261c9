"""JSON files: a list of records, or lists of numbers by name.

A list of records may stand anywhere in the file, beside what else was noted there; its
place, such as ``entries``, is the name of the table.  Rows count from 1.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from servo_models.data.readers.columns import Source, Tables, column_of, columns_of
from servo_models.errors import UserError

SUFFIXES = (".json",)


def read(source: Source) -> Tables:
    """Read a JSON file.

    Raises:
        UserError: no JSON, or neither records nor lists in it.
    """
    try:
        document = json.loads(source.content, parse_int=float)
    except UnicodeDecodeError as error:
        raise source.damaged("JSON") from error
    except RecursionError as error:
        raise UserError(f"'{source.path}' is nested too deeply: give a list of records") from error
    except json.JSONDecodeError as error:
        raise UserError(
            f"'{source.path}', row {error.lineno}: no JSON, {error.msg}; write it again"
        ) from error
    lists = dict(_lists("", document))
    records = {name: found for name, found in lists.items() if _are_records(found)}
    if records:
        return Tables({name: columns_of(source, records[name]) for name in source.wanted(records)})
    source.wanted([""])
    if not lists:
        raise UserError(
            f"'{source.path}' holds no records: give a list of objects, or lists by name"
        )
    return Tables({"": [column_of(name, found) for name, found in lists.items()]})


def _lists(name: str, value: Any) -> Iterator[tuple[str, list[Any]]]:
    """Every list by its dotted place, not those inside of lists."""
    if isinstance(value, list):
        yield name, value
    elif isinstance(value, dict):
        for key, inner in value.items():
            yield from _lists(f"{name}.{key}" if name else key, inner)


def _are_records(found: list[Any]) -> bool:
    kinds = {type(item) for item in found}
    return dict in kinds and kinds <= {dict, type(None)}
