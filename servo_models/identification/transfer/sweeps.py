"""Frequency responses from tables of gain and phase, and from raw records of sines."""

from __future__ import annotations

import math
from collections.abc import Sequence, Sized
from dataclasses import replace
from pathlib import Path

import numpy as np

from servo_models.analysis.sine_test import fundamental, hold
from servo_models.core.plant import Plant, unknown
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.readers import Columns, read_columns
from servo_models.data.schema import Column, Number, Section, Table
from servo_models.errors import UserError
from servo_models.identification.transfer.measurements import Sweep, check_signals
from servo_models.units import exponents, factor, parse

LEAST_POINTS = 4


class Frequency(Table):
    """The column of the frequencies."""

    column: Column
    unit: str = "Hz"


class Gain(Table):
    """The column of the gains; ``unit`` is SI where it is left out."""

    column: Column
    unit: str = ""
    reference: str = "1"


class Phase(Table):
    """The column of the phases; ``sign`` is -1 for lags."""

    column: Column
    unit: str = "rad"
    sign: Number = 1.0


class SweepTable(Table):
    """A ``[[sweeps]]`` of gain and phase.

    Written as::

        file = "sweep.csv"
        table = "sweep"
        input = "voltage"
        output = "angle"
        frequency = { column = "f", unit = "Hz" }
        gain = { column = "gain", unit = "dB", reference = "1 deg/V" }
        phase = { column = "phase", unit = "deg", sign = -1 }
        held_out = false
    """

    file: str
    input: str
    output: str
    frequency: Frequency
    gain: Gain
    phase: Phase
    table: str = ""
    held_out: bool = False


class RawSweep(Table):
    """A ``[[sweeps]]`` of raw records of one sine each, by their names.

    Written as::

        logs = ["10 Hz", "20 Hz", "50 Hz", "100 Hz"]
        input = "voltage"
        output = "angle"
    """

    logs: list[str]
    input: str
    output: str


def read_sweeps(
    document: Section, base: Path, plant: Plant, logs: Sequence[Log] = ()
) -> tuple[Sweep, ...]:
    """Read the frequency responses of a description, its ``[[sweeps]]``, from files in ``base``
    and from ``logs``; the plant says which inputs and outputs there are, and their units.

    Raises:
        UserError: an unknown key, signal or column, a unit that does not convert, fewer than
            ``LEAST_POINTS`` points, a frequency or gain that is not above 0.
    """
    sweeps = [_read(entry, base, plant, logs) for entry in document.sections("sweeps")]
    names = [sweep.name for sweep in sweeps]
    return tuple(
        replace(sweep, name=f"{sweep.name} ({k})") if names.count(sweep.name) > 1 else sweep
        for k, sweep in enumerate(sweeps, start=1)
    )


def raw_records(document: Section) -> frozenset[str]:
    """Return the names of the logs that are records of a sweep, not of their own."""
    raw = [entry for entry in document.sections("sweeps") if "logs" in entry]
    return frozenset(name for entry in raw for name in entry.read(RawSweep).logs)


def _read(section: Section, base: Path, plant: Plant, logs: Sequence[Log]) -> Sweep:
    entry = section.read(RawSweep) if "logs" in section else section.read(SweepTable)
    inputs = {wire.name: wire for wire in plant.inputs}
    outputs = {name: plant.wire[name] for name in plant.outputs}
    if entry.input not in inputs:
        section.fail("input", unknown("input", entry.input, inputs))
    if entry.output not in outputs:
        section.fail("output", unknown("output", entry.output, outputs))
    if isinstance(entry, RawSweep):
        known = {log.name: log for log in logs}
        for name in entry.logs:
            if name not in known:
                section.fail("logs", unknown("log", name, known))
        _check_count(section, "logs", entry.logs, "records")
        return sweep_of_sines([known[name] for name in entry.logs], entry.input, entry.output)
    cells = read_columns(base / entry.file, entry.table or None)
    frequencies = _frequencies(section, cells, entry.frequency)
    _check_count(section, "file", frequencies, "points")
    unit = f"({outputs[entry.output].unit})/({inputs[entry.input].unit})"
    phases = entry.phase.sign * _numbers(section, "phase", cells, entry.phase, "rad")
    response = _gains(section, cells, entry.gain, unit) * np.exp(1j * phases)
    spread, hidden = np.ones(len(phases)), np.full(len(phases), entry.held_out)
    ends = entry.file, entry.input, entry.output
    return Sweep(*ends, frequencies, response, spread, hidden)


