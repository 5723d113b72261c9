"""The comparison of transfer functions as a data sheet."""

from __future__ import annotations

import numpy as np

from servo_models.identification.transfer.choose import COLOURED, Candidate
from servo_models.identification.transfer.evidence import Record
from servo_models.identification.transfer.functions import TransferFunction
from servo_models.identification.transfer.identify import TransferResult
from servo_models.report.sheets import Sheet, Table, with_error
from servo_models.units import factor


def sheet(result: TransferResult) -> Sheet:
    """Return the chosen function, its coefficients, all candidates and physical constants."""
    source, output = result.source, result.output
    title = f"Transfer function from {source.name} [{source.unit}] to {output.name} [{output.unit}]"
    chosen = result.chosen
    texts = (
        f"{chosen.name}: G(s) = {chosen.function}",
        *(f"Warning: {warning}." for warning in result.warnings),
    )
    constants = (_constants(result),) if result.constants else ()
    return Sheet(
        title,
        texts,
        (*_coefficients(chosen), _roots(chosen.function), *constants, _candidates(result)),
    )


def _coefficients(chosen: Candidate) -> tuple[Table, ...]:
    if not chosen.fit:
        return ()
    structure = chosen.fit.structure
    names = [f"numerator, {_power(k)}" for k in range(structure.zeros, -1, -1)]
    names += [f"denominator, {_power(k)}" for k in range(structure.poles - 1, -1, -1)]
    names += ["delay [s]"] if structure.delay else []
    rows = tuple(
        (name, *with_error(value, error), f"{100.0 * error / abs(value):.2g} %")
        for name, value, error in zip(names, chosen.fit.coefficients, chosen.fit.standard_errors)
    )
    return (Table("Coefficients", ("coefficient", "value", "standard error", ""), rows),)


def _power(k: int) -> str:
    return {0: "1", 1: "s"}.get(k, f"s^{k}")


def _roots(function: TransferFunction) -> Table:
    rows = []
    for kind, roots in (("pole", function.poles), ("zero", function.zeros)):
        for root in roots[roots.imag >= 0.0]:
            size = abs(root)
            shown = f"{root.real:.5g}" + (f" +-{root.imag:.5g}j" if root.imag else "")
            damping = f"{-root.real / size:.3g}" if root.imag else ""
            rows.append((kind, shown, f"{size / (2.0 * np.pi):.4g}", damping))
    return Table("Poles and zeros", ("", "[rad/s]", "frequency [Hz]", "damping ratio"), tuple(rows))


def _constants(result: TransferResult) -> Table:
    assert result.constants
    rows = []
    for c in result.constants.constants.values():
        low_high = ""
        if c.standard_error is not None:
            half = 1.96 * c.standard_error
            low_high = f"{c.value - half:.5g} to {c.value + half:.5g}"
        said = "" if c.determined else "not determined"
        rows.append((c.name, *with_error(c.value, c.standard_error), low_high, said))
    columns = ("constant, SI", "value", "standard error", "95 % interval", "")
    return Table("Physical constants", columns, tuple(rows))


def _candidates(result: TransferResult) -> Table:
    unit = result.output.display or result.output.unit
    scale = factor(result.output.unit, unit)
    records = [one.name for one in result.evidence if isinstance(one, Record)]
    least = [min(getattr(c, key) for c in result.candidates) for key in ("aic", "bic")]
    hidden = any(c.score.held_out is not None for c in result.candidates)

    def row(c: Candidate) -> tuple[str, ...]:
        rms = [c.score.rms[name] for name in records if name in c.score.rms]
        pooled = f"{scale * float(np.sqrt(np.mean(np.square(rms)))):.4g}" if rms else ""
        return (
            c.name,
            _percent(c.score.fit),
            pooled,
            *((_percent(c.score.held_out),) if hidden else ()),
            f"{c.aic - least[0]:.1f}",
            f"{c.bic - least[1]:.1f}",
            _passed(c.score.white),
            _passed(c.score.independent),
            f"rejected: {c.reason}" if c.reason else "chosen",
        )

    columns = (
        "structure",
        "fit %",
        f"RMS [{unit}]",
        *(("held out %",) if hidden else ()),
        "AIC above least",
        "BIC above least",
        "white",
        "free of input",
        "verdict",
    )
    return Table("Candidates", columns, tuple(row(c) for c in result.candidates))


def _percent(part: float | None) -> str:
    return "" if part is None else f"{100.0 * part:.2f}"


def _passed(chance: float | None) -> str:
    if chance is None:
        return ""
    return "yes" if chance >= COLOURED else "no"
