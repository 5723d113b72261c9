"""Messages of robots as a table: joints by name, and the stamp of a header in one column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from servo_models.data.readers.columns import Source, column_of, columns_of, unicode_of

if TYPE_CHECKING:
    import polars as pl

LISTS_OF_NAMES = ("name", "joint_names")  # fields that name the joints of other lists
HEADER_STAMP = "header_stamp"


def message_columns(
    source: Source, times: Mapping[str, Sequence[int]], records: Sequence[Any], first: int
) -> tuple[list[pl.Series], dict[str, str]]:
    """Return the columns of a topic, and their names by what else they are called.

    A list that has as many items as the message names joints is a column for each of these,
    ``position.elbow``, whatever their order in a message; it is called ``position[2]`` as well if
    that is the same in all.  ``header_stamp`` is where a header has one.

    Args:
        times: times of the messages [ns], such as that of their arrival, by name.
        records: the messages, as dictionaries, lists and scalars.
        first: time that is subtracted from every time [ns].
    """
    columns = [column_of(name, [time - first for time in own]) for name, own in times.items()]
    stamps = [_stamp(record) for record in records]
    if any(stamps):
        since = [None if stamp is None else stamp - first for stamp in stamps]
        columns.append(column_of(HEADER_STAMP, since))
    orders = {_names(record) for record in records}
    aliases: dict[str, str] = {}
    named = [_by_name(record, _names(record), "", aliases) for record in records]
    return columns + columns_of(source, named), aliases if len(orders) == 1 else {}


def plain(value: Any) -> Any:
    """Return a message of ROS 2, as either library has it, as dictionaries, lists and scalars."""
    fields = getattr(value, "__dataclass_fields__", None) or getattr(value, "__slots__", None)
    if fields is not None:
        return {name: plain(getattr(value, name)) for name in fields if name != "__msgtype__"}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _stamp(record: Any) -> int | None:
    """The stamp of a header [ns], None where there is none."""
    header = record.get("header") if isinstance(record, dict) else None
    stamp = header.get("stamp") if isinstance(header, dict) else None
    if not isinstance(stamp, dict):
        return None
    seconds, rest = stamp.get("sec"), stamp.get("nanosec", stamp.get("nsec"))
    if not (isinstance(seconds, int | float) and isinstance(rest, int | float)):
        return None
    return 10**9 * int(seconds) + int(rest)


def _names(record: Any) -> tuple[str, ...]:
    """Names of the joints of a message, () where there are none or two are alike."""
    for key in LISTS_OF_NAMES:
        names = record.get(key) if isinstance(record, dict) else None
        if isinstance(names, list) and all(isinstance(name, str) for name in names):
            return tuple(map(unicode_of, names)) if len(set(names)) == len(names) else ()
    return ()


def _by_name(value: Any, names: tuple[str, ...], place: str, aliases: dict[str, str]) -> Any:
    """A message with its lists of joints by name; ``aliases`` are added to."""
    if isinstance(value, dict):
        return {
            key: inner
            if key in LISTS_OF_NAMES
            else _by_name(inner, names, f"{place}.{key}" if place else str(key), aliases)
            for key, inner in value.items()
        }
    if not names or not isinstance(value, list) or len(value) != len(names):
        return value
    if not all(isinstance(item, int | float) for item in value):
        return value
    aliases.update({f"{place}[{i}]": f"{place}.{name}" for i, name in enumerate(names)})
    return dict(zip(names, value))
