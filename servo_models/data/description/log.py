"""One log of a description: from the columns of its file to signals in SI."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.core.bounds import is_outside, outside
from servo_models.core.plant import Parameter, Wire, unknown
from servo_models.core.simulate import LONGEST_RUN, Model
from servo_models.core.types import Array
from servo_models.data.description.clock import (
    Clock,
    check_duration,
    column_key,
    cut_window,
    read_clock,
    time_table,
)
from servo_models.data.description.held_out import held_out, skipped
from servo_models.data.description.values import named, quantity, setting
from servo_models.data.readers import Columns
from servo_models.data.recording import Channel, Log, regular
from servo_models.data.scaffold.guess import other_units
from servo_models.data.toml_file import Section
from servo_models.errors import UserError
from servo_models.units import factor

Read = Callable[[Path, str | None, bool | None], Columns]

KEYS = (
    "file",
    "name",
    "table",
    "header",
    "time",
    "inputs",
    "outputs",
    "constants",
    "window",
    "held_out",
    "judged",
    "settle",
)
SIGNAL_KEYS = ("column", "unit", "scale", "offset", "sign", "shift", "table")
LEAST_SAMPLES = 16
LARGEST, LEAST = 1e100, 1e-100
"""Sizes [SI] of a signal outside of which its square is none that a number holds."""
SAME_TIME = 1e-9
"""Instants closer than this [s] are one: times and shifts are rounded."""
AT_REST = 1e-3
"""An input within this share of its scale from rest counts as at rest."""


class Mapped(NamedTuple):
    """A signal with the column and the table it is in; ``shift`` [s] is added to its times."""

    channel: Channel
    column: str | int
    table: str | None
    shift: float = 0.0


def read_log(entry: Section, chosen: Model, read: Read, tables: Mapping[str, Columns]) -> Log:
    """Read a log as a description's ``[[logs]]`` says.

    Args:
        entry: the description of the log.
        chosen: the model of the actuator that made it.
        read: ``logs.read_columns``, which may remember what it has read.
        tables: in memory, by the name that stands as their file.

    Raises:
        UserError: an unknown key, signal, parameter, table or column; a unit that does not
            convert; cells that are empty, no number or not finite; time that runs backward
            or repeats; an input out of its bounds; no output, or one that never changes;
            fewer than ``LEAST_SAMPLES`` samples.  It names the file, and the key or row and
            column.
    """
    entry.check_keys(KEYS)
    if "file" not in entry:
        entry.fail("file", "missing; name the file of the log")
    given = tables.get(entry.text("file"))
    path = given.path if given else _path(entry)
    header = entry.content.get("header")
    if header is not None and not isinstance(header, bool):
        entry.fail("header", "neither true nor false")
    main, plant = time_table(entry), chosen.plant
    wires = {wire.name: wire for wire in plant.inputs}
    readings = {name: plant.wire[name] for name in plant.outputs}
    inputs = _mapped(entry.section("inputs"), "input", wires, main)
    outputs = _outputs(entry, readings, main)

    def table(name: str | None) -> Columns:
        return given or read(path, name, header)

    columns = table(main)
    apart = dict.fromkeys(it.table for it in inputs.values() if it.table != main)
    others = {name: read_clock(entry, table(name), held=True) for name in apart}
    clock = _begun(cut_window(entry, read_clock(entry, columns)), others.values(), path)
    check_duration(clock, chosen.values["internal_step"])
    times = regular((clock.stamps - clock.stamps[0]) * clock.scale)
    fed = {
        name: _moved(m.shift, times, _input(m, clock, others.get(m.table), wires[name]), hold=True)
        for name, m in inputs.items()
    }
    measured = {
        name: _moved(m.shift, times, _output(m, clock, readings[name]), readings[name].flag)
        for name, m in outputs.items()
    }
    constants = _constants(entry, chosen, inputs)
    origin = -float(clock.stamps[0]) * clock.scale
    time = Channel("time", str(clock.column), clock.unit, clock.scale, origin)
    return Log(
        name=entry.text("name") or path.stem,
        path=path,
        sha256=columns.sha256,
        times=times,
        inputs=fed,
        outputs=measured,
        channels={"time": time} | {n: m.channel for n, m in (inputs | outputs).items()},
        rows=clock.rows + columns.first_row,
        held_out=held_out(entry, clock.since, fed),
        constants=constants,
        settle=_settle(entry, chosen, fed, constants, float(times[-1])),
        skipped=skipped(entry, times, fed),
        begin=float(clock.since[0]),
    )


def _path(entry: Section) -> Path:
    name = entry.text("file")
    path = entry.file.parent / name
    if not (name and os.path.exists(path)):  # a text that is no name at all has no file either
        entry.fail("file", f"no file '{path}'; name it as seen from the description")
    return path


def _outputs(entry: Section, readings: Mapping[str, Wire], main: str | None) -> dict[str, Mapped]:
    """How columns become outputs, which have to be in the table of the time."""
    section = entry.section("outputs")
    outputs = _mapped(section, "output", readings, main)
    if not outputs:
        entry.fail("outputs", 'missing; write outputs.NAME = { column = "...", unit = "..." }')
    for name, mapped in outputs.items():
        if mapped.table != main:
            section.fail(
                name,
                f"it is in table '{mapped.table}', the time in '{main or ''}'; take the time from"
                " the output's table (only inputs can be held over from another)",
            )
    return outputs


def _begun(clock: Clock, others: Iterable[Clock], path: Path) -> Clock:
    """The clock of a log from where every other table has begun."""
    firsts = (int(np.searchsorted(clock.stamps, other.stamps[0])) for other in others)
    clock = clock.cut(max(firsts, default=0), len(clock.stamps))
    if len(clock.stamps) < LEAST_SAMPLES:
        raise UserError(
            f"'{path}' has {len(clock.stamps)} samples to use: at least {LEAST_SAMPLES} are"
            " needed; record longer or widen the window"
        )
    return clock


def _mapped(
    section: Section, kind: str, wires: Mapping[str, Wire], table: str | None
) -> dict[str, Mapped]:
    """How the columns become signals, by name of the signal."""
    for name in section:
        if name not in wires:
            section.fail(name, unknown(kind, name, wires))
    return {name: map_signal(section, name, wires[name], table) for name in section}


def map_signal(section: Section, name: str, wire: Wire, table: str | None) -> Mapped:
    """Return how a column becomes the signal ``name``, by that key of a description.

    Raises:
        UserError: no column, a unit that does not convert, a scale or sign that is none.
    """
    given = section.content[name]
    if isinstance(given, (str, int)) and not isinstance(given, bool):
        return Mapped(Channel(name, str(given), wire.unit), given, table)
    signal = section.section(name)
    signal.check_keys(SIGNAL_KEYS)
    column, unit = column_key(signal), signal.text("unit", wire.unit)
    try:
        to_si = factor(unit, wire.unit)
    except UserError as error:
        signal.fail("unit", error)
    scale = signal.number("scale") if "scale" in signal else 1.0
    sign = signal.number("sign") if "sign" in signal else 1.0
    if scale == 0.0:
        signal.fail("scale", "0 makes every number the same; give the size of one")
    if sign not in (1.0, -1.0):
        signal.fail("sign", f"{sign:g} is no sign; write 1 or -1, and a size in scale")
    offset = quantity(signal, "offset", unit) if "offset" in signal else 0.0
    words = unit if scale == 1.0 else f"{scale:g} {unit}"
    channel = Channel(name, str(column), words, sign * scale * to_si, offset * to_si)
    shift = quantity(signal, "shift", "s") if "shift" in signal else 0.0
    return Mapped(channel, column, signal.text("table") or table, shift)


def in_si(mapped: Mapped, numbers: Array) -> Array:
    """Return numbers of the file as the signal, SI."""
    return mapped.channel.scale * numbers + mapped.channel.offset


def _input(mapped: Mapped, clock: Clock, other: Clock | None, wire: Wire) -> Array:
    """An input in SI at the times of the log; from another table each value is held."""
    if other is None:
        own, held = clock, np.arange(len(clock.rows))
    else:
        own = other
        held = np.searchsorted(other.stamps, clock.stamps, side="right") - 1
    values = in_si(mapped, own.numbers(mapped.column))
    bad = held[is_outside(values[held], wire)]
    if len(bad):
        place = own.columns.where(mapped.column, int(own.rows[bad[0]]))
        raise UserError(
            f"{place}: {outside('input', wire.name, float(values[bad[0]]), wire)}, or correct the"
            f" column's unit and scale{_unit_inside(mapped, values[held], wire)}"
        )
    check_size(mapped, own.columns, own.rows, values, wire)
    return values[held]


def _unit_inside(mapped: Mapped, values: Array, wire: Wire) -> str:
    """A unit in which all values [SI] of a column would be inside the bounds, as a clause."""
    told = mapped.channel.unit.split(" ", 1)[-1]
    units = [
        unit
        for unit, ratio in other_units(wire.unit, told)
        if not is_outside(ratio * values, wire).any()
    ]
    return f": in {units[0]} it would fit" if units else ""


def check_size(
    mapped: Mapped, columns: Columns, rows: NDArray[np.int64], values: Array, wire: Wire
) -> None:
    """Refuse values [SI], shape (n,), whose squares no number holds; ``rows`` says where they are.

    Raises:
        UserError: one that is too large, with its row.
    """
    bad = np.flatnonzero(np.abs(values) > LARGEST)
    if len(bad):
        place = columns.where(mapped.column, int(rows[bad[0]]))
        raise UserError(
            f"{place}: {values[bad[0]]:.4g} {wire.unit} is more than any signal has: correct the"
            " number, or the column's unit and scale"
        )


def _moved(shift: float, times: Array, values: Array, hold: bool) -> Array:
    """A column whose stamps are ``shift`` [s] early, at the times of the log.

    What is held stays a staircase, a measured quantity is linear between samples; the ends
    go on as they are.
    """
    if shift == 0.0:
        return values
    if hold:
        before = np.searchsorted(times, times - shift + SAME_TIME, side="right") - 1
        return values[np.maximum(before, 0)]
    return np.interp(times - shift, times, values)


def _output(mapped: Mapped, clock: Clock, wire: Wire) -> Array:
    values = in_si(mapped, clock.numbers(mapped.column))
    check_size(mapped, clock.columns, clock.rows, values, wire)
    if not wire.flag and np.ptp(values) < LEAST:
        raise UserError(
            f"{clock.columns.where(mapped.column)} is constant over the log: output"
            f" '{wire.name}' says nothing; leave it out or record one that moves"
        )
    return values


def _constants(entry: Section, chosen: Model, inputs: Mapping[str, Mapped]) -> dict[str, float]:
    known: dict[str, Parameter | Wire] = {wire.name: wire for wire in chosen.plant.inputs}
    known |= chosen.plant.parameters
    section = named(entry.section("constants"), "parameter or input", known)
    for name in section:
        if name in inputs:
            section.fail(name, "also an input with a column; keep one")
    return {name: setting(section, name, known[name]) for name in section}


def _settle(
    entry: Section,
    chosen: Model,
    inputs: Mapping[str, Array],
    constants: Mapping[str, float],
    duration: float,
) -> float:
    """Time to hold the first row [s]: none from rest, else what the actuator needs to settle.

    It is then no longer than the log, so that it at most doubles the cost of a run.
    """
    if "settle" in entry:
        settle = quantity(entry, "settle", "s")
        if settle < 0.0:
            entry.fail("settle", "below 0; give a time to hold the first row for")
        if settle > LONGEST_RUN * chosen.values["internal_step"]:
            entry.fail(
                "settle", f"{settle:g} s is too long to simulate; give what it needs to rest"
            )
        return settle
    first = {name: values[0] for name, values in inputs.items()}
    for wire in chosen.plant.inputs:
        value = first.get(wire.name, constants.get(wire.name, wire.rest))
        if abs(float(value) - float(wire.rest)) > AT_REST * wire.scale:
            return min(chosen.stop_time, duration)
    return 0.0
