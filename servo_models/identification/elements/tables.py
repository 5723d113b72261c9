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

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from msgspec import Meta, defstruct, field

from servo_models.core.plant import Wire
from servo_models.core.types import Array
from servo_models.data.readers import read_columns
from servo_models.data.schema import Column, Section, Share
from servo_models.data.schema import Table as TomlTable
from servo_models.data.signals import Signal, check_size, in_si, map_signal
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


class ElementTable(TomlTable):
    """The table of an element; it has a key for each column besides.

    Written as::

        file = "table.csv"
        table = "sheet"
        header = true
    """

    file: str
    table: str = ""
    header: bool | None = None


def _schema(wanted: Iterable[Wire], optional: Iterable[Wire]) -> type[ElementTable]:
    """The schema of an element with these columns."""
    columns: list[Any] = [(wire.name, Column | Signal) for wire in wanted]
    columns += [(wire.name, Column | Signal | None, None) for wire in optional]
    lines = [f'{name} = {{ column = "...", unit = "..." }}' for name, *_ in columns]
    doc = "\n".join([str(ElementTable.__doc__), *lines])
    kind = defstruct(
        "Element", columns, bases=(ElementTable,), kw_only=True, namespace={"__doc__": doc}
    )
    return cast(type[ElementTable], kind)


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
    table = entry.read(_schema(wanted, optional))
    path = entry.file.parent / table.file
    cells = read_columns(path, table.table or None, table.header)
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


Teeth = Annotated[int, Meta(gt=0)]
Coefficient = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]


class GearTable(TomlTable):
    """``[elements.gears]``, driving and driven gear of each stage.

    Written as::

        teeth = [[8, 48], [8, 32]]
    """

    teeth: Annotated[list[tuple[Teeth, Teeth]], Meta(min_length=1)]


def gear_ratio(entry: Section) -> float:
    """Return the ratio of a gearbox from the teeth of its stages.

    Raises:
        UserError: no pairs of whole numbers above 0.
    """
    return math.prod(driven / driving for driving, driven in entry.read(GearTable).teeth)


class Wish(TomlTable):
    """What the closed loop shall be, ``[elements.synthesis]``.

    Written as::

        band = "5 %"                    # share of the step within which it counts as settled
        overshoot = "5 %"               # share of the step at most
        k_f = [0.05, 0.1, 0.18]         # further feedback coefficients to evaluate
    """

    band: Share = Share(0.05)
    overshoot: Share = Share(0.05)
    coefficients: list[Coefficient] | Coefficient = field(name="k_f", default=[])

    @property
    def k_f(self) -> tuple[float, ...]:
        given = self.coefficients
        return tuple(given) if isinstance(given, list) else (given,)


def read_wish(entry: Section) -> Wish:
    """Read ``[elements.synthesis]``.

    Raises:
        UserError: shares that are not above 0 and below 1, or K_f that are not above 0.
    """
    wish = entry.read(Wish)
    for key, share in (("band", wish.band), ("overshoot", wish.overshoot)):
        if not 0.0 < share < 1.0:
            entry.fail(key, f'{share:g} is not between 0 and 1; give a share of the step, "5 %"')
    return wish
