"""One log of a description: from the columns of its file to signals in SI."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from msgspec import field
from numpy.typing import NDArray

from servo_models.core.bounds import is_outside, outside
from servo_models.core.plant import Parameter, Wire, unknown
from servo_models.core.simulate import LONGEST_RUN, Model
from servo_models.core.types import Array, Mask
from servo_models.data.clock import Grid, dithered, regular, stamped_late
from servo_models.data.log import Channel, Log, Start
from servo_models.data.readers import Columns
from servo_models.data.schema import (
    Column,
    Number,
    Quantity,
    Seconds,
    Section,
    Table,
    named,
    quantity,
    setting,
)
from servo_models.data.sensor import next_to, off_neighbours, unwrapped
from servo_models.errors import UserError
from servo_models.units import factor, fitting_unit

Read = Callable[[Path, str | None, bool | None], Columns]
Clocks = Callable[[Columns, str | int, str, bool, float | None], "Clock"]

LEAST_SAMPLES = 16  # fewest samples of a log
LARGEST = 1e100  # largest size of a signal [SI]: no number holds the square of a larger one
LEAST = 1e-100  # least range of a reading [SI], for the same reason
MOST_BETWEEN = 4  # commands between two readings that are kept, on average
SAME_TIME = 1e-9  # difference [s] up to which instants are one: times and shifts are rounded
AT_REST = 1e-3  # distance of an input from rest over its scale up to which it is at rest
MOST_EMPTY = 1000.0  # duration in usual steps over the number of rows: above, a clock has jumped
MOST_PER_ROW = 3e3  # internal steps of the model between two rows: more is a wrong unit
SENSIBLE_PER_ROW = 300.0  # internal steps between two rows in a unit that is offered instead
MOST_REPEATS_PER_ROW = 0.2  # share of stamps that repeat the one before: more are too coarse
ROUNDED_QUANTA = 1.01  # range of rounded stamps about an even clock in quanta: one, and last digits
EXACT_QUANTA = 0.01  # drift of rows against stamps, in quanta, up to which these are the very times
LOST_QUANTA = 0.5  # range of such stamps about an even clock in quanta: a lost row shifts them by 1
SHORTER = ("ms", "us", "ns")  # units that are offered in place of longer ones
SHORTEST = 1e-12  # usual step [s] below which no clock of a log has ticked


# The schema: docs/description.md says what every key means


class Signal(Table):
    """A column as a signal, in SI and from the table of the time unless it says.

    Written as::

        unit = "deg"
        scale = 0.1
        offset = "2 deg"
        sign = -1
        shift = "2 ms"
        after_command = "0.5 ms"  # of its row: then it was read, without this just before
        missing = -999
        outliers = "30 deg"
        table = "joint_states"
        checked = true  # nothing is asked of it
    """

    column: Column
    unit: str | None = None
    scale: Number = 1.0
    offset: Quantity = 0.0
    sign: Number = 1.0
    shift: Seconds = Seconds(0.0)
    after_command: Seconds | None = None
    missing: Literal["hold", "drop"] | Number | None = None
    outliers: Quantity | None = None
    table: str = ""
    checked: bool = False


class Time(Table):
    """The column with the times.

    Written as::

        column = "t"
        unit = "ms"
        repeats = "drop"
        period = "10 ms"
        table = "joint_states"
        checked = true  # nothing is asked of it
    """

    column: Column
    unit: str = "s"
    repeats: Literal["drop"] | None = None
    period: Seconds | None = None
    table: str = ""
    checked: bool = False


HELD_OUT = '{ from = "12 s", to = "20 s" }'


class HeldOut(Table):
    """A span of time, or every second level of an input."""

    begin: Seconds | None = field(name="from", default=None)
    end: Seconds | None = field(name="to", default=None)
    input: str = ""
    levels: Literal["odd", "even"] | None = None


class Judged(Table):
    """The samples that count: those soon after a change of an input."""

    input: str
    after_change: Seconds


SIGNAL: Any = Column | Signal  # type of what stands at the name of an input or an output


class LogTable(Table):
    """A ``[[logs]]``.

    Written as::

        file = "log.csv"  # or "runs/*.csv"
        name = "steps"
        table = "joint_states"
        missing = "hold"
        episode = [0, 1]  # of a LeRobot data set, see ``runs``
        header = true
        time = { column = "t", unit = "ms" }
        inputs.voltage = { column = "u", unit = "V" }
        outputs.angle = { column = "angle", unit = "deg" }
        constants = { load_torque = "5 mN.m" }
        window = ["8 s", "20 s"]
        held_out = { from = "12 s", to = "20 s" }
        judged = { input = "voltage", after_change = "0.8 s" }
        settle = "0.5 s"
        start = "rest"  # "settled", "fit", or { angle = "3 deg", rate = "10 deg/s" }
        checked = true  # nothing is asked of its columns
        repeat = [{ file = "a.csv" }, { file = "b.csv", held_out = true }]  # see ``runs``
    """

    file: str
    time: Column | Time
    outputs: dict[str, Any]
    name: str = ""
    table: str = ""
    episode: int | list[int] | None = None
    missing: Literal["hold", "drop"] | None = None
    header: bool | None = None
    inputs: dict[str, Any] = {}
    constants: dict[str, Any] = {}
    window: tuple[Seconds, Seconds] | None = None
    held_out: bool | HeldOut = False
    judged: Judged | None = None
    settle: Seconds | None = None
    start: Literal["rest", "settled", "fit"] | dict[str, Any] | None = None
    checked: bool = False
    repeat: list[dict[str, Any]] = []


# A log


def read_log(
    section: Section,
    chosen: Model,
    read: Read,
    clocks: Clocks,
    tables: Mapping[str, Columns],
    planned: bool = False,
) -> Log:
    """Read a log as a description's ``[[logs]]`` says.

    Args:
        section: the description of the log.
        chosen: the model of the actuator that made it.
        read: ``readers.read_columns``, which may remember what it has read.
        clocks: ``read_clock``, which may remember as well.
        tables: tables in memory, by the name that stands as their file.
        planned: a column of an output may be missing: the output is NaN then, and a note says so.

    Raises:
        UserError: an unknown signal, parameter, table or column; a unit that does not
            convert; cells that are empty, no number or not finite; time that runs backward
            or repeats; an input out of its bounds; no output, or one that never changes;
            fewer than ``LEAST_SAMPLES`` samples.  It names the file, and the key or row and
            column.
    """
    entry = section.read(LogTable)
    given = tables.get(entry.file)
    path = given.path if given else section.file.parent / entry.file
    if not (given or (entry.file and os.path.exists(path))):  # a text that is no name has none
        section.fail("file", f"no file '{path}'; name it as seen from the description")
    main, plant = _time_table(entry), chosen.plant
    wires = {wire.name: wire for wire in plant.settable}
    readings = {name: plant.wire[name] for name in plant.outputs}
    inputs = _mapped(section.section("inputs"), "input", wires, main)
    outputs = _outputs(section.section("outputs"), readings, main)

    def table(name: str | None) -> Columns:
        return given or read(path, name, entry.header)

    blank = {n: m for n, m in outputs.items() if planned and not table(m.table).has(m.column)}
    outputs = {name: m for name, m in outputs.items() if name not in blank}
    mapped = [
        signal if signal.empty else signal._replace(empty=entry.missing)
        for signal in (*inputs.values(), *outputs.values())
    ]
    clock, others, notes = _clocks(section, entry, mapped, table, clocks)
    clock = _begun(clock, others.values(), path)
    _check_duration(clock, chosen.values["internal_step"])
    times = regular((clock.stamps - clock.stamps[0]) * clock.scale)
    late = stamped_late(
        times, (_read(m, clock, times, readings[name]) for name, m in outputs.items())
    )
    if late:
        times, notes = late.times, [*notes, late.note]
    for kind, signals in (("inputs", inputs), ("outputs", outputs)):
        for name, signal in signals.items():
            _check_shift(section, f"{kind}.{name}.shift", signal.channel.shift, times)
    sent = {
        name: _staircase(m, clock, others.get(m.table), wires[name], times)
        for name, m in inputs.items()
    }
    measured = {name: _output(m, clock, times, readings[name]) for name, m in outputs.items()}
    for reading, m in outputs.items():
        if len(back := _turned(m, clock, readings[reading])):
            first = clock.rows[back[0]] + clock.columns.first_row
            notes += [f"'{reading}' comes back by a turn, first in row {first}: it goes on here"]
            for name, (instants, values) in sent.items():
                if wires[name].unit == readings[reading].unit:
                    there = np.interp(instants, times, measured[reading])
                    sent[name] = instants, next_to(values, there)
    measured |= {name: np.full(len(times), np.nan) for name in blank}
    notes += [f"no column '{m.column}' yet: '{name}' is not measured" for name, m in blank.items()]
    lost = np.zeros(len(times), dtype=bool)
    for m in outputs.values():
        if m.missing is not None or m.farthest is not None:
            lost |= moved(m.channel.shift, times, _unread(m, clock).astype(float), hold=False) > 0.0
    rows, times = times, _with_commands(times, sent.values())
    row = np.searchsorted(rows, times, side="right") - 1
    between = times > rows[row]
    fed = {name: values[_held(instants, times)] for name, (instants, values) in sent.items()}
    skipped = lost[row] | between
    if entry.judged:
        skipped |= _skipped(section, entry.judged, times, fed)
    since = clock.since[row] + (times - rows[row])
    constants = _constants(section.section("constants"), chosen, inputs)
    origin = -float(clock.stamps[0]) * clock.scale
    about_time = isinstance(entry.time, Time) and entry.time.checked
    time = Channel(
        "time", str(clock.column), clock.unit, clock.scale, origin, entry.checked or about_time
    )
    channels = {
        name: replace(it.channel, checked=entry.checked or it.channel.checked)
        for name, it in (inputs | outputs | blank).items()
    }
    return Log(
        name=entry.name or path.stem,
        path=path,
        sha256=clock.columns.sha256,
        times=times,
        inputs=fed,
        outputs={
            name: values[row] if readings[name].flag else np.interp(times, rows, values)
            for name, values in measured.items()
        },
        channels={"time": time} | channels,
        rows=clock.rows[row] + clock.columns.first_row,
        held_out=_held_out(section, entry.held_out, since, fed),
        constants=constants,
        settle=_settle(section, entry, chosen, fed, constants, float(times[-1])),
        skipped=skipped if skipped.any() else None,
        begin=float(clock.since[0]),
        notes=tuple(notes),
        start=_start(section, entry.start, chosen),
        assumed=entry.start is None and entry.settle is None,
        between=between if between.any() else None,
    )


def _clocks(
    section: Section,
    entry: LogTable,
    mapped: Iterable[Mapped],
    table: Callable[[str | None], Columns],
    clocks: Clocks,
) -> tuple[Clock, dict[str | None, Clock], list[str]]:
    """The rows of a log, those of its commands where these are others, and notes on the first."""
    main = _time_table(entry)
    used: dict[str | None, list[str | int]] = {main: []}
    for signal in mapped:
        used.setdefault(signal.table, []).append(signal.column)
    tables = {name: table(name) for name in used}
    dropped = {name: np.zeros(len(it.cells[0]), dtype=bool) for name, it in tables.items()}
    gaps = []
    for signal in mapped:
        if signal.empty:
            columns = tables[signal.table]
            empty = columns.empty(signal.column)
            tables[signal.table] = columns.held(signal.column)
            what = "hold the one before" if signal.empty == "hold" else "are left out"
            if signal.empty == "drop":
                dropped[signal.table] |= empty
            if empty.any():
                name = columns.names[columns.index(signal.column)]
                gaps.append(f"{np.count_nonzero(empty)} rows without a value of '{name}' {what}")
    every = {
        name: _clock_of(section, entry.time, tables[name], clocks, name == main) for name in used
    }
    kept = {name: clock.without(dropped[name]) for name, clock in every.items()}
    clock, late = _with_values(_cut_window(section, entry.window, kept[main]), used[main])
    others = {name: _with_values(it, used[name])[0] for name, it in kept.items() if name != main}
    if dropped[main].any():  # a command may stand in rows without a reading
        others[main] = _with_values(every[main], used[main])[0].on_ticks()
    clock, even = _ticked(clock)
    return clock, others, [*gaps, *late, *even]


def _time_table(entry: LogTable) -> str | None:
    """The name of the table that the log's times are in, None if there is but one."""
    own_table = entry.time.table if isinstance(entry.time, Time) else ""
    return own_table or entry.table or None


