"""Dates and times of a column as seconds: ISO 8601 texts, and the types of files that have them."""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError

if TYPE_CHECKING:
    import polars as pl

TIME = r"(?P<hour>\d\d):(?P<minute>\d\d)(?::(?P<second>\d\d)(?:[.,](?P<part>\d+))?)?"
BASIC_TIME = r"(?P<hour>\d\d)(?P<minute>\d\d)(?:(?P<second>\d\d)(?:[.,](?P<part>\d+))?)?"
DATE = r"(?P<year>\d{4})-(?P<month>\d\d)-(?P<day>\d\d)[T ]"
BASIC_DATE = r"(?P<year>\d{4})(?P<month>\d\d)(?P<day>\d\d)T"
ZONE = r"\s*(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?"
WRITTEN = tuple(
    re.compile(f"{form}{ZONE}", re.IGNORECASE | re.ASCII)
    for form in (f"(?:{DATE})?{TIME}", f"{BASIC_DATE}{BASIC_TIME}")
)
"""Forms of a time: the extended format, with or without a date, and the basic one."""
OTHER_DATE = re.compile(
    r"(?:\d{4}([./-])\d\d?\1\d\d?|\d\d?([./-])\d\d?\2(?:\d{4}|\d\d))(?![\d./-])", re.ASCII
)
"""Beginning of a date in another form, ``01.05.2024`` or ``5/1/2024``."""
EXAMPLE = "2024-05-01T12:00:00"
NANOSECONDS = 10**9  # nanoseconds in a second
DAY = 86400  # seconds in a day
KEPT = ("zone", "part")  # parts of a time whose text is no number of its own


def seconds(cells: pl.Series, where: Callable[[int], str]) -> Array | None:
    """Return times as seconds since 1970, or since midnight without a date; None for no times.
    ``where`` says in words which row it is, counted from 0.

    What the first cell is decides; all have to be written in the zone of that one.

    Raises:
        UserError: a cell that is empty or no time, or is of another zone.
    """
    import polars as pl

    if isinstance(cells.dtype, pl.Datetime):
        if cells.null_count():
            raise _empty(where(int(cells.is_null().arg_max() or 0)))
        return _exact(cells.dt.timestamp("ns").to_numpy())
    if cells.dtype != pl.String or not len(cells):
        return None
    if _parts(_bare(cells[0])) is None:
        return None
    texts = [_bare(text) for text in cells.to_list()]
    return _exact(np.array(_nanoseconds(texts, where), dtype=np.int64))


def is_time(text: str) -> bool:
    """Return whether a text is a date or a time of day, in a form that is read or another one."""
    return bool(OTHER_DATE.match(text)) or _parts(text) is not None


def _bare(text: str | None) -> str:
    return (text or "").strip(' \t"')


def _exact(nanoseconds: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Array:
    """Seconds, rounded once."""
    whole, rest = np.divmod(nanoseconds, NANOSECONDS)
    return np.asarray(whole + rest / NANOSECONDS, dtype=np.float64)


def _nanoseconds(texts: list[str], where: Callable[[int], str]) -> list[int]:
    first = _parts(texts[0]) or {}
    nanoseconds = []
    for row, text in enumerate(texts):
        parts = _parts(text)
        if not text:
            raise _empty(where(row))
        if parts is None or bool(parts["year"]) != bool(first["year"]):
            raise UserError(
                f"{where(row)}: '{text[:60]}' is no date and time as '{texts[0]}' is; correct it"
            )
        try:
            nanoseconds.append(_since(parts))
        except ValueError as error:
            raise UserError(
                f"{where(row)}: '{text}' is no date and time, {error}; correct it"
            ) from error
        if _offset(parts["zone"]) != _offset(first["zone"]):
            raise UserError(
                f"{where(row)}: '{text}' is of another zone than the first time, '{texts[0]}':"
                " write all times in one zone"
            )
    return nanoseconds


def _parts(text: str) -> dict[str, str | None] | None:
    """The parts of a time by name, None where a text is none."""
    matches = (form.fullmatch(text) for form in WRITTEN)
    return next((match.groupdict() for match in matches if match), None)


def _since(parts: dict[str, str | None]) -> int:
    """Nanoseconds since 1970 in UTC, or since midnight.

    Raises:
        ValueError: a part that no calendar or clock has.
    """
    told: dict[str, Any] = {
        name: int(text) for name, text in parts.items() if text and name not in KEPT
    }
    time = datetime.datetime(**({"year": 1970, "month": 1, "day": 1} | told))
    whole = (time - datetime.datetime(1970, 1, 1)) // datetime.timedelta(seconds=1)
    part = int((parts["part"] or "").ljust(9, "0")[:9])
    return (whole - (_offset(parts["zone"]) or 0)) * NANOSECONDS + part


def _offset(zone: str | None) -> int | None:
    """Seconds by which a zone is ahead of UTC; None for no zone."""
    if zone is None or zone in "Zz":
        return None if zone is None else 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    ahead = int(digits[:2]) * 3600 + int(digits[2:]) * 60
    return -ahead if zone[0] == "-" else ahead


def _empty(place: str) -> UserError:
    return UserError(f"{place} is empty: fill the gap or remove the row")
