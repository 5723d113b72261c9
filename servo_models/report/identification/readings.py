"""What was measured and simulated, in the numbers of the log's author."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.identification.result import FIT, HELD_OUT, Identification
from servo_models.recording import Log
from servo_models.report.parts import TIMES, number
from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]

BUCKETS = 400
"""Stretches of a long curve of which extremes are drawn, about one a pixel."""
SHOWN = 8
"""Responses that are drawn; further ones are in the table only."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One output of one log, measured and simulated before and after the fit.

    Attributes:
        log: it belongs to.
        output: its name.
        unit: of ``measured``, ``before`` and ``after``, in words of the log's author.
        scale: SI per that unit.
        measured, before, after: shape (n,).
    """

    log: Log
    output: str
    unit: str
    scale: float
    measured: Array
    before: Array
    after: Array

    @cached_property
    def error(self) -> Array:
        """Simulated minus measured, after the fit, shape (n,)."""
        return self.after - self.measured

    @property
    def title(self) -> str:
        return f"{self.log.name}: {words(self.output)}"


def readings(found: Identification) -> list[Reading]:
    """Return every output of every log, in their order."""
    return [
        _reading(log, output, old[output], new[output])
        for log, old, new in zip(found.logs, found.before, found.after)
        for output in log.outputs
    ]


def _reading(log: Log, output: str, before: Array, after: Array) -> Reading:
    unit, scale = unit_of(log, output)
    measured = log.outputs[output]
    return Reading(log, output, unit, scale, measured / scale, before / scale, after / scale)


def unit_of(log: Log, output: str) -> tuple[str, float]:
    """Return the unit of an output in a log's file, and its size in SI."""
    channel = log.channels[output]
    return channel.unit, abs(channel.scale)


def drawn(found: Identification) -> list[Reading]:
    """Return the readings to be drawn: all, or those that the fitted model misses most."""
    every = readings(found)
    weights = [
        float(np.sqrt(np.mean(reading.error**2))) * reading.scale / found.sigma[reading.output]
        for reading in every
    ]
    worst = sorted(np.argsort(weights)[::-1][:SHOWN])
    return [every[i] for i in worst]


def not_drawn(found: Identification) -> str:
    """Return a sentence on responses that are not drawn, "" if all are."""
    left = sum(len(log.outputs) for log in found.logs) - SHOWN
    if left <= 0:
        return ""
    return f"Drawn are the {SHOWN} with the largest errors; {left} more are in the table."


def judged_part(found: Identification, output: str) -> str:
    """Return the part that judges an output: held out, if any of it was."""
    parts = {row.part for row in found.accuracy if row.output == output}
    return HELD_OUT if HELD_OUT in parts else FIT


def shade_held_out(axes: Axes, log: Log, part: slice) -> None:
    """Shade the stretches of a part of a log that no fit has seen."""
    times, mask = log.times[part], log.held_out[part]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    for first, end in edges.reshape(-1, 2):
        axes.axvspan(times[first], times[end - 1], color=colour("grid"), alpha=0.6, lw=0, zorder=0)


def envelope(times: Array, values: Array, buckets: int) -> tuple[Array, Array]:
    """Return the ends, and the extremes of each of ``buckets`` stretches, of a long curve."""
    n = len(values)
    if n <= 2 * buckets:
        return times, values
    starts = np.linspace(0, n, buckets, endpoint=False).astype(int)
    ends = np.append(starts[1:], n)
    kept = {0, n - 1}
    for start, end in zip(starts, ends):
        piece = values[start:end]
        kept |= {start + int(piece.argmin()), start + int(piece.argmax())}
    chosen = sorted(kept)
    return times[chosen], values[chosen]


def words(name: str) -> str:
    """Return a name as a person reads it."""
    return name.replace("_", " ")


def in_unit(value: float, unit: str) -> str:
    """Return a number with the unit of a log; counts of 7.75 deg/s read 4.5 x 7.75 deg/s."""
    return with_unit(number(value), unit)


def with_unit(text: str, unit: str) -> str:
    """Return a text of numbers with the unit of a log behind it."""
    if unit == "1":
        return text
    return f"{text} {TIMES} {unit}" if unit[:1].isdigit() else f"{text} {unit}"


def spread_of(found: Identification, output: str, part: str) -> float:
    """Return the range [SI] that an output covers over all logs of a part."""
    pieces: Sequence[Array] = [
        log.outputs[output][log.held_out if part == HELD_OUT else ~log.held_out]
        for log in found.logs
        if output in log.outputs
    ]
    whole = np.concatenate(pieces)
    return float(np.ptp(whole))