def _begun(clock: Clock, others: Iterable[Clock], path: Path) -> Clock:
    """The clock of a log from where every other table has begun."""
    firsts = (int(np.searchsorted(clock.stamps, other.stamps[0])) for other in others)
    clock = clock.kept(slice(max(firsts, default=0), None))
    if len(clock.stamps) < LEAST_SAMPLES:
        raise UserError(
            f"'{path}' has {len(clock.stamps)} samples to use: at least {LEAST_SAMPLES} are"
            " needed; record longer or widen the window"
        )
    return clock


def _constants(given: Section, chosen: Model, inputs: Mapping[str, Mapped]) -> dict[str, float]:
    known: dict[str, Parameter | Wire] = {wire.name: wire for wire in chosen.plant.settable}
    known |= chosen.plant.parameters
    section = named(given, "parameter or input", known)
    for name in section:
        if name in inputs:
            section.fail(name, "also an input with a column; keep one")
    return {name: setting(section, name, known[name]) for name in section}


def _settle(
    section: Section,
    entry: LogTable,
    chosen: Model,
    inputs: Mapping[str, Array],
    constants: Mapping[str, float],
    duration: float,
) -> float:
    """Time to hold the first row [s]: none from rest, else what the actuator needs to settle.

    It is then no longer than the log, so that it at most doubles the cost of a run.
    """
    given = entry.settle
    if entry.start == "rest":
        if given:
            section.fail("settle", "held before a log that begins at rest; drop one of the two")
        return 0.0
    if entry.start == "settled" and given == 0.0:
        section.fail("settle", "0 s, in which nothing settles; drop it, or start")
    if given is not None:
        if given < 0.0:
            section.fail("settle", "below 0; give a time to hold the first row for")
        if given > LONGEST_RUN * chosen.values["internal_step"]:
            section.fail(
                "settle", f"{given:g} s is too long to simulate; give what it needs to rest"
            )
        return float(given)
    if entry.start is not None:
        return min(chosen.stop_time, duration)
    first = {**constants, **{name: values[0] for name, values in inputs.items()}}
    away = (
        abs(float(first.get(wire.name, wire.rest)) - float(wire.rest)) > AT_REST * wire.scale
        for wire in chosen.plant.inputs
    )
    return min(chosen.stop_time, duration) if any(away) else 0.0


