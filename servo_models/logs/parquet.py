"""Parquet files."""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator

from servo_models.files import check_size
from servo_models.logs.columns import Source, Tables

SUFFIXES = (".parquet",)
NUMBER = 8  # bytes


def read(source: Source) -> Tables:
    """Read a Parquet file.

    Raises:
        UserError: it is damaged.
    """
    import polars as pl

    source.wanted([""])
    try:
        with _no_stack():
            columns = len(pl.read_parquet_schema(io.BytesIO(source.content)))
            rows = pl.scan_parquet(io.BytesIO(source.content)).select(pl.len()).collect().item()
            check_size(source.path, float(rows) * columns * NUMBER)
            return Tables({"": pl.read_parquet(io.BytesIO(source.content)).get_columns()})
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise source.damaged("Parquet") from error


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
