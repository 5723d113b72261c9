"""MDF4 files of ASAM: the channels of one raster are a table, called like their channel group.

A further group of that name is called ``name.1``, ``name.2`` and so on, one without a name
``group``.  Times stand in ``time [s]``.  A channel has its unit behind its name, ``angle [deg]``,
and is called ``angle`` as well.  Values are physical, invalid ones are empty cells; items of an
array are columns, ``field[0]``, and texts are left out.  Rows count from 1.
"""

from __future__ import annotations

import contextlib
import gc
import io
import logging
import sys
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.data.readers.columns import NUMBER, Source, Tables, array_column
from servo_models.errors import extra
from servo_models.files import check_size

if TYPE_CHECKING:
    import polars as pl

SUFFIXES = (".mf4",)
BEGINNINGS = (b"MDF     4", b"UnFinMF 4")
TIME = "time [s]"
TIMES = 1  # kind of a master channel whose values are times in s
BLOCK = b"##"  # with which every block begins
READS_PER_BLOCK = 100  # reads of a file while it is opened, at most; some 5 are needed
NUMBERS = range(6)  # types of channels that hold integers or floats


def read(source: Source) -> Tables:
    """Read an MDF4 file."""
    asammdf = extra("mdf", "asammdf")
    if source.content.startswith(BEGINNINGS):
        with _silence(), source.read_by_library("MDF4"):
            stream = _Stream(source.content)
            with asammdf.MDF(stream, process_bus_logging=False) as file:
                stream.left = sys.maxsize
                return _tables(source, file)
    raise source.damaged("MDF4")


class _Stream(io.BytesIO):
    """A file that is read ``left`` times at most: a damaged chain of blocks may have no end."""

    def __init__(self, content: bytes) -> None:
        super().__init__(content)
        self.left = READS_PER_BLOCK * (1 + content.count(BLOCK))

    def read(self, size: int | None = -1) -> bytes:
        self.left -= 1
        if self.left < 0:
            raise EOFError
        return super().read(size)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Keep back what asammdf says of damaged blocks, and when a file goes that it did not open."""
    log, hook = logging.getLogger("asammdf"), sys.unraisablehook
    log.disabled = True
    sys.unraisablehook = lambda _: None
    try:
        yield
    finally:
        gc.collect()
        sys.unraisablehook = hook
        log.disabled = False


def _tables(source: Source, file: Any) -> Tables:
    rasters: dict[str, int] = {}
    again: Counter[str] = Counter()
    for number in file.virtual_groups:
        name = of = file.groups[number].channel_group.acq_name or "group"
        while name in rasters:
            again[of] += 1
            name = f"{of}.{again[of]}"
        rasters[name] = number
    parts: dict[str, tuple[list[pl.Series], dict[str, str]]] = {}
    size = 0
    for name in source.wanted(rasters):
        raster = file.virtual_groups[rasters[name]]
        places = [
            (group, place)
            for group in raster.groups
            for place, channel in enumerate(file.groups[group].channels)
            if channel.data_type in NUMBERS and not file.groups[group].channel_dependencies[place]
        ]
        size += NUMBER * raster.cycles_nr * len(places)
        check_size(source.path, size)
        for group, place in places[-1:]:  # ``select`` would make up the rows that lack
            last = file.get(group=group, index=place, raw=True, ignore_invalidation_bits=True)
            if len(last) != raster.cycles_nr:
                raise source.damaged("MDF4")
        parts[name] = _columns(file, places)
    return Tables.of(parts)


def _columns(file: Any, places: list[tuple[int, int]]) -> tuple[list[pl.Series], dict[str, str]]:
    """The columns of channels, and their names by those without a unit."""
    import polars as pl

    columns: list[pl.Series] = []
    aliases: dict[str, str] = {}
    chosen = [(None, *place) for place in places]
    signals = file.select(chosen, copy_master=False, ignore_value2text_conversions=True)
    for (group, place), signal in zip(places, signals):
        channel = file.groups[group].channels[place]
        is_time = channel.sync_type == TIMES and file.masters_db.get(group) == place
        unit = f" [{signal.unit}]" if signal.unit else ""
        name = aliases[channel.name] = TIME if is_time else channel.name + unit
        column = array_column(name, signal.samples.astype(np.float64))
        if signal.invalidation_bits is not None:
            column = column.set(pl.Series(np.asarray(signal.invalidation_bits)), None)
        columns.append(column)
    return columns, aliases