def _start(section: Section, given: str | Mapping[str, Any] | None, chosen: Model) -> Start | None:
    """How a log begins, beyond rest and a settled first row."""
    if given in (None, "rest", "settled"):
        return None
    shaft = chosen.shaft
    if shaft is None:
        section.fail(
            "start",
            f"actuator '{chosen.actuator.name}' has no shaft that can be put to a motion: a plant"
            " has one with the states of actuators/shaft.py and a terminal 'shaft'; write"
            ' "rest" or "settled", or leave it out',
        )
    if isinstance(given, str):
        return Start(fitted=True)
    if not given:
        section.fail("start", f"empty; write for example {{ {shaft.angle} = 0, {shaft.rate} = 0 }}")
    wires = {name: chosen.plant.wire[name] for name in (shaft.angle, shaft.rate)}
    place = named(section.section("start"), "motion", wires)
    told = {name: setting(place, name, wires[name]) for name in place}
    return Start({**dict.fromkeys(wires, 0.0), **told})


# Columns that become signals


class Mapped(NamedTuple):
    """A signal with the column and the table it is in; the number ``missing`` in the file is no
    reading, nor is what lies further than ``farthest`` [SI] from its neighbours; an ``empty`` cell
    holds the value before, or its row is dropped."""

    channel: Channel
    column: str | int
    table: str | None
    missing: float | None = None
    farthest: float | None = None
    empty: str | None = None


