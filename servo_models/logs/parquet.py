"""Parquet files."""

from __future__ import annotations

import io

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
        columns = len(pl.read_parquet_schema(io.BytesIO(source.content)))
        rows = pl.scan_parquet(io.BytesIO(source.content)).select(pl.len()).collect().item()
        check_size(source.path, float(rows) * columns * NUMBER)
        return Tables({"": pl.read_parquet(io.BytesIO(source.content)).get_columns()})
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise source.damaged("Parquet") from error
