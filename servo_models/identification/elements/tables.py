"""Tables of single elements as a description names them::

    [elements.potentiometer]
    file = "potentiometer.csv"                       # relative to the description
    angle = { column = "angle_deg", unit = "deg" }   # columns as in [[logs]]
    voltage = { column = "U_V", unit = "V" }
    [elements.amplifier]                             # without load
    file = "amplifier.csv"
    input = { column = "U_in", unit = "V" }
    output = { column = "U_out", unit = "V" }
    [elements.amplifier_loaded]                      # with load; its gain is taken
    [elements.motor]                                 # rows in the order they were taken in
    file = "motor.csv"
    voltage = { column = "U", unit = "V" }
    speed = { column = "n", unit = "rpm" }
    branch = "direction"                             # above 0 where the voltage goes away from
                                                     # 0; without it the order tells
    [elements.motor_step]                            # a step of voltage
    file = "step.csv"
    time = { column = "t", unit = "s" }
    speed = { column = "n", unit = "rpm" }
    voltage = { column = "U", unit = "V" }           # may be left out: no gain then
    [elements.gears]
    teeth = [[8, 48], [8, 32]]                       # driving and driven gear of each stage
    [elements.synthesis]
    band = "5 %"                                     # within which the servo counts as settled
    overshoot = "5 %"                                # at most
    k_f = [0.05, 0.1, 0.18]                          # further rows of the table

Each may be left out: the actuator's variant, with ``[parameters]`` on top, has its value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.plant import Wire
from servo_models.core.types import Array
from servo_models.data.description.log import check_size, in_si, map_signal
from servo_models.data.description.values import quantity
from servo_models.data.readers import read_columns
from servo_models.data.toml_file import Section
from servo_models.errors import UserError

ANGLE = Wire("angle", "rad", "angle of the potentiometer")
VOLTAGE = Wire("voltage", "V", "voltage")
INPUT, OUTPUT = Wire("input", "V", "input voltage"), Wire("output", "V", "output voltage")
SPEED = Wire("speed", "rad/s", "speed of the motor")
TIME = Wire("time", "s", "time of the row")
BRANCH = Wire("branch", "1", "above 0 where the voltage goes away from 0")

POTENTIOMETER = (ANGLE, VOLTAGE)
AMPLIFIER = (INPUT, OUTPUT)
MOTOR = (VOLTAGE, SPEED)
STEP = (TIME, SPEED)

LEAST_ROWS = 3
MOTOR_ROWS = 8


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one element.

    Attributes:
        path: the file, and ``sha256`` of its bytes.
        place: file and columns in words, for messages.
        columns: SI by name, each of shape (n,).
    """

    path: Path
    sha256: str
    place: str
    columns: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def get(self, name: str) -> Array | None:
        """Return a column that need not be there."""
        return self.columns.get(name)


def read_table(
    entry: Section, wanted: Sequence[Wire], optional: Sequence[Wire] = (), rows: int = LEAST_ROWS
) -> Table:
    """Read the table of an element.

    Args:
        entry: its part of the description.
        wanted: columns that it must have, which differ from row to row.
        optional: columns that it may have.
        rows: that it needs at least.

    Raises:
        UserError: an unknown key, no file or column, cells that are no numbers, a unit that
            does not convert, too few rows, a column that is constant.  It names the file,
            and the key or row and column.
    """
    entry.check_keys(("file", "table", "header", *(wire.name for wire in (*wanted, *optional))))
    for key in ("file", *(wire.name for wire in wanted)):
        if key not in entry:
            entry.fail(key, "missing; name the file and the columns of the table")
    header = entry.content.get("header")
    if header is not None and not isinstance(header, bool):
        entry.fail("header", "neither true nor false")
    path = entry.file.parent / entry.text("file")
    cells = read_columns(path, entry.text("table") or None, header)
    columns: dict[str, Array] = {}
    for wire in (*wanted, *(wire for wire in optional if wire.name in entry)):
        mapped = map_signal(entry, wire.name, wire, None)
        if mapped.table or mapped.shift:
            entry.fail(wire.name, "table and shift of a column belong to logs; leave them out")
        values = in_si(mapped, cells.numbers(mapped.column))
        check_size(mapped, cells, np.arange(len(values)), values, wire)
        where = cells.where(mapped.column)
        if len(values) < rows:
            raise UserError(f"{where} has {len(values)} rows: give at least {rows}")
        if columns and len(values) != len(next(iter(columns.values()))):
            raise UserError(
                f"{where} is not as long as the first column: name columns of one table"
            )
        if wire in wanted and np.all(values == values[0]):
            raise UserError(f"{where} is constant; name another column, or measure over a range")
        if wire is TIME:
            cells.check_order(mapped.column, values)
        columns[wire.name] = values
    return Table(path, cells.sha256, f"'{path}', columns {' and '.join(columns)}", columns)


def gear_ratio(entry: Section) -> float:
    """Return the ratio of a gearbox from the teeth of its stages.

    Raises:
        UserError: no pairs of whole numbers above 0.
    """
    entry.check_keys(("teeth",))
    teeth = entry.content.get("teeth")
    pairs: list[Any] = teeth if isinstance(teeth, list) and teeth else [None]
    ratio = 1.0
    for pair in pairs:
        whole = isinstance(pair, list) and [type(z) is int and z > 0 for z in pair]
        if whole != [True, True]:
            entry.fail("teeth", "no pairs of whole numbers; write teeth = [[8, 48], [8, 32]]")
        ratio *= pair[1] / pair[0]
    return ratio


@dataclass(frozen=True)
class Wish:
    """What the closed loop shall be.

    Attributes:
        band: share of the step within which it counts as settled.
        overshoot: share of the step at most.
        k_f: feedback coefficients to be told of.
    """

    band: float = 0.05
    overshoot: float = 0.05
    k_f: tuple[float, ...] = ()


def read_wish(entry: Section) -> Wish:
    """Read ``[elements.synthesis]``.

    Raises:
        UserError: shares that are not above 0 and below 1, or K_f that are not above 0.
    """
    entry.check_keys(("band", "overshoot", "k_f"))
    shares = {key: quantity(entry, key, "1") for key in ("band", "overshoot") if key in entry}
    for key, share in shares.items():
        if not 0.0 < share < 1.0:
            entry.fail(key, f'{share:g} is not between 0 and 1; give a share of the step, "5 %"')
    given = entry.content.get("k_f", [])
    numbers = given if isinstance(given, list) else [given]
    if not all(type(k_f) in (int, float) and 0.0 < k_f < float("inf") for k_f in numbers):
        entry.fail("k_f", "no list of numbers above 0; write k_f = [0.1, 0.2]")
    return Wish(**shares, k_f=tuple(map(float, numbers)))
