"""Wild readings of a log, which no fit and no score is to see: row and size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.data.sensor import APART, outliers, usual_range

JUMP = 0.02  # change between two samples over the range above which a command excuses a peak
SMOOTH = 0.005  # median change over the range above which an input is noise or smooth, no steps
BEFORE = 2  # samples before such a jump at which a peak is an answer: stamps may be late
AFTER = 5  # samples after such a jump at which a peak is an answer
POSITIONS = ("m", "rad")  # units of what does not leap; rates, currents and voltages do
NAMED = 3  # outliers of an output that a sentence names, at most


class Outlier(NamedTuple):
    """A reading in ``row`` of the file that is ``size`` [SI] off the median of its neighbours."""

    row: int
    size: float


def outliers_of(log: Log, wire: Wire) -> tuple[Outlier, ...]:
    """Return the outliers of an output that a fit would see, the largest first.

    A peak beside a jump of a command is its answer, unless a position cannot get there.
    """
    if wire.flag:
        return ()
    log = log.readings
    values = log.outputs[wire.name]
    off = outliers(values, _answering(log) & ~_out_of_reach(values, wire))
    samples = [int(i) for i in np.flatnonzero((off != 0.0) & log.fitted)]
    samples.sort(key=lambda i: -abs(off[i]))
    return tuple(Outlier(int(log.rows[i]), float(off[i])) for i in samples)


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
    if wire.unit not in POSITIONS:
        return np.zeros(len(values), dtype=bool)
    low, high = usual_range(values)
    off, steps = np.abs(outliers(values)), np.abs(np.diff(values))
    others = steps[(off[1:] == 0.0) & (off[:-1] == 0.0)]
    leaps = off > APART * others.max(initial=0.0)
    return np.asarray((values > 2.0 * high - low) | (values < 2.0 * low - high) | leaps)


def without_outliers(log: Log, plant: Plant) -> Log:
    """Return a log whose outliers no fit and no score sees; its notes name them."""
    skipped = ~log.counted
    notes = []
    for name in log.outputs:
        wire = plant.wire[name]
        if outlying := outliers_of(log, wire):
            skipped |= np.isin(log.rows, [one.row for one in outlying])
            notes.append(_words(wire, outlying))
    return replace(log, skipped=skipped, notes=(*log.notes, *notes)) if notes else log


def told(wire: Wire, value: float) -> str:
    """Return a value [SI] in the unit that a person reads."""
    scale, unit = display(wire)
    return f"{scale * value:.4g} {unit}".rstrip()


def _words(wire: Wire, outlying: Sequence[Outlier]) -> str:
    shown = ", ".join(f"row {one.row} by {told(wire, one.size)}" for one in outlying[:NAMED])
    more = f" and {len(outlying) - NAMED} more" if len(outlying) > NAMED else ""
    rows = "these rows are" if len(outlying) > 1 else "this row is"
    return (
        f"'{wire.name}' jumps away from its neighbours and back: {shown}{more}; {rows} left out of"
        " fits and scores"
    )
