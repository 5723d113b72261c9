"""Single readings that lie far from their neighbours: row and size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.data.reading_steps import reading_step
from servo_models.units import factor

WINDOW = 5  # readings of a running median; it passes over up to two neighbouring outliers
APART = 5.0
"""An outlier is this many times as far from its neighbours as any other reading, or step."""
LEAST_SHARE = 0.02  # of the range of most readings: less than that harms no fit
MOST = 0.01  # share of the readings that may be outliers: more of them belong to the signal
FEW = 5  # readings that may be outliers in a log however short
JUMP = 0.02  # of its range: a command that moves so far between two samples excuses a peak
SMOOTH = 0.005  # of its range: an input that moves so far between most samples is noise or smooth
BEFORE, AFTER = 2, 5
"""Samples before and after such a jump at which a peak is an answer; stamps may be late."""
POSITIONS = ("m", "rad")  # units of what does not leap; rates, currents and voltages do
NAMED = 3  # outliers of an output that a sentence names


class Outlier(NamedTuple):
    """A reading in ``row`` of the file that is ``size`` [SI] off the median of its neighbours."""

    row: int
    size: float


def off_neighbours(values: Array) -> Array:
    """Return how far readings lie off the running median, shape (n,); 0 where there are few."""
    if len(values) < WINDOW:
        return np.zeros(len(values))
    ends = np.pad(values, WINDOW // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(ends, WINDOW)
    return np.asarray(values - np.median(windows, axis=1))


def outliers(values: Array, excused: Mask | None = None) -> Array:
    """Return by how much outliers lie off the running median, 0 for all other readings.

    Edges and ramps pass a median of five unharmed (Tukey, Exploratory Data Analysis, 1977,
    ch. 7), so that what is left is noise, peaks and outliers; these stand out of the rest.

    Args:
        values: readings in the order of time, shape (n,).
        excused: where a peak is none, shape (n,).

    Returns:
        Distances with their sign, shape (n,).
    """
    off = off_neighbours(values)
    if len(values) < WINDOW:
        return off
    if excused is not None:
        off[excused] = 0.0
    sizes = np.sort(np.abs(off))[::-1]
    most = min(max(FEW, int(MOST * len(values))), len(values) - 1)
    low, high = np.percentile(values, [1.0, 99.0])
    least = max(reading_step(values).size, LEAST_SHARE * float(high - low) / APART)
    apart = np.flatnonzero(sizes[:most] > APART * np.maximum(sizes[1 : most + 1], least))
    bar = sizes[apart[-1]] if len(apart) else np.inf
    return np.where(np.abs(off) >= bar, off, 0.0)


def outliers_of(log: Log, wire: Wire) -> tuple[Outlier, ...]:
    """Return the outliers of an output that a fit would see, the largest first.

    A peak beside a jump of a command is its answer, unless a position cannot get there.
    """
    if wire.flag:
        return ()
    values = log.outputs[wire.name]
    off = outliers(values, _answering(log) & ~_out_of_reach(values, wire))
    found = [int(i) for i in np.flatnonzero((off != 0.0) & log.fitted)]
    found.sort(key=lambda i: -abs(off[i]))
    return tuple(Outlier(int(log.rows[i]), float(off[i])) for i in found)


def _answering(log: Log) -> Mask:
    """Mark samples beside a jump of a command."""
    marked = np.zeros(len(log.times), dtype=bool)
    for values in log.inputs.values():
        moves = np.abs(np.diff(values))
        if np.median(moves) > SMOOTH * np.ptp(values):
            continue
        jumps = np.flatnonzero(moves > JUMP * np.ptp(values)) + 1
        for shift in range(-BEFORE, AFTER + 1):
            marked[np.clip(jumps + shift, 0, len(marked) - 1)] = True
    return marked


def _out_of_reach(values: Array, wire: Wire) -> Mask:
    """Mark positions outside the range of most others by more than that range, and those that come
    and go far faster than any other does."""
    if wire.unit not in POSITIONS or len(values) < WINDOW:
        return np.zeros(len(values), dtype=bool)
    low, high = np.percentile(values, [1.0, 99.0])
    off, steps = np.abs(outliers(values)), np.abs(np.diff(values))
    others = steps[(off[1:] == 0.0) & (off[:-1] == 0.0)]
    leaps = off > APART * others.max(initial=0.0)
    return np.asarray((values > 2.0 * high - low) | (values < 2.0 * low - high) | leaps)


def without_outliers(log: Log, plant: Plant) -> Log:
    """Return a log whose outliers no fit and no score sees; its notes name them."""
    skipped = np.zeros(len(log.times), dtype=bool) if log.skipped is None else log.skipped.copy()
    notes = []
    for name in log.outputs:
        wire = plant.wire[name]
        if found := outliers_of(log, wire):
            skipped |= np.isin(log.rows, [one.row for one in found])
            notes.append(_words(wire, found))
    return replace(log, skipped=skipped, notes=(*log.notes, *notes)) if notes else log


def _words(wire: Wire, found: Sequence[Outlier]) -> str:
    unit = wire.display or wire.unit
    shown = ", ".join(
        f"row {one.row} by {one.size * factor(wire.unit, unit):.4g} {unit}".strip()
        for one in found[:NAMED]
    )
    more = f" and {len(found) - NAMED} more" if len(found) > NAMED else ""
    rows = "these rows are" if len(found) > 1 else "this row is"
    return (
        f"'{wire.name}' jumps away from its neighbours and back: {shown}{more}; {rows} left out of"
        " fits and scores"
    )
