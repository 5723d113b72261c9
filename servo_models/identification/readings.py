"""What was measured beside what models make of it, in the unit that a person reads.

Used by the reports of identification and diagnosis.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isclose, isfinite
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.analysis.statistics import (
    autocorrelation,
    cross_correlation,
    dependence,
    memory,
    rms,
    whiteness,
)
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.identification.result import Accuracy
from servo_models.report.curves import (
    BUCKETS,
    DASHED,
    draw_frame,
    draw_legend,
    draw_responses,
    envelope,
)
from servo_models.report.numbers import Quantity, listed
from servo_models.report.sections import Cell, Picture, Table
from servo_models.report.style import SERIES, colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 8  # responses that are drawn; further ones are in the table only
NOTED = 5  # notes on logs that are told one by one
ZOOM = 8  # width of the zoomed panel, in times over which errors hang together
LARGEST = 0.1  # most of its width over the length of the log
FEWEST = 60  # samples in it at least
LAGS = 40  # lags of a correlation that are drawn at least; else twice as many as matter
SIGMAS_99 = 2.576  # standard deviations that hold 99 % of a normal distribution
RARE = 0.01  # probability below which errors are called dependent
LABELS = 5  # numbers on an axis of lags
RUNS_AWAY = "runs away"
IN_FILE = "after, in numbers of the file"


@dataclass(frozen=True, eq=False)
class Reading:
    """One output of one log, measured and simulated by several models.

    Attributes:
        log: it belongs to.
        wire: the output.
        measured: in the unit that a person reads, shape (n,).
        simulated: the same by the name of the model, the nominal one first and the one that is
            judged last; each of shape (n,).
    """

    log: Log
    wire: Wire
    measured: Array
    simulated: Mapping[str, Array]

    @property
    def unit(self) -> str:
        return display(self.wire)[1]

    @property
    def title(self) -> str:
        return f"{self.log.name}: {words(self.wire.name)}"

    @cached_property
    def error(self) -> Array:
        """What the model that is judged leaves, simulated minus measured, shape (n,)."""
        return list(self.simulated.values())[-1] - self.measured

    @property
    def beside(self) -> dict[str, Array]:
        """Measured and simulated, by name."""
        return {"measured": self.measured, **self.simulated}

    @property
    def moving(self) -> dict[str, Array]:
        """Inputs [SI] of the log that move, by name."""
        return {name: u for name, u in self.log.inputs.items() if np.ptp(u) > 0.0}

    def size(self, value: float) -> str:
        """Return a number in the unit of the reading, with it."""
        return str(Quantity(value, self.unit))

    def picture(self) -> Picture:
        """Return the whole log above the stretch around the largest error."""
        held = self.log.held_out
        worst = worst_sample(self.error, held if held.any() else ~held)
        part = stretch(self.error, worst)
        at = self.log.stamps[worst]

        def draw(panels: Sequence[Axes]) -> None:
            self._draw(panels[0], slice(None))
            draw_legend(panels[0], 1 + len(self.simulated))
            for zoom in panels[1:]:
                draw_frame(panels[0], self.log.stamps[part])
                self._draw(zoom, part)
                zoom.axvline(at, color=colour("muted"), lw=0.8, ls=DASHED)
            panels[-1].set_xlabel("time [s]")

        size = self.size(abs(float(self.error[worst])))
        text = f"Below: around the largest error that is left, {size} at {at:.6g} s."
        text += " Shaded: held out." * bool(held.any())
        return Picture(self.title, draw, text, rows=2, height=4.6)

    def _draw(self, axes: Axes, part: slice) -> None:
        log = self.log
        simulated = {name: values[part] for name, values in self.simulated.items()}
        draw_responses(axes, log.stamps[part], self.measured[part], simulated, log.held_out[part])
        axes.set_ylabel(axis_label(words(self.wire.name), self.unit), parse_math=False)


def reading(log: Log, wire: Wire, simulated: Mapping[str, Array]) -> Reading:
    """Return an output of a log beside what models [SI] make of it, by their names."""
    scale, _ = display(wire)
    curves = {name: scale * values for name, values in simulated.items()}
    return Reading(log, wire, scale * log.outputs[wire.name], curves)


def most_missed(every: Sequence[Reading], sigma: Mapping[str, float]) -> list[Reading]:
    """Return at most ``SHOWN`` readings with the largest RMS errors over ``sigma`` [SI] by
    output, the largest first."""
    missed = [rms(r.error) / (display(r.wire)[0] * sigma[r.wire.name]) for r in every]
    return [every[i] for i in np.argsort(missed, kind="stable")[::-1][:SHOWN]]


def draw_whiteness(panels: Sequence[Axes], every: Sequence[Reading]) -> None:
    """Draw the autocorrelation of what is left of some readings, and its correlation with inputs
    before, on two axes, each curve with the bounds of 99 % by chance.

    Source: Ljung, System Identification, 2nd ed., sec. 16.6.
    """
    own, others = panels
    count = max([LAGS, *(2 * memory(one.error) for one in every)])
    for one, tint in zip(every, SERIES * len(every)):
        values, bound = autocorrelation(one.error)[: count + 1], 1.0 / np.sqrt(len(one.error))
        _draw_lags(own, one, values, bound, words(one.wire.name), tint)
    pairs = [(one, name) for one in every for name in one.moving]
    for (one, name), tint in zip(pairs, SERIES * len(pairs)):
        values, bound = cross_correlation(one.error, one.moving[name], count)
        _draw_lags(others, one, values, bound, f"{words(one.wire.name)}, {words(name)}", tint)
    own.set_ylabel("auto-\ncorrelation")
    others.set_ylabel("correlation\nwith inputs before")
    own.set_ylim(None, 1.05)
    for axes, curves in ((own, len(every)), (others, len(pairs))):
        axes.set(xlabel="lag [s]", xlim=(0.0, None))
        axes.locator_params(axis="x", nbins=LABELS)
        if curves > 1:
            draw_legend(axes, curves)


def _draw_lags(
    axes: Axes, one: Reading, values: Array, deviation: float, label: str, tint: str
) -> None:
    seconds = np.arange(len(values)) * one.log.duration / (len(one.error) - 1)
    axes.plot(*envelope(seconds, values, BUCKETS), color=colour(tint), lw=1.2, label=label)
    for side in (SIGMAS_99, -SIGMAS_99):
        axes.axhline(side * deviation, color=colour(tint), lw=0.8, ls=DASHED)


def whiteness_text(every: Iterable[Reading]) -> str:
    """Return how ``draw_whiteness`` is read, and what tests over 25 lags say of each reading."""
    bounds = "Dashed: 99 % bounds for white errors, and for errors that no input moves."
    return " ".join([*map(_dependent, every), bounds])


def _dependent(one: Reading) -> str:
    white = whiteness(one.error) >= RARE
    over_time = "are white" if white else "hang together over time"
    inputs = [words(name) for name, u in one.moving.items() if dependence(one.error, u) < RARE]
    followed = f"follow {listed(inputs)}" if inputs else "follow no input beyond chance"
    return f"Errors of {words(one.wire.name)} {over_time} and {followed}."


def not_drawn(logs: Iterable[Log]) -> str:
    """Return a sentence on responses that are not drawn, "" if all are."""
    more = sum(len(log.outputs) for log in logs) - SHOWN
    if more <= 0:
        return ""
    return f"Drawn are the {SHOWN} with the largest errors; {more} more are in the table."


def log_notes(logs: Iterable[Log]) -> tuple[str, ...]:
    """Return what reading has changed of the logs, a sentence for each note."""
    notes = [f"Log '{log.name}': {note}." for log in logs for note in log.notes]
    more = len(notes) - NOTED
    return (*notes[:NOTED], f"And {more} more notes alike.") if more > 1 else tuple(notes)


def worst_sample(errors: Array, judged: Mask) -> int:
    """Return the sample with the largest error, of those that are judged."""
    return int(np.argmax(np.where(judged, np.abs(errors), -1.0)))


def stretch(errors: Array, worst: int) -> slice:
    """Return the samples around one that a zoomed panel shows."""
    n = len(errors)
    half = max(min(ZOOM * memory(errors), int(LARGEST * n)), FEWEST) // 2
    first = min(max(worst - half, 0), max(n - 2 * half, 0))
    return slice(first, min(first + 2 * half, n))


def error_table(title: str, rows: Sequence[Accuracy], plant: Plant) -> Table:
    """Return RMS errors by log, output and part, in the unit that a person reads.

    Where a file has other numbers, the error is in those as well.
    """
    columns = ("log", "output", "part", "samples", "RMS before", "RMS after", "fit", IN_FILE)
    scales = [display(plant.wire[row.output])[0] for row in rows]
    in_file = any(not isclose(s * row.column_scale, 1.0) for s, row in zip(scales, rows))
    width = len(columns) if in_file else len(columns) - 1
    cells = tuple(_error_row(row, plant.wire[row.output])[:width] for row in rows)
    return Table(title, columns[:width], cells)


def _error_row(row: Accuracy, wire: Wire) -> tuple[Cell, ...]:
    scale, unit = display(wire)
    return (
        row.log,
        words(row.output),
        row.part,
        row.samples,
        Quantity(scale * row.before, unit) if isfinite(row.before) else RUNS_AWAY,
        Quantity(scale * row.after, unit),
        Quantity(row.fit, "%", digits=5),
        Quantity(row.after / row.column_scale),
    )


def words(name: str) -> str:
    """Return a name as a person reads it."""
    return name.replace("_", " ")


def axis_label(name: str, unit: str) -> str:
    """Return the label of an axis, the unit on a line of its own."""
    return f"{name}\n[{unit}]" if unit else name


def log_facts(logs: Iterable[Log]) -> tuple[tuple[str, str], ...]:
    """Return file, hash, length, held-out share and constants of every log, by its name."""
    return tuple((f"log {log.name}", _log_text(log)) for log in logs)


def _log_text(log: Log) -> str:
    parts = [
        f"{log.path.name}, sha256 {log.sha256}",
        f"{len(log.times)} samples over {Quantity(log.duration, 's')}",
        f"{Quantity(100.0 * float(log.held_out.mean()), '%', digits=3)} held out",
    ]
    parts += [f"{name} = {Quantity(value, digits=6)} (SI)" for name, value in log.constants.items()]
    return "; ".join(parts)
