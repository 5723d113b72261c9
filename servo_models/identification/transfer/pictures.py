"""An identified transfer function beside its data: over frequency, and over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.sine_test import hold
from servo_models.core.types import Array, Complex
from servo_models.identification.measured_response import Record as Spectra
from servo_models.identification.measured_response import empirical
from servo_models.identification.readings import words
from servo_models.identification.transfer.evidence import Record, Sweep
from servo_models.identification.transfer.identify import TransferResult
from servo_models.report.curves import BUCKETS, envelope, shade
from servo_models.report.style import colour, drawing
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Points = tuple[Array, Complex]
"""Frequencies [rad/s] and complex gain, SI."""

WIDTH, HEIGHT = 7.0, 5.0
"""Of the figure [inch]."""
MARGIN = 1.5
"""The curve goes on beyond the data by this factor."""


def bode(result: TransferResult) -> Figure:
    """Draw gain and phase of the chosen function, of the sweeps and of the records' spectra."""
    from matplotlib.ticker import LogFormatter, MultipleLocator

    chosen = result.chosen
    sweeps = [e for e in result.evidence if isinstance(e, Sweep)]
    points = [(s.frequencies, s.response) for s in sweeps]
    spectra = _spectra(result)
    every = np.concatenate([w for w, _ in [*points, *spectra]] or [np.abs(chosen.function.poles)])
    frequencies = np.geomspace(every.min() / MARGIN, every.max() * MARGIN, 500)
    unit_in, unit_out = (w.display or w.unit for w in (result.source, result.output))
    scale = factor(result.output.unit, unit_out) / factor(result.source.unit, unit_in)
    with drawing("bode", rows=2, height=HEIGHT) as (figure, (gain, phase)):
        figure.set_size_inches(WIDTH, HEIGHT)
        figure.set_facecolor(colour("paper"))
        title = f"{chosen.name}, {result.source.name} to {result.output.name}"
        figure.suptitle(title, x=0.01, ha="left", size=11, weight="bold")
        kinds = (("records", spectra, "orange", "."), ("sweep", points, "green", "o"))
        for label, group, series, marker in kinds:
            for k, (w, values) in enumerate(group):
                style: dict[str, Any] = {
                    "ls": "",
                    "marker": marker,
                    "color": colour(series),
                    "mfc": "none",
                }
                hertz = w / (2.0 * np.pi)
                gain.plot(hertz, _decibel(scale * values), **style, label=label if k == 0 else None)
                off = np.angle(values / chosen.function.response(w))
                phase.plot(hertz, np.degrees(chosen.function.phase(w) + off), **style)
        line = chosen.function.response(frequencies)
        hertz = frequencies / (2.0 * np.pi)
        gain.plot(hertz, _decibel(scale * line), color=colour("blue"), label="chosen")
        phase.plot(hertz, np.degrees(chosen.function.phase(frequencies)), color=colour("blue"))
        gain.set(xscale="log", ylabel=f"gain [dB re 1 {unit_out}/{unit_in}]")
        phase.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
        phase.yaxis.set_major_locator(MultipleLocator(90.0))
        phase.xaxis.set_major_formatter(LogFormatter())
        gain.legend(frameon=False, fontsize=8.5)
        return figure


def responses(result: TransferResult) -> dict[str, Figure]:
    """Draw every record with the response of the chosen function, and the error, by caption."""
    records = [one for one in result.evidence if isinstance(one, Record)]
    found = {}
    for k, one in enumerate(records):
        caption = f"'{one.name}': measured, and as '{result.chosen.name}' has it"
        shaded = "; shaded: held out" if one.held_out.any() else ""
        found[f"{caption}{shaded}"] = _response(one, result, f"response-{k}")
    return found


def _response(record: Record, result: TransferResult, name: str) -> Figure:
    wire = result.output
    unit = wire.display or wire.unit
    scale = factor(wire.unit, unit)
    modelled = record.response(result.chosen.function)
    with drawing(name, rows=2, height=HEIGHT) as (figure, (curves, error)):
        figure.set_size_inches(WIDTH, HEIGHT)
        figure.set_facecolor(colour("paper"))
        seen = envelope(record.times, scale * record.measured, BUCKETS)
        curves.plot(*seen, color=colour("muted"), lw=3.0, alpha=0.55, label="measured")
        line = envelope(record.times, scale * modelled, BUCKETS)
        curves.plot(*line, color=colour("blue"), lw=1.1, label="chosen")
        off = envelope(record.times, scale * (modelled - record.measured), BUCKETS)
        error.plot(*off, color=colour("blue"), lw=0.8)
        error.axhline(0.0, color=colour("muted"), lw=0.8)
        for axes in (curves, error):
            shade(axes, record.times, record.held_out)
        curves.set_ylabel(f"{words(wire.name)} [{unit}]", parse_math=False)
        error.set_ylabel(f"error [{unit}]", parse_math=False)
        error.set_xlabel("time [s]")
        curves.legend(frameon=False, fontsize=8.5)
        return figure


def _spectra(result: TransferResult) -> list[Points]:
    """Response of the records where they excite it, with the hold of their inputs taken out."""
    records = [r for r in result.evidence if isinstance(r, Record)]
    if not records:
        return []
    function = result.chosen.function
    spectra = [Spectra(r.times, r.given, r.measured, r.response(function)) for r in records]
    step = max(r.step for r in records)
    seen = empirical(spectra, step)
    if seen is None:
        return []
    frequencies = 2.0 * np.pi * seen.hertz
    return [(frequencies, seen.measured / hold(frequencies, step))]


def _decibel(values: Complex) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(values)))
