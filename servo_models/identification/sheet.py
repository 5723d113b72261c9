"""An identification on the terminal: what was found, how well it fits, what is doubtful."""

from __future__ import annotations

from math import isfinite

from servo_models.analysis.explain import display_scale, display_unit, in_display_unit
from servo_models.identification.result import Accuracy, Identification
from servo_models.identification.uncertainty import doubt
from servo_models.report.sheets import Sheet, Table, with_error
from servo_models.units import factor

PARAMETERS = ("parameter", "before", "estimate", "+-", "unit", "")
ACCURACY = ("log", "output", "part", "RMS before", "RMS after", "unit", "fit %")
RUNS_AWAY = "runs away"
IN_FILE = "after, in numbers of the file"


def identification_sheet(found: Identification) -> Sheet:
    """Return parameters with standard errors, RMS errors before and after, and warnings."""
    model = found.fitted
    title = f"{model.actuator.name}, variant {model.variant}: {len(found.free)} parameters"
    ends = f"{found.method}; {found.evaluations} simulations of {_logs(found)}."
    warnings = tuple(f"Warning: {text}." for text in found.warnings)
    return Sheet(
        title,
        (ends, *warnings),
        (
            Table("Parameters", PARAMETERS, _parameters(found)),
            _errors(found),
        ),
    )


def _logs(found: Identification) -> str:
    count = len(found.logs)
    return "the log" if count == 1 else f"{count} logs"


def _parameters(found: Identification) -> tuple[tuple[str, ...], ...]:
    known = found.fitted.plant.parameters
    rows = []
    for free, value, error in zip(found.free, found.values, found.standard_errors):
        parameter = known[free.name]
        scale = display_scale(parameter)
        rows.append(
            (
                free.name,
                in_display_unit(free.nominal, parameter),
                *with_error(scale * float(value), scale * float(error)),
                display_unit(parameter),
                doubt(free, float(value), float(error)),
            )
        )
    return tuple(rows)


def _errors(found: Identification) -> Table:
    """Errors in the unit that a person reads, and in the numbers of a file of other units."""
    rows = [_accuracy(found, row) for row in found.accuracy]
    if all(row[4] == row[-1] for row in rows):
        return Table("Errors", ACCURACY, tuple(row[:-1] for row in rows))
    return Table("Errors", (*ACCURACY, IN_FILE), tuple(rows))


def _accuracy(found: Identification, row: Accuracy) -> tuple[str, ...]:
    wire = found.fitted.plant.wire[row.output]
    unit = wire.display or wire.unit
    scale = factor(wire.unit, unit)
    return (
        row.log,
        row.output,
        row.part,
        f"{row.before * scale:.4g}" if isfinite(row.before) else RUNS_AWAY,
        f"{row.after * scale:.4g}",
        unit,
        f"{row.fit:.2f}",
        f"{row.after / row.column_scale:.4g}",
    )
