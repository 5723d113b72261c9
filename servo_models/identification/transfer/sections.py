"""Report of transfer functions: the chosen one first, then its data, then all candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.analysis.sine_test import hold
from servo_models.identification.doubts import judged
from servo_models.identification.grey_box import Constant
from servo_models.identification.measured_response import Empirical, empirical
from servo_models.identification.measured_response import Record as Spectra
from servo_models.identification.readings import axis_label, words
from servo_models.identification.sections import Pair, bode
from servo_models.identification.transfer.functions import TransferFunction
from servo_models.identification.transfer.identify import COLOURED, Candidate, TransferResult
from servo_models.identification.transfer.measurements import Record, Sweep
from servo_models.report.curves import JUDGED, MEASURED, draw_curve, draw_legend, shade
from servo_models.report.numbers import ERROR, Quantity
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table

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
            "standard_errors": c.standard_errors.tolist(),
            **{key: getattr(c, key) for key in ("fit", "held_out", "bic", "reason")},
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
    }


@report_of.register(TransferResult)
def _report(result: TransferResult, date: str = "") -> Report:
    """Return the chosen function, its coefficients, all candidates and physical constants."""
    source, output, chosen = result.source, result.output, result.chosen
    constants = list(result.constants.constants.values()) if result.constants else []
    records = [data for data in result.measurements if isinstance(data, Record)]
    shares = [("fitted", chosen.fit), ("held-out", chosen.held_out)]
    described = [f"{_share(s)} of the {name} samples" for name, s in shares if s is not None]
    if chosen.white is not None:
        described.append(f"residuals white: {_passed(chosen.white)}")
    faults = sum(bool(c.fault) for c in result.candidates)
    verdicts = f"{len(result.candidates)} tried, {faults} with a fault of poles"
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
        CONSTANTS: _estimates("constant, SI", constants),
        CANDIDATES: _candidates(result, [record.name for record in records]),
    }
    report = Report(
        title=f"Transfer function from {source.name} [{source.unit}] to {output.name}"
        f" [{output.unit}]",
        sentence=f"{chosen.name}: G(s) = {chosen.function}",
        cards=tuple(cards),
        remarks=tuple(f"Warning: {warning}." for warning in result.warnings),
        sections=(
            Section(BODE, pictures=(_bode(result, records),)),
            *(Section(title, tables=(table,), folded=True) for title, table in tables.items()),
            Section("Responses", pictures=tuple(_picture(result, r) for r in records), folded=True),
        ),
        date=date,
    )
    return judged(report, result.warnings)


def _coefficients(chosen: Candidate) -> Table:
    structure = chosen.function.structure
    powers = ["1", "s", *(f"s^{k}" for k in range(2, structure.poles))]
    names = [f"numerator, {power}" for power in powers[structure.zeros :: -1]]
    names += [f"denominator, {power}" for power in powers[structure.poles - 1 :: -1]]
    columns = [*names, "delay [s]"], chosen.function.coefficients, chosen.standard_errors
    return _estimates("coefficient", [Constant(n, float(v), float(e)) for n, v, e in zip(*columns)])


def _estimates(of: str, constants: Sequence[Constant]) -> Table:
    rows = []
    for c in constants:
        half = 1.96 * (c.standard_error or 0.0)
        limits = (c.value - half, c.value + half) if half else None
        shown = Quantity(c.value, error=c.standard_error, interval=limits, digits=5)
        rows.append((c.name, shown, "" if c.determined else Mark("not determined", False)))
    return Table("", (of, f"value {ERROR} error (95 % interval)", ""), tuple(rows))


def _roots(function: TransferFunction) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for kind, roots in (("pole", function.poles), ("zero", function.zeros)):
        for root in roots[roots.imag >= 0.0]:
            size = float(abs(root))
            shown = f"{root.real:.5g}" + (f" {ERROR}{root.imag:.5g}j" if root.imag else "")
            damping = Quantity(-root.real / size, digits=3) if root.imag else None
            rows.append((kind, shown, Quantity(size / (2.0 * np.pi), "Hz"), damping))
    return Table("", ("", "[rad/s]", "frequency", "damping ratio"), tuple(rows))


def _candidates(result: TransferResult, records: Sequence[str]) -> Table:
    candidates, (scale, unit) = result.candidates, display(result.output)
    least, rows = min(c.bic for c in candidates), list[tuple[Cell, ...]]()
    hidden = any(c.held_out is not None for c in candidates)
    for c in candidates:
        rms = [scale * c.rms[name] for name in records if name in c.rms]
        row = (
            c.name,
            _share(c.fit),
            Quantity(float(np.sqrt(np.mean(np.square(rms)))), unit) if rms else None,
            *[_share(c.held_out)] * hidden,
            Quantity(c.bic - least),
            _passed(c.white),
            Mark(f"rejected: {c.reason}", None) if c.reason else Mark("chosen", True),
        )
        rows.append(row)
    judgements = (*["held out"] * hidden, "BIC above least", "white", "verdict")
    return Table("", ("structure", "fit", "RMS", *judgements), tuple(rows))


def _share(part: float | None) -> Quantity | None:
    return None if part is None else Quantity(100.0 * part, "%")


def _passed(chance: float | None) -> str:
    if chance is None:
        return ""
    return "yes" if chance >= COLOURED else "no"


def _bode(result: TransferResult, records: Sequence[Record]) -> Picture:
    """The chosen function, sweeps, and spectra of records without the hold of their inputs."""
    function = result.chosen.function
    spectra = [Spectra(r.times, r.given, r.measured, r.response(function)) for r in records]
    pair = Pair(result.source, result.output, tuple(spectra))
    seen = [
        (sweep.frequencies / (2.0 * np.pi), sweep.measured, sweep.response(function))
        for sweep in result.measurements
        if isinstance(sweep, Sweep)
    ]
    if spectra and (found := empirical(spectra, pair.step)):
        held = hold(2.0 * np.pi * found.hertz, pair.step)
        seen.append((found.hertz, found.measured / held, found.simulated / held))
    points = Empirical(*map(np.concatenate, zip(*seen))) if seen else None
    ends = points.hertz if points else np.abs(function.poles) / (2.0 * np.pi)
    hertz = np.geomspace(ends.min() / 1.5, ends.max() * 1.5, 500)
    picture = bode(pair, points, (hertz, function.response(2.0 * np.pi * hertz)))
    text = (
        "Line: the chosen function. Circles: sweeps, and spectra of records where they excite it."
        " Dots: the same of the function's responses."
    )
    return replace(picture, title=BODE, text=text)


def _picture(result: TransferResult, record: Record) -> Picture:
    """A record with the response of the chosen function, and the error."""
    scale, unit = display(result.output)

    def draw(axes: Sequence[Axes]) -> None:
        measured, modelled = (
            scale * record.measured,
            scale * record.response(result.chosen.function),
        )
        draw_curve(axes[0], record.times, measured, "measured", MEASURED)
        for panel, values in zip(axes, (modelled, modelled - measured)):
            draw_curve(panel, record.times, values, "chosen", JUDGED)
            shade(panel, record.times, record.held_out)
        draw_legend(axes[0], 2)
        for panel, name in zip(axes, (words(result.output.name), "error")):
            panel.set_ylabel(axis_label(name, unit), parse_math=False)
        axes[1].set_xlabel("time [s]")

    title = f"'{record.name}': measured, and as '{result.chosen.name}' has it"
    shaded = "; shaded: held out" * bool(record.held_out.any())
    return Picture(f"{title}{shaded}", draw, rows=2, height=5.0, shared=True)
