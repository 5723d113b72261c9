"""Report of transfer functions: the chosen one first, then its data, then all candidates."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.sine_test import hold
from servo_models.core.types import Array, Complex
from servo_models.identification.doubts import judged
from servo_models.identification.grey_box import Constant
from servo_models.identification.measured_response import Record as Spectra
from servo_models.identification.measured_response import empirical
from servo_models.identification.readings import words
from servo_models.identification.transfer.functions import TransferFunction
from servo_models.identification.transfer.identify import COLOURED, Candidate, TransferResult
from servo_models.identification.transfer.measurements import Record, Sweep
from servo_models.report.curves import JUDGED, MEASURED, draw_curve, draw_legend, shade
from servo_models.report.numbers import ERROR, Quantity
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import colour
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BODE = "Bode plot with the data"
CANDIDATES = "Candidates"
CONSTANTS = "Physical constants"


@document_of.register(TransferResult)
def _document(result: TransferResult) -> dict[str, Any]:
    """Coefficients highest power first, SI, with standard errors in the order of the fit."""
    candidates = [
        {
            "name": c.name,
            "numerator": list(c.function.numerator),
            "denominator": list(c.function.denominator),
            "delay": c.function.delay,
            "standard_errors": None if c.standard_errors is None else c.standard_errors.tolist(),
            **{key: getattr(c, key) for key in ("fit", "held_out", "aic", "bic", "reason")},
        }
        for c in result.candidates
    ]
    constants = result.constants.estimates if result.constants else {}
    return {
        "source": result.source.name,
        "output": result.output.name,
        "chosen": result.chosen.name,
        "candidates": candidates,
        "constants": {name: list(pair) for name, pair in constants.items()},
        "warnings": list(result.warnings),
        "interrupted": result.interrupted,
    }


@report_of.register(TransferResult)
def _report(result: TransferResult, date: str = "") -> Report:
    """Return the chosen function, its coefficients, all candidates and physical constants."""
    source, output, chosen = result.source, result.output, result.chosen
    constants = list(result.constants.constants.values()) if result.constants else []
    text = "Where a record excites it, its spectrum stands beside the function."
    bode = Picture(BODE, partial(_bode, result), text, rows=2, height=5.0, shared=True)
    records = [data for data in result.measurements if isinstance(data, Record)]
    shares = [("fitted", chosen.fit), ("held-out", chosen.held_out)]
    described = [f"{_share(s)} of the {name} samples" for name, s in shares if s is not None]
    if chosen.white is not None:
        described.append(f"residuals white: {_passed(chosen.white)}")
    faults = sum(bool(c.fault) for c in result.candidates)
    verdicts = f"{len(result.candidates)} tried, {faults} with a fault of poles or zeros"
    cards = [
        Card("function", "\n".join(described) or "fitted to frequency responses", section=BODE),
        Card("candidates", verdicts, section=CANDIDATES),
    ]
    if constants:
        values = [f"{c.name} {Quantity(c.value, error=c.standard_error)}" for c in constants]
        lines = [v + ", not determined" * (not c.determined) for v, c in zip(values, constants)]
        passed = None if all(c.determined for c in constants) else False
        cards.append(Card("constants", "\n".join(lines), passed, CONSTANTS))
    tables = {
        "Coefficients": _coefficients(chosen),
        "Poles and zeros": _roots(chosen.function),
        CONSTANTS: _constants(constants),
        CANDIDATES: _candidates(result, [record.name for record in records]),
    }
    report = Report(
        title=f"Transfer function from {source.name} [{source.unit}] to {output.name}"
        f" [{output.unit}]",
        sentence=f"{chosen.name}: G(s) = {chosen.function}",
        cards=tuple(cards),
        remarks=tuple(f"Warning: {warning}." for warning in result.warnings),
        sections=(
            Section(BODE, pictures=(bode,)),
            *(Section(title, tables=(table,), folded=True) for title, table in tables.items()),
            Section("Responses", pictures=tuple(_picture(result, r) for r in records), folded=True),
        ),
        date=date,
    )
    return judged(report, result.warnings)


def _coefficients(chosen: Candidate) -> Table:
    """Nothing for a function that was given."""
    structure, errors = chosen.function.structure, chosen.standard_errors
    powers = ["1", "s", *(f"s^{k}" for k in range(2, structure.poles))]
    names = [f"numerator, {power}" for power in powers[structure.zeros :: -1]]
    names += [f"denominator, {power}" for power in powers[structure.poles - 1 :: -1]]
    pairs = zip(chosen.function.coefficients.tolist(), [] if errors is None else errors.tolist())
    rows = tuple(
        (name, Quantity(value, error=error), f"{100.0 * error / abs(value):.2g} %")
        for name, (value, error) in zip([*names, "delay [s]"], pairs)
    )
    return Table("", ("coefficient", f"value {ERROR} error", "error"), rows)


def _roots(function: TransferFunction) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for kind, roots in (("pole", function.poles), ("zero", function.zeros)):
        for root in roots[roots.imag >= 0.0]:
            size = float(abs(root))
            shown = f"{root.real:.5g}" + (f" {ERROR}{root.imag:.5g}j" if root.imag else "")
            damping = Quantity(-root.real / size, digits=3) if root.imag else None
            rows.append((kind, shown, Quantity(size / (2.0 * np.pi), "Hz"), damping))
    return Table("", ("", "[rad/s]", "frequency", "damping ratio"), tuple(rows))


def _constants(constants: Sequence[Constant]) -> Table:
    rows = []
    for c in constants:
        half = 1.96 * (c.standard_error or 0.0)
        limits = (c.value - half, c.value + half) if half else None
        shown = Quantity(c.value, error=c.standard_error, interval=limits, digits=5)
        rows.append((c.name, shown, "" if c.determined else Mark("not determined", False)))
    return Table("", ("constant, SI", f"value {ERROR} error (95 % interval)", ""), tuple(rows))


def _candidates(result: TransferResult, records: Sequence[str]) -> Table:
    candidates, unit = result.candidates, result.output.display or result.output.unit
    scale = factor(result.output.unit, unit)
    aic, bic = min(c.aic for c in candidates), min(c.bic for c in candidates)
    hidden = any(c.held_out is not None for c in candidates)
    rows: list[tuple[Cell, ...]] = []
    for c in candidates:
        rms = [scale * c.rms[name] for name in records if name in c.rms]
        row = (
            c.name,
            _share(c.fit),
            Quantity(float(np.sqrt(np.mean(np.square(rms)))), unit) if rms else None,
            *[_share(c.held_out)] * hidden,
            Quantity(c.aic - aic),
            Quantity(c.bic - bic),
            _passed(c.white),
            _passed(c.independent),
            Mark(f"rejected: {c.reason}", None) if c.reason else Mark("chosen", True),
        )
        rows.append(row)
    judgements = ("AIC above least", "BIC above least", "white", "free of input", "verdict")
    columns = ("structure", "fit", "RMS", *["held out"] * hidden, *judgements)
    return Table("", columns, tuple(rows))


def _share(part: float | None) -> Quantity | None:
    return None if part is None else Quantity(100.0 * part, "%")


def _passed(chance: float | None) -> str:
    if chance is None:
        return ""
    return "yes" if chance >= COLOURED else "no"


def _bode(result: TransferResult, axes: Sequence[Axes]) -> None:
    """Draw gain and phase of the chosen function, of the sweeps and of the records' spectra."""
    from matplotlib.ticker import LogFormatter, MultipleLocator

    (gain, phase), function = axes, result.chosen.function
    sweeps = [(e.frequencies, e.response) for e in result.measurements if isinstance(e, Sweep)]
    records = [r for r in result.measurements if isinstance(r, Record)]
    known = [Spectra(r.times, r.given, r.measured, r.response(function)) for r in records]
    step = max((r.step for r in records), default=0.0)
    spectra = []
    if known and (seen := empirical(known, step)):
        rates = 2.0 * np.pi * seen.hertz
        spectra = [(rates, seen.measured / hold(rates, step))]  # without the hold of the inputs
    every = np.concatenate([w for w, _ in [*sweeps, *spectra]] or [np.abs(function.poles)])
    low, high = np.log10(every.min() / 1.5), np.log10(every.max() * 1.5)  # beyond the data
    w = np.concatenate([np.logspace(low - 4.0, low, 400), np.logspace(low, high, 500)])
    turned = np.unwrap(np.angle(function.response(w)))  # from where it has not turned yet
    unit_in, unit_out = (wire.display or wire.unit for wire in (result.source, result.output))
    scale = factor(result.output.unit, unit_out) / factor(result.source.unit, unit_in)

    def draw(label: str, w: Array, values: Complex, phases: Array, **look: Any) -> None:
        hertz = w / (2.0 * np.pi)
        gain.plot(hertz, 20.0 * np.log10(np.abs(scale * values)), label=label, **look)
        phase.plot(hertz, np.degrees(phases), **look)

    for label, pairs, series, marker in (
        ("records", spectra, "orange", "."),
        ("sweep", sweeps, "green", "o"),
    ):
        if pairs:
            points, values = map(np.concatenate, zip(*pairs))
            off = np.angle(values / function.response(points))
            near = np.interp(np.log(points), np.log(w), turned) + off
            look = {"ls": "", "marker": marker, "color": colour(series), "mfc": "none"}
            draw(label, points, values, near, **look)
    draw("chosen", w[400:], function.response(w[400:]), turned[400:], color=colour("blue"))
    gain.set(xscale="log", ylabel=f"gain [dB re 1 {unit_out}/{unit_in}]")
    phase.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
    phase.yaxis.set_major_locator(MultipleLocator(90.0))
    phase.xaxis.set_major_formatter(LogFormatter())
    gain.legend(frameon=False, fontsize=8.5)


def _picture(result: TransferResult, record: Record) -> Picture:
    """A record with the response of the chosen function, and the error."""
    wire, unit = result.output, result.output.display or result.output.unit
    scale = factor(wire.unit, unit)

    def draw(axes: Sequence[Axes]) -> None:
        curves, error = axes
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

    title = f"'{record.name}': measured, and as '{result.chosen.name}' has it"
    shaded = "; shaded: held out" * bool(record.held_out.any())
    return Picture(f"{title}{shaded}", draw, rows=2, height=5.0, shared=True)
