"""What was measured and simulated, in the numbers of the log's author."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.identification.result import FIT, HELD_OUT, Identification
from servo_models.report.parts import TIMES, number
from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes


BUCKETS = 400
"""Stretches of a long curve of which extremes are drawn, about one a pixel."""
SHOWN = 8
"""Responses that are drawn; further ones are in the table only."""


@dataclass(frozen=True, eq=False)
class Reading:
    """One output of one log, measured and simulated by several models.

    Attributes:
        log: it belongs to.
        output: its name.
        unit: of ``measured`` and ``simulated``, in words of the log's author.
        scale: SI per that unit.
        measured: shape (n,).
        simulated: by the name of the model, the nominal one first and the one that is judged
            last; each of shape (n,).
    """

    log: Log
    output: str
    unit: str
    scale: float
    measured: Array
    simulated: Mapping[str, Array]

    @cached_property
    def error(self) -> Array:
        """What the model that is judged leaves, simulated minus measured, shape (n,)."""
        return list(self.simulated.values())[-1] - self.measured

    @property
    def title(self) -> str:
        return f"{self.log.name}: {words(self.output)}"


def readings(found: Identification) -> list[Reading]:
    """Return every output of every log, in their order."""
    return [
        reading(log, output, {"nominal": old[output], "fitted": new[output]})
        for log, old, new in zip(found.logs, found.before, found.after)
        for output in log.outputs
    ]


def reading(log: Log, output: str, simulated: Mapping[str, Array]) -> Reading:
    """Return an output of a log beside what models [SI] make of it, by their names."""
    unit, scale = unit_of(log, output)
    curves = {name: values / scale for name, values in simulated.items()}
    return Reading(log, output, unit, scale, log.outputs[output] / scale, curves)


def unit_of(log: Log, output: str) -> tuple[str, float]:
    """Return the unit of an output in a log's file, and its size in SI."""
    channel = log.channels[output]
    return channel.unit, abs(channel.scale)


def unit_among(logs: Iterable[Log], output: str) -> tuple[str, float]:
    """Return the unit of an output in the first log that has it, and its size in SI."""
    return unit_of(next(log for log in logs if output in log.outputs), output)


def drawn(found: Identification) -> list[Reading]:
    """Return the readings to be drawn: all, or those that the fitted model misses most."""
    return most_missed(readings(found), found.sigma)


def most_missed(every: Sequence[Reading], sigma: Mapping[str, float]) -> list[Reading]:
    """Return the readings with the largest errors over ``sigma`` [SI] by output, in order."""
    weights = [
        float(np.sqrt(np.mean(one.error**2))) * one.scale / sigma[one.output] for one in every
    ]
    worst = sorted(np.argsort(weights)[::-1][:SHOWN])
    return [every[i] for i in worst]


def not_drawn(logs: Iterable[Log]) -> str:
    """Return a sentence on responses that are not drawn, "" if all are."""
    left = sum(len(log.outputs) for log in logs) - SHOWN
    if left <= 0:
        return ""
    return f"Drawn are the {SHOWN} with the largest errors; {left} more are in the table."


def judged_part(found: Identification, output: str) -> str:
    """Return the part that judges an output: held out, if any of it was."""
    parts = {row.part for row in found.accuracy if row.output == output}
    return HELD_OUT if HELD_OUT in parts else FIT


def shade_held_out(axes: Axes, log: Log, part: slice) -> None:
    """Shade the stretches of a part of a log that no fit has seen."""
    shade(axes, log.stamps[part], log.held_out[part])


def shade(axes: Axes, times: Array, mask: Mask) -> None:
    """Shade the stretches in which ``mask`` holds."""
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
