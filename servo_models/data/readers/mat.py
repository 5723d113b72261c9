"""MAT files of MATLAB, v4 to v7 and v7.3.

A vector is a column, and so is each vector along the longer side of a matrix, named as in MATLAB:
``data(:,2)``.  Fields of structures are named by dots.  Rows count from 1.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.data.readers.columns import NUMBER, Source, Tables, array_column
from servo_models.errors import UserError, extra
from servo_models.files import check_size

if TYPE_CHECKING:
    import polars as pl

SUFFIXES = (".mat",)
VERSION_73 = b"MATLAB 7.3"
VERSION_4 = 0  # major version that scipy tells of a file of MATLAB 4
HEADER = 128  # bytes of the header of a file
TAG = 8  # bytes of the tag of an element
COMPRESSED = 15  # type of a compressed element


def read(source: Source) -> Tables:
    """Read a MAT file."""
    source.wanted([""])
    read_ = _read_73 if source.content.startswith(VERSION_73) else _read_5
    with source.read_by_library("MAT"):
        values = read_(source)
    columns = [column for name, value in values for column in _columns(name, value)]
    if not columns:
        raise UserError(
            f"'{source.path}' has no vector of numbers: save arrays or a struct of them,"
            " no table or timeseries"
        )
    return Tables({"": columns})


def _read_5(source: Source) -> list[tuple[str, Any]]:
    import scipy.io

    if scipy.io.matlab.matfile_version(io.BytesIO(source.content))[0] != VERSION_4:
        _check_unpacked(source)
    whole = scipy.io.whosmat(io.BytesIO(source.content))
    check_size(source.path, NUMBER * sum(float(np.prod(shape)) for _, shape, _ in whole))
    return list(scipy.io.loadmat(io.BytesIO(source.content), simplify_cells=True).items())


def _check_unpacked(source: Source) -> None:
    """Refuse variables that unpack to too much: structures hide how large they are.

    Source: MathWorks, MAT-File Format, version 5: what a compressed element unpacks to begins with
    a tag that tells its size.
    """
    content, at, size = source.content, HEADER, 0
    order = "<II" if content[HEADER - 2 : HEADER] == b"IM" else ">II"
    while at + TAG <= len(content):
        kind, length = struct.unpack_from(order, content, at)
        packed = content[at + TAG : at + TAG + length]
        at += TAG + length
        if kind != COMPRESSED:
            at += -length % TAG
            continue
        told = struct.unpack(order, zlib.decompressobj().decompress(packed, TAG))[1] + TAG
        size += told
        check_size(source.path, size)
        if len(zlib.decompressobj().decompress(packed, told + 1)) > told:
            raise source.damaged("MAT")


def _read_73(source: Source) -> list[tuple[str, Any]]:
    h5py = extra("mat73", "h5py")
    sizes = []

    def members(group: Any) -> dict[str, Any]:
        links = {key: group.get(key, getlink=True) for key in group if key != "#refs#"}
        for key, link in links.items():
            if isinstance(link, h5py.ExternalLink):
                raise _elsewhere(source, key)
        return {key: value(group[key]) for key in links}

    def value(item: Any) -> Any:
        if isinstance(item, h5py.Group):
            return members(item)
        if item.external or item.is_virtual:
            raise _elsewhere(source, item.name)
        sizes.append(float(item.size) * item.dtype.itemsize)
        check_size(source.path, sum(sizes))
        if item.attrs.get("MATLAB_class") == b"char":
            return None
        return np.squeeze(item[()].T)  # MATLAB counts by columns, HDF5 by rows

    with h5py.File(io.BytesIO(source.content)) as file:
        return list(members(file).items())


def _elsewhere(source: Source, name: str) -> UserError:
    return UserError(
        f"'{source.path}': '{name}' stands in another file; save the values in this one"
    )


def _columns(name: str, value: Any) -> Iterator[pl.Series]:
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _columns(f"{name}.{key}", inner)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        if value.ndim == 1:
            yield array_column(name, value)
        elif value.ndim == 2:
            long_first = value.shape[0] >= value.shape[1]
            for i, vector in enumerate(value.T if long_first else value, start=1):
                yield array_column(f"{name}(:,{i})" if long_first else f"{name}({i},:)", vector)
