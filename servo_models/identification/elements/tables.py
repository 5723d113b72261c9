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

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
from msgspec import Meta, defstruct, field

from servo_models.actuators.sg90.elements import Bench
from servo_models.core.types import Array
from servo_models.data.readers import read_columns
from servo_models.data.schema import Column, Section, Share, Table
from servo_models.data.signals import Signal, check_size, in_si, map_signal
from servo_models.errors import UserError


@dataclass(frozen=True, eq=False)
class Measured:
    """Columns of one element [SI], each of shape (n,), in the order of its ``Bench``, and what
    they are from: file, SHA-256 of its bytes, and both in words for messages."""

    columns: tuple[Array, ...]
    path: Path
    sha256: str
    place: str


class ElementTable(Table):
    """The table of an element; it has a key for each column besides.

    Written as::

        file = "table.csv"
        table = "sheet"
        header = true
    """

    file: str
    table: str = ""
    header: bool | None = None


def read_table(entry: Section, bench: Bench) -> Measured:
    """Read the table of an element, its part of the description.

    Raises:
        UserError: an unknown key, no file or column, cells that are no numbers, a unit that
            does not convert, too few rows, a column that is constant.  It names the file,
            and the key or row and column.
    """
    wanted: list[Any] = [(wire.name, Column | Signal) for wire in bench.columns]
    optional = [(wire.name, Column | Signal | None, None) for wire in bench.optional]
    lines = [f'{name} = {{ column = "...", unit = "..." }}' for name, *_ in [*wanted, *optional]]
    doc = {"__doc__": "\n".join([str(ElementTable.__doc__), *lines])}
    schema = defstruct(
        "Element", [*wanted, *optional], bases=(ElementTable,), kw_only=True, namespace=doc
    )
    table = cast(ElementTable, entry.read(schema))
    path = entry.file.parent / table.file
    cells = read_columns(path, table.table or None, table.header)
    columns: dict[str, Array] = {}
    for wire in (*bench.columns, *(wire for wire in bench.optional if wire.name in entry)):
        mapped = map_signal(entry, wire.name, wire, None)
        if mapped.table or mapped.shift:
            entry.fail(wire.name, "table and shift of a column belong to logs; leave them out")
        values = in_si(mapped, cells.numbers(mapped.column))
        check_size(mapped, cells, np.arange(len(values)), values, wire)
        where = cells.where(mapped.column)
        if len(values) < bench.rows:
            raise UserError(f"{where} has {len(values)} rows: give at least {bench.rows}")
        if any(len(values) != len(other) for other in columns.values()):
            raise UserError(
                f"{where} is not as long as the first column: name columns of one table"
            )
        if wire in bench.columns and np.all(values == values[0]):
            raise UserError(f"{where} is constant; name another column, or measure over a range")
        if wire.name == "time":
            cells.check_order(mapped.column, values)
        columns[wire.name] = values
    place = f"'{path}', columns {' and '.join(columns)}"
    return Measured(tuple(columns.values()), path, cells.sha256, place)


Teeth = Annotated[int, Meta(gt=0)]
Coefficient = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]


class GearTable(Table):
    """``[elements.gears]``, driving and driven gear of each stage.

    Written as::

        teeth = [[8, 48], [8, 32]]
    """

    teeth: Annotated[list[tuple[Teeth, Teeth]], Meta(min_length=1)]


class Wish(Table):
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
