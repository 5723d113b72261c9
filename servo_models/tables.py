"""Tables of signals in CSV or Parquet files: units at the border, every fault with its row.

One column ``time`` and one per signal.  A header is a name, ``voltage``, with values in SI,
or a name and a unit, ``pulse_width [us]``.  Numbers are written with a decimal point and
columns are separated by commas, whatever the country of the machine.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.actuator import Plant, Wire, unknown
from servo_models.errors import UserError
from servo_models.files import write_with
from servo_models.units import factor

if TYPE_CHECKING:
    import polars as pl

Array = NDArray[np.float64]

TIME = Wire("time", "s", "time of the row")
SUFFIXES = (".csv", ".parquet")
CSV_OFFSET = 2
"""An editor calls the header row 1, so the first row of numbers is row 2."""
PARQUET_OFFSET = 1


def read_inputs(path: Path, plant: Plant) -> tuple[Array, dict[str, Array]]:
    """Read what to feed an actuator with.

    Columns of its outputs may stand in the file, as in one that a simulation wrote, and
    are left out.

    Returns:
        times [s] of shape (n,), and SI values of shape (n,) by name of the input.

    Raises:
        UserError: see ``read_signals``; or no input among the columns.
    """
    outputs = [plant.wire[name] for name in plant.outputs]
    times, signals = read_signals(path, (*plant.inputs, *outputs))
    names = [wire.name for wire in plant.inputs]
    found = {name: signals[name] for name in names if name in signals}
    if not found:
        raise UserError(f"'{path}' has no column for an input: add one of {', '.join(names)}")
    return times, found


def read_signals(path: Path, wires: Sequence[Wire]) -> tuple[Array, dict[str, Array]]:
    """Read times and signals from a ``.csv`` or ``.parquet`` file.

    Args:
        path: the file.
        wires: signals that may stand in it.

    Returns:
        times [s] of shape (n,), which never run backward, and SI values of shape (n,) by
        name of the signal.

    Raises:
        UserError: a file that is missing, damaged or empty; an unknown, repeated or missing
            column, a unit that does not convert; a cell that is empty, no number or not
            finite; time that runs backward.  It names the file, the row and the column.
    """
    check_suffix(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise UserError(f"cannot read '{path}': {error.strerror or error}") from error
    if path.suffix.lower() == ".csv":
        frame, offset = _csv_frame(path, content), CSV_OFFSET
    else:
        frame, offset = _parquet_frame(path, content), PARQUET_OFFSET
    known = {wire.name: wire for wire in (TIME, *wires)}
    columns: dict[str, Array] = {}
    for header in frame.columns:
        name, scale = _heading(path, header, known)
        if name in columns:
            raise UserError(f"'{path}' has two columns '{name}': remove one")
        columns[name] = scale * _numbers(path, frame[header], offset)
    if "time" not in columns:
        raise UserError(f"'{path}' has no column 'time': add one, in seconds")
    if frame.height == 0:
        raise UserError(f"'{path}' has a header but no rows: add at least one")
    times = columns.pop("time")
    _check_order(path, times, offset)
    return times, columns


def write_signals(
    path: Path, times: Array, signals: Mapping[str, Array], wires: Mapping[str, Wire]
) -> None:
    """Write times [s] and signals (SI), each of shape (n,), to a ``.csv`` or ``.parquet`` file.

    ``read_signals`` gives the same numbers back, to the last bit.

    Raises:
        UserError: another kind of file, or a folder that cannot be written.
    """
    import polars as pl

    check_suffix(path)
    named = {"time": (TIME, times)} | {name: (wires[name], signals[name]) for name in signals}
    frame = pl.DataFrame({_header(wire): values for wire, values in named.values()})
    if path.suffix.lower() == ".csv":
        write_with(path, frame.write_csv)
    else:
        write_with(path, frame.write_parquet)


def check_suffix(path: Path) -> None:
    """Raise UserError unless ``path`` names a kind of table that we read and write."""
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(f"'{path}' is no table: use a name that ends in {' or '.join(SUFFIXES)}")


def _header(wire: Wire) -> str:
    return wire.name if wire.unit == "1" else f"{wire.name} [{wire.unit}]"


def _heading(path: Path, header: str, known: Mapping[str, Wire]) -> tuple[str, float]:
    """Name of a column, and the factor that brings its values to SI."""
    match = re.fullmatch(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]+?)\s*\])?\s*", header)
    if not match:
        raise UserError(f"'{path}', column '{header}': write it as 'name' or 'name [unit]'")
    name, unit = match.groups()
    if name not in known:
        raise UserError(f"'{path}': {unknown('column', name, known)}")
    try:
        return name, factor(unit, known[name].unit) if unit else 1.0
    except UserError as error:
        raise UserError(f"'{path}', column '{name}': {error}") from error


def _csv_frame(path: Path, content: bytes) -> pl.DataFrame:
    """Cells of a CSV file as text, one row of the frame per row of the file."""
    import polars as pl

    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        raise UserError(
            f"'{path}', row {row}: byte 0x{content[error.start]:02x} is not UTF-8;"
            " save the file as CSV UTF-8"
        ) from error
    lines = text.rstrip().replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines == [""]:
        raise UserError(f"'{path}' is empty: it needs a header with 'time' and one input")
    headers = [header.strip(' "') for header in lines[0].split(",")]
    if len(headers) == 1 and re.search("[;\t]", lines[0]):
        raise UserError(f"'{path}', row 1: separate columns by commas, decimals by a point")
    if len(set(headers)) < len(headers):
        twice = next(header for header in headers if headers.count(header) > 1)
        raise UserError(f"'{path}' has two columns '{twice}': remove one")
    for row, line in enumerate(lines, start=1):
        if not line.strip():
            raise UserError(f"'{path}', row {row} is empty: remove it")
        if line.count(",") != len(headers) - 1:
            raise UserError(
                f"'{path}', row {row} has {line.count(',') + 1} cells, the header"
                f" {len(headers)}: give every row as many; decimals take a point"
            )
    if len(lines) == 1:
        return pl.DataFrame(schema=dict.fromkeys(headers, pl.String))
    return pl.read_csv(
        io.StringIO("\n".join(lines[1:])),
        has_header=False,
        new_columns=headers,
        infer_schema=False,
        quote_char=None,
    )


def _parquet_frame(path: Path, content: bytes) -> pl.DataFrame:
    import polars as pl

    try:
        return pl.read_parquet(io.BytesIO(content))
    except pl.exceptions.PolarsError as error:
        raise UserError(f"'{path}' is damaged or no Parquet file: write it again") from error


def _numbers(path: Path, cells: pl.Series, offset: int) -> Array:
    """Cells of one column as finite floats, shape (n,)."""
    import polars as pl

    if not (cells.dtype.is_numeric() or cells.dtype in (pl.String, pl.Boolean)):
        raise UserError(f"'{path}', column '{cells.name}' holds {cells.dtype}: give numbers")
    if cells.dtype == pl.String:
        cells = cells.str.strip_chars(' \t"')
        cells = cells.set(cells == "", None)
    values = cells.cast(pl.Float64, strict=False)
    bad = ~values.is_finite().fill_null(value=False)
    if bad.any():
        row = int(bad.arg_max() or 0)
        place = f"'{path}', row {row + offset}, column '{cells.name}'"
        if cells[row] is None:
            raise UserError(f"{place} is empty: fill the gap or remove the row")
        if values[row] is None:
            raise UserError(f"{place}: '{cells[row]}' is not a number")
        raise UserError(f"{place}: '{cells[row]}' is not finite: give a number or remove the row")
    return values.to_numpy().astype(np.float64)


def _check_order(path: Path, times: Array, offset: int) -> None:
    backward = np.flatnonzero(np.diff(times) < 0.0)
    if len(backward):
        row = int(backward[0]) + 1
        raise UserError(
            f"'{path}', row {row + offset}: time runs backward from {times[row - 1]:.9g} s to"
            f" {times[row]:.9g} s; sort the rows by time"
        )