def map_signal(section: Section, name: str, wire: Wire, table: str | None) -> Mapped:
    """Return how a column becomes the signal ``name``, by that key of a description.

    Raises:
        UserError: no column, a unit that does not convert, a scale or sign that is none.
    """
    given = section.at(name).read(SIGNAL, f'{name} = {{ column = "...", unit = "{wire.unit}" }}')
    if not isinstance(given, Signal):
        return Mapped(Channel(name, str(given), wire.unit), given, table)
    unit = wire.unit if given.unit is None else given.unit
    try:
        to_si = factor(unit, wire.unit)
    except UserError as error:
        section.fail(f"{name}.unit", error)
    if given.scale == 0.0:
        section.fail(f"{name}.scale", "0 makes every number the same; give the size of one")
    if given.sign not in (1.0, -1.0):
        complaint = f"{given.sign:g} is no sign; write 1 or -1, and a size in scale"
        section.fail(f"{name}.sign", complaint)
    at = section.at(name)
    offset = quantity(at, "offset", unit) if "offset" in at else 0.0
    words = unit if given.scale == 1.0 else f"{given.scale:g} {unit}"
    scale = given.sign * given.scale * to_si
    when = float(given.shift), given.after_command
    if when[1] is not None and when[1] < 0.0:
        section.fail(f"{name}.after_command", "below 0; say by shift that a column is late")
    channel = Channel(name, str(given.column), words, scale, offset * to_si, given.checked, *when)
    farthest = to_si * quantity(at, "outliers", unit) if "outliers" in at else None
    if farthest is not None and not farthest > 0.0:
        section.fail(f"{name}.outliers", f"{given.outliers} is no distance; give one above 0")
    empty = given.missing if isinstance(given.missing, str) else None
    number = None if isinstance(given.missing, str) else given.missing
    return Mapped(channel, given.column, given.table or table, number, farthest, empty)


def in_si(mapped: Mapped, numbers: Array) -> Array:
    """Return numbers of the file as the signal, SI."""
    return mapped.channel.scale * numbers + mapped.channel.offset


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


def _mapped(
    section: Section, kind: str, wires: Mapping[str, Wire], table: str | None
) -> dict[str, Mapped]:
    """How the columns become signals, by name of the signal."""
    for name in section:
        if name not in wires:
            section.fail(name, unknown(kind, name, wires))
    mapped = {name: map_signal(section, name, wires[name], table) for name in section}
    for name, signal in mapped.items():
        of_readings = {"missing": signal.missing, "outliers": signal.farthest}
        of_readings["after_command"] = signal.channel.after_command
        for key, said in of_readings.items():
            if kind == "input" and said is not None:
                section.fail(f"{name}.{key}", f"an input has a value in every row; leave {key} out")
    return mapped


def _outputs(section: Section, readings: Mapping[str, Wire], main: str | None) -> dict[str, Mapped]:
    """How columns become outputs, which have to be in the table of the time."""
    outputs = _mapped(section, "output", readings, main)
    if not outputs:
        raise UserError(f"'{section.file}', {section.name}: empty; name a column of an output")
    for name, mapped in outputs.items():
        if mapped.table != main:
            section.fail(
                name,
                f"it is in table '{mapped.table}', the time in '{main or ''}'; take the time from"
                " the output's table (only inputs can be held over from another)",
            )
    return outputs


