"""Frequency responses from tables of gain and phase."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from servo_models.core.plant import Plant, unknown
from servo_models.core.types import Array
from servo_models.data.readers import Columns, read_columns
from servo_models.data.schema import Column, Number, Section, Table
from servo_models.errors import UserError, told_at
from servo_models.identification.transfer.measurements import Sweep
from servo_models.units import exponents, factor, parse

LEAST_POINTS = 4


class Frequency(Table):
    """The column of the frequencies."""

    column: Column
    unit: str = "Hz"


class Gain(Frequency):
    """The column of the gains; ``unit`` is SI where it is left out."""

    unit: str = ""
    reference: str = "1"


class Phase(Frequency):
    """The column of the phases; ``sign`` is -1 for lags."""

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


def read_sweeps(document: Section, base: Path, plant: Plant) -> tuple[Sweep, ...]:
    """Read the frequency responses of a description, its ``[[sweeps]]``, from files in ``base``;
    the plant says which inputs and outputs there are, and their units.

    Raises:
        UserError: an unknown key, signal or column, a unit that does not convert, fewer than
            ``LEAST_POINTS`` points, a frequency or gain that is not above 0.
    """
    sweeps = [_read(entry, base, plant) for entry in document.sections("sweeps")]
    names = [sweep.name for sweep in sweeps]
    return tuple(
        replace(sweep, name=f"{sweep.name} ({k})") if names.count(sweep.name) > 1 else sweep
        for k, sweep in enumerate(sweeps, start=1)
    )


def _read(section: Section, base: Path, plant: Plant) -> Sweep:
    entry = section.read(SweepTable)
    inputs = {wire.name: wire for wire in plant.inputs}
    outputs = {name: plant.wire[name] for name in plant.outputs}
    for kind, name, known in (("input", entry.input, inputs), ("output", entry.output, outputs)):
        if name not in known:
            section.fail(kind, unknown(kind, name, known))
    cells = read_columns(base / entry.file, entry.table or None)
    place = f"'{section.file}', {section.name}"
    with told_at(f"{place}.frequency.unit"):
        angular = "rad" in exponents(entry.frequency.unit)[1]
    unit, turn = ("rad/s", 1.0) if angular else ("Hz", 2.0 * math.pi)
    frequencies = turn * _numbers(place, "frequency", cells, entry.frequency, unit)
    if len(frequencies) < LEAST_POINTS:
        section.fail("file", f"{len(frequencies)} points: a sweep needs {LEAST_POINTS} at least")
    phases = entry.phase.sign * _numbers(place, "phase", cells, entry.phase, "rad")
    unit = f"({outputs[entry.output].unit})/({inputs[entry.input].unit})"
    if entry.gain.unit == "dB":
        with told_at(f"{place}.gain.reference"):
            reference = parse(entry.gain.reference, unit)
        gains = np.asarray(reference * 10.0 ** (cells.numbers(entry.gain.column) / 20.0))
    else:
        gains = _numbers(place, "gain", cells, entry.gain, unit)
    hidden = np.full(len(phases), entry.held_out)
    ends = entry.file, entry.input, entry.output
    return Sweep(*ends, frequencies, gains * np.exp(1j * phases), hidden)


def _numbers(place: str, key: str, cells: Columns, given: Frequency, unit: str) -> Array:
    """A column in ``unit``; all but phases are above 0."""
    with told_at(f"{place}.{key}.unit"):
        scale = factor(given.unit or unit, unit)
    values = scale * cells.numbers(given.column)
    bad = np.flatnonzero(values <= 0.0)
    if len(bad) and key != "phase":
        where = cells.where(given.column, int(bad[0]))
        raise UserError(f"{where} is not above 0: remove the row or correct the unit")
    return values
