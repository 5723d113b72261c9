"""Report of transfer functions: the chosen one first, then its data, then all candidates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.sine_test import hold
from servo_models.core.types import Array, Complex
from servo_models.identification.doubts import judged
from servo_models.identification.measured_response import Record as Spectra
from servo_models.identification.measured_response import empirical
from servo_models.identification.readings import words
from servo_models.identification.transfer.choose import COLOURED, Candidate
from servo_models.identification.transfer.functions import TransferFunction
from servo_models.identification.transfer.identify import TransferResult
from servo_models.identification.transfer.measurements import Record, Sweep
from servo_models.report.curves import JUDGED, MEASURED, draw_curve, draw_legend, shade
from servo_models.report.numbers import ERROR, Quantity
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import colour
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Points = tuple[Array, Complex]
"""Frequencies [rad/s] and complex gain, SI."""

BODE = "Bode plot with the data"
CANDIDATES = "Candidates"
CONSTANTS = "Physical constants"
MARGIN = 1.5  # the curve goes on beyond the data by this factor


@document_of.register(TransferResult)
def _document(result: TransferResult) -> dict[str, Any]:
    constants = result.constants.estimates if result.constants else {}
    return {
        "source": result.source.name,
        "output": result.output.name,
        "chosen": result.chosen.name,
        "candidates": [_candidate(candidate) for candidate in result.candidates],
        "constants": {name: list(pair) for name, pair in constants.items()},
        "warnings": list(result.warnings),
        "interrupted": result.interrupted,
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    """Coefficients highest power first, SI, with standard errors in the order of the fit."""
    function, score = candidate.function, candidate.score
    return {
        "name": candidate.name,
        "numerator": list(function.numerator),
        "denominator": list(function.denominator),
        "delay": function.delay,
        "standard_errors": candidate.fit.standard_errors.tolist() if candidate.fit else None,
        "fit": score.fit,
        "held_out": score.held_out,
        "aic": candidate.aic,
        "bic": candidate.bic,
        "reason": candidate.reason,
    }


@report_of.register(TransferResult)
def _report(result: TransferResult, date: str = "") -> Report:
    return judged(transfer_report(result, date), result.warnings)


def transfer_report(result: TransferResult, date: str = "") -> Report:
    """Return the chosen function, its coefficients, all candidates and physical constants."""
    source, output, chosen = result.source, result.output, result.chosen
    text = "Where a record excites it, its spectrum stands beside the function."
    return Report(
        title=f"Transfer function from {source.name} [{source.unit}] to {output.name}"
        f" [{output.unit}]",
        sentence=f"{chosen.name}: G(s) = {chosen.function}",
        cards=(
            Card("function", _fits(chosen), section=BODE),
            Card("candidates", _verdicts(result.candidates), section=CANDIDATES),
            *_constants_card(result),
        ),
        remarks=tuple(f"Warning: {warning}." for warning in result.warnings),
        sections=(
            Section(BODE, pictures=(Picture(BODE, partial(_bode, result), text, 2, 5.0, 0, True),)),
            Section("Coefficients", tables=_coefficients(chosen), folded=True),
            Section("Poles and zeros", tables=(_roots(chosen.function),), folded=True),
            Section(CONSTANTS, tables=_constants(result), folded=True),
            Section(CANDIDATES, tables=(_candidates(result),), folded=True),
            Section("Responses", pictures=tuple(_responses(result)), folded=True),
        ),
        date=date,
    )


def _fits(chosen: Candidate) -> str:
    """How much of the data the chosen function describes."""
    score = chosen.score
    shares = [("fitted", score.fit), ("held-out", score.held_out)]
    lines = [f"{_share(s)} of the {name} samples" for name, s in shares if s is not None]
    if score.white is not None:
        lines.append(f"residuals white: {_passed(score.white)}")
    return "\n".join(lines) or "fitted to frequency responses"


def _verdicts(candidates: Sequence[Candidate]) -> str:
    faults = sum(bool(c.fault) for c in candidates)
    return f"{len(candidates)} tried, {faults} with a fault of poles or zeros"


def _constants_card(result: TransferResult) -> Iterator[Card]:
    if result.constants:
        constants = result.constants.constants.values()
        lines = (
            f"{c.name} {Quantity(c.value, error=c.standard_error)}"
            + ("" if c.determined else ", not determined")
            for c in constants
        )
        determined = all(c.determined for c in constants)
        yield Card("constants", "\n".join(lines), None if determined else False, CONSTANTS)


def _coefficients(chosen: Candidate) -> tuple[Table, ...]:
    if not chosen.fit:
        return ()
    structure = chosen.fit.structure
    names = [f"numerator, {_power(k)}" for k in range(structure.zeros, -1, -1)]
    names += [f"denominator, {_power(k)}" for k in range(structure.poles - 1, -1, -1)]
    names += ["delay [s]"] if structure.delay else []
    rows = tuple(
        (name, Quantity(value, error=error), f"{100.0 * error / abs(value):.2g} %")
        for name, value, error in zip(
            names, chosen.fit.coefficients.tolist(), chosen.fit.standard_errors.tolist()
        )
    )
    return (Table("", ("coefficient", f"value {ERROR} error", "error"), rows),)


def _power(k: int) -> str:
    return {0: "1", 1: "s"}.get(k, f"s^{k}")


def _roots(function: TransferFunction) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for kind, roots in (("pole", function.poles), ("zero", function.zeros)):
        for root in roots[roots.imag >= 0.0]:
            size = float(abs(root))
            shown = f"{root.real:.5g}" + (f" {ERROR}{root.imag:.5g}j" if root.imag else "")
            damping = Quantity(-root.real / size, digits=3) if root.imag else None
            rows.append((kind, shown, Quantity(size / (2.0 * np.pi), "Hz"), damping))
    return Table("", ("", "[rad/s]", "frequency", "damping ratio"), tuple(rows))


def _constants(result: TransferResult) -> tuple[Table, ...]:
    if not result.constants:
        return ()
    rows = []
    for c in result.constants.constants.values():
        half = 1.96 * c.standard_error if c.standard_error is not None else 0.0
        limits = (c.value - half, c.value + half) if half else None
        shown = Quantity(c.value, error=c.standard_error, interval=limits, digits=5)
        rows.append((c.name, shown, "" if c.determined else Mark("not determined", False)))
    return (Table("", ("constant, SI", f"value {ERROR} error (95 % interval)", ""), tuple(rows)),)


def _candidates(result: TransferResult) -> Table:
    unit = result.output.display or result.output.unit
    scale = factor(result.output.unit, unit)
    records = [data.name for data in result.measurements if isinstance(data, Record)]
    least = [min(getattr(c, key) for c in result.candidates) for key in ("aic", "bic")]
    hidden = any(c.score.held_out is not None for c in result.candidates)

    def row(c: Candidate) -> tuple[Cell, ...]:
        rms = [c.score.rms[name] for name in records if name in c.score.rms]
        pooled = scale * float(np.sqrt(np.mean(np.square(rms)))) if rms else None
        return (
            c.name,
            _share(c.score.fit),
            None if pooled is None else Quantity(pooled, unit),
            *((_share(c.score.held_out),) if hidden else ()),
            Quantity(c.aic - least[0]),
            Quantity(c.bic - least[1]),
            _passed(c.score.white),
            _passed(c.score.independent),
            Mark(f"rejected: {c.reason}", None) if c.reason else Mark("chosen", True),
        )

    columns = (
        "structure",
        "fit",
        "RMS",
        *(("held out",) if hidden else ()),
        "AIC above least",
        "BIC above least",
        "white",
        "free of input",
        "verdict",
    )
    return Table("", columns, tuple(row(c) for c in result.candidates))


def _share(part: float | None) -> Quantity | None:
    return None if part is None else Quantity(100.0 * part, "%")


def _passed(chance: float | None) -> str:
    if chance is None:
        return ""
    return "yes" if chance >= COLOURED else "no"


def _bode(result: TransferResult, axes: Sequence[Axes]) -> None:
    """Draw gain and phase of the chosen function, of the sweeps and of the records' spectra."""
    from matplotlib.ticker import LogFormatter, MultipleLocator

    gain, phase = axes
    function = result.chosen.function
    sweeps = [(e.frequencies, e.response) for e in result.measurements if isinstance(e, Sweep)]
    spectra = _spectra(result)
    every = np.concatenate([w for w, _ in [*sweeps, *spectra]] or [np.abs(function.poles)])
    frequencies = np.geomspace(every.min() / MARGIN, every.max() * MARGIN, 500)
    unit_in, unit_out = (w.display or w.unit for w in (result.source, result.output))
    scale = factor(result.output.unit, unit_out) / factor(result.source.unit, unit_in)
    for label, group, series, marker in (
        ("records", spectra, "orange", "."),
        ("sweep", sweeps, "green", "o"),
    ):
        style: dict[str, Any] = {"ls": "", "marker": marker, "color": colour(series), "mfc": "none"}
        for k, (w, values) in enumerate(group):
            hertz = w / (2.0 * np.pi)
            gain.plot(hertz, _decibel(scale * values), **style, label=label if k == 0 else None)
            off = np.angle(values / function.response(w))
            phase.plot(hertz, np.degrees(function.phase(w) + off), **style)
    hertz = frequencies / (2.0 * np.pi)
    line = scale * function.response(frequencies)
    gain.plot(hertz, _decibel(line), color=colour("blue"), label="chosen")
    phase.plot(hertz, np.degrees(function.phase(frequencies)), color=colour("blue"))
    gain.set(xscale="log", ylabel=f"gain [dB re 1 {unit_out}/{unit_in}]")
    phase.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
    phase.yaxis.set_major_locator(MultipleLocator(90.0))
    phase.xaxis.set_major_formatter(LogFormatter())
    gain.legend(frameon=False, fontsize=8.5)