def _staircase(
    mapped: Mapped, clock: Clock, other: Clock | None, wire: Wire, times: Array
) -> tuple[Array, Array]:
    """Instants [s] on the clock of the log, from which an input has these values [SI]."""
    source = other or clock
    instants = (source.stamps - clock.stamps[0]) * clock.scale if other else times
    values = in_si(mapped, source.numbers(mapped.column))
    held = np.unique(_held(instants, times))
    bad = held[is_outside(values[held], wire)]
    if len(bad):
        place = source.columns.where(mapped.column, int(source.rows[bad[0]]))
        unit = fitting_unit(
            wire.unit,
            mapped.channel.told[1],
            lambda ratio: not is_outside(ratio * values[held], wire).any(),
        )
        cure = f": in {unit} it would fit"
        raise UserError(
            f"{place}: {outside('input', wire.name, float(values[bad[0]]), wire)}, or correct the"
            " column's unit and scale"
            f"{cure if unit else '; or it is another column: two may be swapped'}"
        )
    check_size(mapped, source.columns, source.rows, values, wire)
    return instants + mapped.channel.shift, values


def _held(instants: Array, times: Array) -> NDArray[np.int64]:
    """Places of the values that hold at some times [s]: the latest, and the first before it."""
    return np.maximum(np.searchsorted(instants, times + SAME_TIME, side="right") - 1, 0)


