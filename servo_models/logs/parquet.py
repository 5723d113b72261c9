"""Parquet files."""

from __future__ import annotations

import io

from servo_models.logs.columns import Source, Tables

SUFFIXES = (".parquet",)


def read(source: Source) -> Tables:
    """Read a Parquet file.

    Raises:
        UserError: it is damaged.
    """
    import polars as pl

    source.wanted([""])
    try:
        return Tables({"": pl.read_parquet(io.BytesIO(source.content)).get_columns()})
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise source.damaged("Parquet") from error