def _spectra(result: TransferResult) -> list[Points]:
    """Response of the records where they excite it, with the hold of their inputs taken out."""
    records = [r for r in result.measurements if isinstance(r, Record)]
    if not records:
        return []
    function = result.chosen.function
    spectra = [Spectra(r.times, r.given, r.measured, r.response(function)) for r in records]
    step = max(r.step for r in records)
    measured = empirical(spectra, step)
    if measured is None:
        return []
    frequencies = 2.0 * np.pi * measured.hertz
    return [(frequencies, measured.measured / hold(frequencies, step))]


def _decibel(values: Complex) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(values)))


def _responses(result: TransferResult) -> Iterator[Picture]:
    """Every record with the response of the chosen function, and the error."""
    for data in result.measurements:
        if isinstance(data, Record):
            title = f"'{data.name}': measured, and as '{result.chosen.name}' has it"
            shaded = "; shaded: held out" if data.held_out.any() else ""
            draw = partial(_response, data, result)
            yield Picture(f"{title}{shaded}", draw, rows=2, height=5.0, shared=True)


def _response(record: Record, result: TransferResult, axes: Sequence[Axes]) -> None:
    wire, (curves, error) = result.output, axes
    unit = wire.display or wire.unit
    scale = factor(wire.unit, unit)
    modelled = record.response(result.chosen.function)
    draw_curve(curves, record.times, scale * record.measured, "measured", MEASURED)
    draw_curve(curves, record.times, scale * modelled, "chosen", JUDGED)
    draw_curve(error, record.times, scale * (modelled - record.measured), "chosen", JUDGED)
    error.axhline(0.0, color=colour("muted"), lw=0.8)
    for panel in axes:
        shade(panel, record.times, record.held_out)
    draw_legend(curves, 2)
    curves.set_ylabel(f"{words(wire.name)} [{unit}]", parse_math=False)
    error.set_ylabel(f"error [{unit}]", parse_math=False)
    error.set_xlabel("time [s]")