def _with_commands(times: Array, sent: Iterable[tuple[Array, Array]]) -> Array:
    """The times of a log, and those between at which an input changes; thinned if far more."""
    changes = [instants[1:][np.diff(values) != 0.0] for instants, values in sent]
    new = np.unique(np.concatenate([times[:0], *changes]))
    new = new[(new > times[0]) & (new < times[-1])]
    before = times[np.searchsorted(times, new, side="right") - 1]
    after = times[np.searchsorted(times, new)]
    new = new[np.minimum(new - before, after - new) > SAME_TIME]
    return np.union1d(times, new[:: 1 + len(new) // (MOST_BETWEEN * len(times))])


def _output(mapped: Mapped, clock: Clock, times: Array, wire: Wire) -> Array:
    """An output in SI at the times of the log, after its shift."""
    values = _read(mapped, clock, times, wire)
    check_size(mapped, clock.columns, clock.rows, values, wire)
    shift = mapped.channel.shift
    at_rows = moved(shift, times, values, wire.flag)
    if not wire.flag and np.ptp(at_rows) < LEAST:
        which = f", in what a shift of {shift:g} s leaves of it" if np.ptp(values) else ""
        raise UserError(
            f"{clock.columns.where(mapped.column)} is constant over the log{which}: output"
            f" '{wire.name}' says nothing; leave it out or record one that moves"
        )
    return at_rows


def _read(mapped: Mapped, clock: Clock, times: Array, wire: Wire) -> Array:
    """An output in SI in the rows of the log, interpolated over rows that are no reading."""
    values, lost = in_si(mapped, clock.numbers(mapped.column)), _unread(mapped, clock)
    if lost.all():
        place = clock.columns.where(mapped.column)
        raise UserError(f"{place} is no reading in any row: correct missing, or outliers")
    read = unwrapped(values[~lost])[0] if wire.unit == "rad" else values[~lost]
    return np.interp(times, times[~lost], read)


def _turned(mapped: Mapped, clock: Clock, wire: Wire) -> NDArray[np.int64]:
    """Rows of the log in which an angle had come back by a turn."""
    if wire.unit != "rad":
        return clock.rows[:0]
    read = np.flatnonzero(~_unread(mapped, clock))
    return read[unwrapped(in_si(mapped, clock.numbers(mapped.column))[read])[1]]


def _unread(mapped: Mapped, clock: Clock) -> Mask:
    """Mark rows in which a column is no reading, shape (n,)."""
    numbers = clock.numbers(mapped.column)
    lost = np.asarray(numbers == mapped.missing)
    if mapped.farthest is not None and not lost.all():
        off = np.zeros(len(numbers))
        off[~lost] = mapped.channel.scale * off_neighbours(numbers[~lost])
        lost |= np.abs(off) > mapped.farthest
    return lost


def _check_shift(section: Section, key: str, shift: float, times: Array) -> None:
    """Refuse a shift [s] that leaves a column too few values at the times of the log."""
    lasts = f"the log lasts {times[-1]:g} s"
    cure = 'correct it, and give its unit, such as "5 ms"'
    if abs(shift) > times[-1] + SAME_TIME:
        section.fail(key, f"{shift:g} s, but {lasts}; {cure}")
    since = times - shift
    left = int(np.count_nonzero((since >= -SAME_TIME) & (since <= times[-1] + SAME_TIME)))
    if left < LEAST_SAMPLES:
        section.fail(
            key,
            f"{shift:g} s leaves {left} of {len(times)} samples, and at least {LEAST_SAMPLES} are"
            f" needed ({lasts}); {cure}, or record longer",
        )


def moved(shift: float, times: Array, values: Array, hold: bool) -> Array:
    """Return a column whose stamps are ``shift`` [s] early, at the times of the log.

    What is held stays a staircase, a measured quantity is linear between samples; the ends
    go on as they are.
    """
    if shift == 0.0:
        return values
    if hold:
        before = np.searchsorted(times, times - shift + SAME_TIME, side="right") - 1
        return values[np.maximum(before, 0)]
    return np.interp(times - shift, times, values)


# Which rows of a file belong to a log, and when they were sampled


@dataclass(frozen=True, eq=False)
class Clock:
    """The rows kept of a table, with their times.

    Attributes:
        columns: the table; its column ``column`` holds the times in ``unit``.
        stamps: times of the rows kept as they stand in the file, shape (n,).
        rows: their places in the table, counted from 0, shape (n,).
        begin: time in the file's first row, in ``unit``.
        grid: the even grid of all rows of the table, None where they are on none.
        ticks: times of the rows kept on that grid, as ``stamps``.
    """

    columns: Columns
    column: str | int
    unit: str
    stamps: Array
    rows: NDArray[np.int64]
    begin: float
    grid: Grid | None = None
    ticks: Array | None = None

    @property
    def scale(self) -> float:
        return factor(self.unit, "s")

    @property
    def since(self) -> Array:
        """Times since the file's first row [s], shape (n,)."""
        return (self.stamps - self.begin) * self.scale

    def kept(self, which: slice | Mask) -> Clock:
        """Keep some of the rows kept."""
        ticks = None if self.ticks is None else self.ticks[which]
        return replace(self, stamps=self.stamps[which], rows=self.rows[which], ticks=ticks)

    def on_ticks(self) -> Clock:
        """The clock with times on its even grid, as it is where there is none."""
        return self if self.ticks is None else replace(self, stamps=self.ticks)

    def without(self, dropped: Mask) -> Clock:
        """Leave out the rows of the table that are marked, shape (rows of the table,)."""
        if not dropped.any():
            return self
        kept = ~dropped[self.rows]
        if not kept.any():
            raise UserError(
                f"{self.columns.where(self.column)}: no row has a value in every column; write"
                ' missing = "hold" for that of a command'
            )
        return self.kept(kept)

    def numbers(self, column: str | int) -> Array:
        """Return a column of the table in the rows kept, shape (n,).

        Raises:
            UserError: see ``Columns.numbers``; or a column not as long as that of the times.
        """
        lengths = [len(self.columns.cells[self.columns.index(c)]) for c in (column, self.column)]
        if lengths[0] != lengths[1]:
            raise UserError(
                f"{self.columns.where(column)} has {lengths[0]} rows, the time {lengths[1]}: name"
                " columns that were sampled together, or the table of each"
            )
        first = int(self.rows[0])
        values = self.columns.numbers(column, slice(first, int(self.rows[-1]) + 1))
        return values[self.rows - first]


def read_clock(
    columns: Columns, column: str | int, unit: str, drop: bool, period: float | None = None
) -> Clock:
    """Read the times of all rows of a table, from its column ``column`` in ``unit``.

    Args:
        drop: leave out rows with the time of the row before.
        period: period [s] of an even clock whose rounded times the stamps are.

    Raises:
        UserError: a cell that is empty or no time, times that run backward, or that are not the
            rounded ones of such a clock.
    """
    first, scale = columns.begin(column), factor(unit, "s")
    stamps = columns.dates(column, slice(first, None))
    if stamps is None:
        stamps = columns.numbers(column, slice(first, None), times=True)
    if not len(stamps):
        raise UserError(f"{columns.where(column)} has no rows: name another column")
    columns.check_order(column, scale * stamps, first)
    if period is not None:
        ticks: Array = period * np.arange(len(stamps), dtype=np.float64)
        _check_period(columns.where(column), scale * (stamps - stamps[0]), ticks, period)
        even = stamps[0] + ticks / scale
        return Clock(columns, column, unit, even, first + np.arange(len(even)), float(even[0]))
    kept = np.flatnonzero(np.diff(stamps, prepend=-np.inf)) if drop else np.arange(len(stamps))
    clock = Clock(columns, column, unit, stamps[kept], first + kept, float(stamps[0]))
    return _on_grid(clock)


def _check_period(place: str, since: Array, ticks: Array, period: float) -> None:
    """Refuse stamps ``since`` the first [s] that are not the rounded times of an even clock.

    Rounding leaves stamps less than a quantum about its ``ticks`` [s].  Where the period is a
    quantum, rounding shifts no stamp, and a lost row shifts the next ones by a quantum.
    """
    steps = np.diff(since)
    quantum = float(np.min(steps[steps > SAME_TIME], initial=np.inf))
    if not np.isfinite(quantum):
        raise UserError(
            f"{place}: all stamps are the same and cannot show whether a row comes every"
            f" {period:g} s: give finer stamps"
        )
    every = float(steps.min()) > SAME_TIME  # rounding would have made two stamps of some pair alike
    exact = every and abs(quantum * len(steps) - ticks[-1]) < EXACT_QUANTA * quantum
    off = float(np.ptp(since - ticks))
    if off > quantum * (LOST_QUANTA if exact else ROUNDED_QUANTA):
        raise UserError(
            f"{place}: the stamps last {since[-1]:.6g} s and {len(steps)} periods of {period:g} s"
            f" {ticks[-1]:.6g} s; on the way they part by {off:.3g} s, where stamps"
            f" {quantum:.3g} s apart allow for less: correct time.period, or leave it out; no row"
            " may be missing"
        )


def _on_grid(clock: Clock) -> Clock:
    """The clock with the even grid that its stamps lie on, if they do; it begins as they do."""
    grid = dithered(clock.stamps, clock.scale)
    if grid is None:
        return clock
    ticks = clock.stamps[0] + (grid.times - grid.times[0]) / clock.scale
    return replace(clock, grid=grid, ticks=ticks)


def _clock_of(
    section: Section, given: str | int | Time, columns: Columns, read: Clocks, main: bool
) -> Clock:
    """The times of a table as a log's description says; a period is that of the ``main`` one."""
    time = given if isinstance(given, Time) else Time(column=given)
    try:
        factor(time.unit, "s")
    except UserError as error:
        section.fail("time.unit", error)
    first = columns.begin(time.column)
    if time.unit != "s" and columns.dates(time.column, slice(first, first + 1)) is not None:
        section.fail("time.unit", "the column holds dates and times; leave out the unit")
    if time.period is not None and time.period <= 0.0:
        section.fail("time.period", f"{time.period:g} s; give a time above 0")
    if time.period is not None and time.repeats:
        section.fail("time.period", "every row counts, and repeats drops some; keep one")
    return read(columns, time.column, time.unit, bool(time.repeats), time.period if main else None)


def _with_values(clock: Clock, columns: Iterable[str | int]) -> tuple[Clock, list[str]]:
    """The clock from where each of these columns of its table has a first value, and a note."""
    table, first = clock.columns, int(clock.rows[0])
    begins = {column: table.begin(column, first) for column in columns}
    latest = max(begins, key=begins.__getitem__, default=clock.column)
    begin = begins.get(latest, first)
    if begin == first:
        return clock, []
    kept = clock.kept(clock.rows >= begin)
    rows = f"rows {first + table.first_row} to {begin - 1 + table.first_row} are"
    row = f"row {first + table.first_row} is"
    return kept, [
        f"{rows if begin > first + 1 else row} left out, since column"
        f" '{table.names[table.index(latest)]}' has no value there yet"
    ]


def _ticked(clock: Clock) -> tuple[Clock, list[str]]:
    """The clock with a time for each row, on the grid that rounded stamps lie on, and a note.

    Raises:
        UserError: a time that repeats otherwise.
    """
    again = np.diff(clock.stamps, prepend=-np.inf) == 0.0
    if clock.grid is None and again.any():
        clock = _on_grid(clock)  # its rows may lie on one, and not those outside of the window
    if clock.grid is not None:
        return clock.on_ticks(), [clock.grid.note]
    if again.any():
        at = int(np.argmax(again))
        column, row = clock.column, int(clock.rows[at])
        time = clock.columns.time_text(column, row, clock.scale * float(clock.stamps[at]))
        repeats = f"{clock.columns.where(column, row)}: time {time} repeats"
        share = float(again.mean())
        if share > MOST_REPEATS_PER_ROW:
            twice = '; if rows stand twice, set time.repeats = "drop"'
            raise UserError(
                f"{repeats}, as {share:.0%} of the stamps do: they are coarser than the clock; if"
                ' it is even, say its period, time.period = "10 ms", else log with finer stamps'
                f"{twice if share <= 0.5 else ''}"
            )
        raise UserError(
            f"{repeats}, and the stamps are no even clock, rounded; remove the row or set"
            ' time.repeats = "drop"'
        )
    return clock, []


def _cut_window(section: Section, window: tuple[float, float] | None, clock: Clock) -> Clock:
    """The rows inside the log's window [s], ends included; all where it has none."""
    if window is None:
        return clock
    inside = _between(section, "window", window, clock.since)
    if not inside.any():
        section.fail("window", f"no row inside; the file lasts {clock.since[-1]:g} s")
    return clock.kept(inside)


def _between(
    section: Section, key: str, ends: tuple[float | None, float | None], since: Array
) -> Mask:
    """Mark times [s] between two ends, which are included; either may be open."""
    begin, end = (-np.inf if ends[0] is None else ends[0], np.inf if ends[1] is None else ends[1])
    if begin >= end:
        section.fail(key, f"{end:g} s is not after {begin:g} s; correct one of the two")
    return np.asarray((since >= begin) & (since <= end))


def _check_duration(clock: Clock, internal_step: float) -> None:
    """Refuse times that no run of the actuator has, before anything is simulated.

    Their steps are shorter than those of any clock, one step is longer than a thousand logs, or
    they hold so many internal steps [s] of the model that a simulation would hardly end.
    """
    since = clock.since
    steps = np.diff(since)
    usual = float(np.median(steps)) if len(steps) else 0.0
    lasts = float(since[-1] - since[0]) if len(since) else 0.0
    if not usual:
        return
    where = clock.columns.where
    if usual < SHORTEST:
        raise UserError(
            f"{where(clock.column)} in {clock.unit}: rows are {usual:.3g} s apart, which no clock"
            " tells apart; correct the unit or the column"
        )
    clock.columns.check_steps(clock.column, since, clock.rows)
    if lasts > MOST_EMPTY * len(since) * usual:
        row = int(np.argmax(steps)) + 1
        raise UserError(
            f"{where(clock.column, int(clock.rows[row]))}: time jumps by {steps[row - 1]:.3g} s,"
            f" where rows are {usual:.3g} s apart; correct the row, remove it, or leave it out by a"
            " window"
        )
    if max(usual / MOST_PER_ROW, lasts / LONGEST_RUN) > internal_step:
        ratios = {unit: factor(unit, clock.unit) for unit in SHORTER}
        cures = [
            f'in {unit} it lasts {ratio * lasts:.3g} s: write unit = "{unit}"'
            for unit, ratio in ratios.items()
            if ratio * usual <= SENSIBLE_PER_ROW * internal_step
        ]
        cure = cures[0] if cures else "correct the unit, or set a longer internal_step"
        raise UserError(
            f"{where(clock.column)} in {clock.unit}: rows are {usual:.3g} s apart and the log lasts"
            f" {lasts:.3g} s, which is {lasts / internal_step:.2g} internal steps of the model, too"
            f" many to simulate; {cure}"
        )


# Which samples no fit may see, and which count at all


def _held_out(
    section: Section, chosen: bool | HeldOut, since: Array, inputs: Mapping[str, Array]
) -> Mask:
    """The samples that a log holds out, shape (n,), at times ``since`` its first row [s]."""
    if isinstance(chosen, bool):
        return np.full(len(since), chosen)
    if chosen == HeldOut():
        section.fail("held_out", f"empty; write true for all samples, or {HELD_OUT}")
    if chosen.levels or chosen.input:
        if chosen.begin is not None or chosen.end is not None:
            section.fail("held_out", "both a time and levels; keep one")
        return _levels(section, chosen, inputs)
    marked = _between(section, "held_out", (chosen.begin, chosen.end), since)
    if not marked.any():
        lasts = f"the log lasts from {since[0]:g} to {since[-1]:g} s"
        section.fail("held_out", f"no row inside; {lasts}")
    return marked


def _levels(section: Section, chosen: HeldOut, inputs: Mapping[str, Array]) -> Mask:
    """Every second level, from where it is commanded to where the next excursion starts.

    The level of the first row is where excursions come from and belongs to none.
    """
    values = _input_named(section, "held_out.input", chosen.input, inputs)
    if chosen.levels is None:
        section.fail("held_out.levels", 'missing; write levels = "even" or levels = "odd"')
    levels = np.unique(values[values != values[0]])
    if len(levels) < 2:
        complaint = f"'{chosen.input}' has {len(levels)} levels to choose from; use from and to"
        section.fail("held_out.input", complaint)
    starts = (np.diff(values, prepend=values[0]) != 0.0) & (values != values[0])
    latest = np.maximum.accumulate(np.where(starts, np.arange(len(values)), -1))
    first = {"odd": 0, "even": 1}[chosen.levels]
    return np.asarray((latest >= 0) & np.isin(values, levels[first::2])[latest])


def _input_named(section: Section, key: str, name: str, inputs: Mapping[str, Array]) -> Array:
    if name not in inputs:
        section.fail(key, unknown("input with a column", name, inputs))
    return inputs[name]


def _skipped(section: Section, judged: Judged, times: Array, inputs: Mapping[str, Array]) -> Mask:
    """The samples that do not count, shape (n,): those long after a change of the input."""
    values = _input_named(section, "judged.input", judged.input, inputs)
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1
    if not len(changes):
        section.fail("judged.input", f"'{judged.input}' never changes; leave out judged")
    latest = np.searchsorted(times[changes], times, side="right") - 1
    since = times - times[changes][np.maximum(latest, 0)]
    counted: Mask = (latest >= 0) & (since < judged.after_change)
    return ~counted
