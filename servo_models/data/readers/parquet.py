"""Parquet files."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator

from servo_models.data.readers.columns import NUMBER, Source, Tables
from servo_models.files import check_size

SUFFIXES = (".parquet",)


def read(source: Source) -> Tables:
    """Read a Parquet file; what is nested in its cells stays there.

    Raises:
        UserError: it is damaged.
    """
    import polars as pl

    source.wanted([""])
    try:
        with _no_stack():
            types = pl.read_parquet_schema(io.BytesIO(source.content))
            rows = pl.scan_parquet(io.BytesIO(source.content)).select(pl.len()).collect().item()
            check_size(source.path, float(rows) * len(types) * NUMBER)
            flat = [name for name, dtype in types.items() if not dtype.is_nested()]
            frame = pl.read_parquet(io.BytesIO(source.content), columns=flat)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise source.damaged("Parquet") from error
    nested = pl.Series([], dtype=pl.List(pl.Null)).extend_constant(None, rows)
    return Tables({"": [frame[name] if name in flat else nested.alias(name) for name in types]})


@contextlib.contextmanager
def _no_stack() -> Iterator[None]:
    """Keep from standard error what polars prints there, past Python, before it raises."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no standard error
        yield
        return
    try:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 2)
        os.close(silent)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
