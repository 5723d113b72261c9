"""Frequency responses from tables of gain and phase, and from raw records of sines."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from servo_models.analysis.sine_test import fundamental, hold
from servo_models.core.plant import Plant, unknown
from servo_models.core.types import Array
from servo_models.data.description.clock import column_key
from servo_models.data.readers import Columns, read_columns
from servo_models.data.recording import Log
from servo_models.data.toml_file import Section
from servo_models.errors import UserError
from servo_models.identification.transfer.evidence import Sweep, check_signals
from servo_models.units import exponents, factor, parse

KEYS = ("file", "frequency", "gain", "phase", "input", "output", "table", "held_out")
RAW_KEYS = ("logs", "input", "output")
LEAST_POINTS = 4
LEAST_SPREAD = 1e-4
"""Relative error that a point has at least, so that no noise-free one outweighs all others."""


def read_sweeps(
    document: Section, base: Path, plant: Plant, logs: Sequence[Log] = ()
) -> tuple[Sweep, ...]:
    """Read the frequency responses of a description::

        [[sweeps]]
        file = "sweep.csv"                # relative to ``base``
        input = "voltage"
        output = "angle"
        frequency = { column = "f", unit = "Hz" }      # or rad/s
        gain = { column = "gain", unit = "deg/V" }     # or dB with reference = "1 deg/V"
        phase = { column = "phase", unit = "deg" }     # of the output; sign = -1 for lags
        held_out = false

        [[sweeps]]
        logs = ["10 Hz", "20 Hz"]         # raw records, of one sine each, by their names
        input = "voltage"
        output = "angle"

    Args:
        document: the whole description.
        base: folder of the files.
        plant: says which inputs and outputs there are, and their units.
        logs: of the description.

    Raises:
        UserError: an unknown key, signal or column, a unit that does not convert, fewer than
            ``LEAST_POINTS`` points, a frequency or gain that is not above 0.
    """
    found = [_read(entry, base, plant, logs) for entry in document.sections("sweeps")]
    names = [one.name for one in found]
    return tuple(
        replace(one, name=f"{one.name} ({k})") if names.count(one.name) > 1 else one
        for k, one in enumerate(found, start=1)
    )


def raw_records(document: Section) -> frozenset[str]:
    """Return the names of the logs that are records of a sweep, not of their own."""
    sweeps = document.sections("sweeps")
    return frozenset(name for entry in sweeps for name in entry.texts("logs"))


def _read(entry: Section, base: Path, plant: Plant, logs: Sequence[Log]) -> Sweep:
    raw = "logs" in entry
    entry.check_keys(RAW_KEYS if raw else KEYS)
    for key in RAW_KEYS if raw else KEYS[:6]:
        if key not in entry:
            entry.fail(key, "missing; a sweep needs file, input, output, frequency, gain, phase")
    inputs = {wire.name: wire for wire in plant.inputs}
    outputs = {name: plant.wire[name] for name in plant.outputs}
    source, output = entry.text("input"), entry.text("output")
    if source not in inputs:
        entry.fail("input", unknown("input", source, inputs))
    if output not in outputs:
        entry.fail("output", unknown("output", output, outputs))
    if raw:
        return sweep_of_sines(_named(entry, logs), source, output)
    held_out = entry.content.get("held_out", False)
    if not isinstance(held_out, bool):
        entry.fail("held_out", "neither true nor false")
    columns = read_columns(base / entry.text("file"), entry.text("table") or None)
    frequencies = _frequencies(entry.section("frequency"), columns)
    if len(frequencies) < LEAST_POINTS:
        entry.fail("file", f"{len(frequencies)} points: a sweep needs {LEAST_POINTS} at least")
    gain = _gain(
        entry.section("gain"), columns, f"({outputs[output].unit})/({inputs[source].unit})"
    )
    phase = _phase(entry.section("phase"), columns)
    return Sweep(
        name=entry.text("file"),
        source=source,
        output=output,
        frequencies=frequencies,
        response=gain * np.exp(1j * phase),
        spread=np.ones(len(frequencies)),
        held_out=np.full(len(frequencies), held_out),
    )


def _named(entry: Section, logs: Sequence[Log]) -> list[Log]:
    known = {log.name: log for log in logs}
    for name in entry.texts("logs"):
        if name not in known:
            entry.fail("logs", unknown("log", name, known))
    found = [known[name] for name in entry.texts("logs")]
    if len(found) < LEAST_POINTS:
        entry.fail("logs", f"{len(found)} records: a sweep needs {LEAST_POINTS} at least")
    return found


def _frequencies(section: Section, columns: Columns) -> Array:
    """[rad/s]."""
    section.check_keys(("column", "unit"))
    column, unit = column_key(section), section.text("unit", "Hz")
    try:
        angular = "rad" in exponents(unit)[1]
        scale = factor(unit, "rad/s") if angular else 2.0 * math.pi * factor(unit, "Hz")
    except UserError as error:
        section.fail("unit", error)
    return scale * _positive(columns, column, columns.numbers(column))


def _gain(section: Section, columns: Columns, unit: str) -> Array:
    """SI output per SI input."""
    section.check_keys(("column", "unit", "reference"))
    column, given = column_key(section), section.text("unit", unit)
    values = columns.numbers(column)
    try:
        if given == "dB":
            return np.asarray(parse(section.text("reference", "1"), unit) * 10.0 ** (values / 20.0))
        return _positive(columns, column, factor(given, unit) * values)
    except UserError as error:
        section.fail("unit", error)


def _phase(section: Section, columns: Columns) -> Array:
    """[rad], lag negative."""
    section.check_keys(("column", "unit", "sign"))
    column = column_key(section)
    sign = section.number("sign") if "sign" in section else 1.0
    try:
        scale = factor(section.text("unit", "rad"), "rad")
    except UserError as error:
        section.fail("unit", error)
    return sign * scale * columns.numbers(column)


def _positive(columns: Columns, column: str | int, values: Array) -> Array:
    bad = np.flatnonzero(values <= 0.0)
    if len(bad):
        where = columns.where(column, int(bad[0]))
        raise UserError(f"{where} is not above 0: remove the row or correct the unit")
    return values


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
    from scipy.optimize import minimize_scalar

    check_signals(log, source, output)
    kept = log.times >= 0.5 * log.duration
    times, u, y = log.times[kept], log.inputs[source][kept], log.outputs[output][kept]
    step = float(np.median(np.diff(times)))
    grid = np.linspace(times[0], times[-1], len(times))
    spectrum = np.abs(np.fft.rfft(np.interp(grid, times, u - np.mean(u))))
    line = 2.0 * math.pi / (step * len(times))
    peak = line * float(np.argmax(spectrum))
    found = minimize_scalar(
        lambda w: fundamental(times, u, w)[1],
        bounds=(max(peak - line, 0.5 * line), peak + line),
        method="bounded",
        options={"xatol": 1e-7 * line},
    )
    frequency = float(found.x)
    if frequency * (times[-1] - times[0]) < 4.0 * math.pi:
        raise UserError(
            f"{log.path.name}: less than two periods of a sine in the second half of the log:"
            " record longer"
        )
    drive, _ = fundamental(times, u, frequency)
    answer, noise = fundamental(times, y, frequency)
    error = noise * math.sqrt(2.0 / len(times)) / abs(answer)
    held = hold(np.array([frequency]), step)[0]
    return frequency, complex(answer / (drive * held)), max(error, LEAST_SPREAD)
