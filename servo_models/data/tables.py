"""Tables of signals: units at the border, every fault with its row.

One column ``time`` and one per signal.  A header is a name, ``voltage``, with values in SI,
or a name and a unit, ``pulse_width [us]``.  Files of every format of ``logs`` are read.
Parquet is written, and CSV with decimal points and commas between columns in every country.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from servo_models.core.bounds import is_outside, outside
from servo_models.core.plant import Plant, Wire, unknown
from servo_models.core.types import Array
from servo_models.data.readers import Columns, read_columns
from servo_models.errors import UserError, told_at
from servo_models.files import write_with
from servo_models.units import factor

TIME = Wire("time", "s", "time of the row")
SUFFIXES = (".csv", ".parquet")


def read_inputs(path: str | Path, plant: Plant) -> tuple[Array, dict[str, Array]]:
    """Read what to feed an actuator with.

    Columns of its outputs may stand in the file, as in one that a simulation wrote, and
    are left out.

    Returns:
        times [s] of shape (n,), and SI values of shape (n,) by name of the input.

    Raises:
        UserError: see ``read_signals``; an input out of its bounds, or none among the columns.

    Example:
        >>> from pathlib import Path
        >>> import servo_models as sm
        >>> _ = Path("pulses.csv").write_text("time,pulse_width [us]\\n0,1500\\n0.5,1900\\n")
        >>> times, inputs = sm.read_inputs("pulses.csv", sm.model("sg90").plant)
        >>> inputs["pulse_width"]  # s
        array([0.0015, 0.0019])
    """
    outputs = [plant.wire[name] for name in plant.outputs]
    names = [wire.name for wire in plant.settable]
    times, signals = _read(Path(path), (*plant.settable, *outputs), names)
    inputs = {name: signals[name] for name in names if name in signals}
    if not inputs:
        raise UserError(f"'{path}' has no column for an input: add one of {', '.join(names)}")
    return times, inputs


def read_signals(path: str | Path, wires: Sequence[Wire]) -> tuple[Array, dict[str, Array]]:
    """Read times and signals from a file of any format of ``logs``.

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

    Example:
        >>> from pathlib import Path
        >>> import servo_models as sm
        >>> _ = Path("film.csv").write_text("time [ms],angle [deg]\\n0,0\\n20,45\\n")
        >>> times, signals = sm.read_signals("film.csv", [sm.model("sg90").plant.wire["angle"]])
        >>> times, signals["angle"].round(4)  # s, rad
        (array([0.  , 0.02]), array([0.    , 0.7854]))
    """
    return _read(Path(path), wires, ())


def _read(
    path: Path, wires: Sequence[Wire], bounded: Collection[str]
) -> tuple[Array, dict[str, Array]]:
    """Times and signals; those that are ``bounded`` have to be inside the bounds of their wires."""
    columns = read_columns(path, header=True)
    known = {wire.name: wire for wire in (TIME, *wires)}
    signals: dict[str, Array] = {}
    for number, header in enumerate(columns.names, start=1):
        name, scale = _heading(path, header, known)
        if name in signals:
            raise UserError(f"'{path}' has two columns '{name}': remove one")
        signals[name] = scale * columns.numbers(number)
        if name == "time":
            columns.check_order(number, signals[name])
        if name in bounded:
            _check_bounds(columns, number, known[name], signals[name])
    if "time" not in signals:
        raise UserError(f"'{path}' has no column 'time': add one, in seconds")
    return signals.pop("time"), signals


def write_signals(
    path: str | Path, times: Array, signals: Mapping[str, Array], wires: Mapping[str, Wire]
) -> None:
    """Write times [s] and signals (SI), each of shape (n,), to a ``.csv`` or ``.parquet`` file.

    ``read_signals`` gives the same numbers back, to the last bit.

    Raises:
        UserError: another kind of file, or a folder that cannot be written.

    Example:
        >>> import numpy as np
        >>> import servo_models as sm
        >>> wires = sm.model("sg90").plant.wire
        >>> times, angles = np.array([0.0, 0.1]), np.array([0.0, 0.2])
        >>> sm.write_signals("angles.csv", times, {"angle": angles}, wires)
        >>> sm.read_signals("angles.csv", [wires["angle"]])[1]["angle"]  # rad
        array([0. , 0.2])
    """
    import polars as pl

    path = Path(path)
    check_suffix(path)
    named = {"time": (TIME, times)} | {name: (wires[name], signals[name]) for name in signals}
    frame = pl.DataFrame({header(wire): values for wire, values in named.values()})
    if path.suffix.lower() == ".csv":
        write_with(path, frame.write_csv)
    else:
        write_with(path, frame.write_parquet)


def check_suffix(path: Path) -> None:
    """Raise UserError unless ``path`` names a kind of table that is written."""
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(f"'{path}' is no table: use a name that ends in {' or '.join(SUFFIXES)}")


def header(wire: Wire) -> str:
    """Return the heading of a column in the unit of a wire."""
    return wire.name if wire.unit == "1" else f"{wire.name} [{wire.unit}]"


def _check_bounds(columns: Columns, number: int, wire: Wire, values: Array) -> None:
    bad = np.flatnonzero(is_outside(values, wire))
    if len(bad):
        row = int(bad[0])
        said = outside("input", wire.name, float(values[row]), wire)
        raise UserError(f"{columns.where(number, row)}: {said}")


def _heading(path: Path, header: str, known: Mapping[str, Wire]) -> tuple[str, float]:
    """Name of a column, and the factor that brings its values to SI."""
    match = re.fullmatch(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]+?)\s*\])?\s*", header)
    if not match:
        raise UserError(f"'{path}', column '{header}': write it as 'name' or 'name [unit]'")
    name, unit = match.groups()
    if name not in known:
        raise UserError(f"'{path}': {unknown('column', name, known)}")
    with told_at(f"'{path}', column '{name}'"):
        return name, factor(unit, known[name].unit) if unit else 1.0