def _check_count(section: Section, key: str, points: Sized, what: str) -> None:
    if len(points) < LEAST_POINTS:
        section.fail(key, f"{len(points)} {what}: a sweep needs {LEAST_POINTS} at least")


def _numbers(
    section: Section, key: str, cells: Columns, given: Frequency | Gain | Phase, unit: str
) -> Array:
    """A column in ``unit``."""
    try:
        scale = factor(given.unit or unit, unit)
    except UserError as error:
        section.fail(f"{key}.unit", error)
    values = scale * cells.numbers(given.column)
    bad = np.flatnonzero(values <= 0.0)
    if len(bad) and key != "phase":
        where = cells.where(given.column, int(bad[0]))
        raise UserError(f"{where} is not above 0: remove the row or correct the unit")
    return values


def _frequencies(section: Section, cells: Columns, given: Frequency) -> Array:
    """[rad/s]."""
    try:
        angular = "rad" in exponents(given.unit)[1]
    except UserError as error:
        section.fail("frequency.unit", error)
    unit, size = ("rad/s", 1.0) if angular else ("Hz", 2.0 * math.pi)
    return size * _numbers(section, "frequency", cells, given, unit)


def _gains(section: Section, cells: Columns, given: Gain, unit: str) -> Array:
    """SI output per SI input."""
    if given.unit != "dB":
        return _numbers(section, "gain", cells, given, unit)
    try:
        reference = parse(given.reference, unit)
    except UserError as error:
        section.fail("gain.reference", error)
    return np.asarray(reference * 10.0 ** (cells.numbers(given.column) / 20.0))


def sweep_of_sines(logs: Sequence[Log], source: str, output: str) -> Sweep:
    """Return gain and phase from logs of one sine each, once transients have died out.

    The first half of a log is left out.  The frequency is that of the input; the response of
    the input's holding between samples is taken out.  Spreads are relative standard errors.
    Source: IEEE Std 1057-2017, sec. 4.6 (fit of a sine by least squares).

    Raises:
        UserError: a log without the signals, or with fewer than two periods in its second half.
    """
    points = [_sine(log, source, output) for log in logs]
    frequencies, response, spread = (np.array(column) for column in zip(*points))
    name = f"sines {logs[0].name} to {logs[-1].name}"
    held_out = np.array([bool(np.all(log.held_out)) for log in logs])
    return Sweep(name, source, output, frequencies.real, response, spread.real, held_out)


def _sine(log: Log, source: str, output: str) -> tuple[float, complex, float]:
    """Frequency [rad/s], gain and relative standard error; no point outweighs all others."""
    from scipy.optimize import minimize_scalar

    check_signals(log, source, output)
    kept = log.times >= 0.5 * log.duration
    times, u, y = log.times[kept], log.inputs[source][kept], log.outputs[output][kept]
    step = float(np.median(np.diff(times)))
    grid = np.linspace(times[0], times[-1], len(times))
    spectrum = np.abs(np.fft.rfft(np.interp(grid, times, u - np.mean(u))))
    line = 2.0 * math.pi / (step * len(times))
    peak = line * float(np.argmax(spectrum))
    frequency = minimize_scalar(
        lambda w: fundamental(times, u, w)[1],
        bounds=(max(peak - line, 0.5 * line), peak + line),
        method="bounded",
        options={"xatol": 1e-7 * line},
    ).x
    if frequency * (times[-1] - times[0]) < 4.0 * math.pi:
        raise UserError(
            f"log '{log.name}': less than two periods of a sine in the second half of the log:"
            " record longer"
        )
    (drive, _), (answer, noise) = (fundamental(times, values, frequency) for values in (u, y))
    error = noise * math.sqrt(2.0 / len(times)) / abs(answer)
    held = complex(hold(frequency, step))
    return float(frequency), answer / (drive * held), max(error, 1e-4)
