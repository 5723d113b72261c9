"""Several sets of values on the same logs, as people read it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from servo_models.analysis.experiment import shown
from servo_models.analysis.explain import display_scale, display_unit
from servo_models.analysis.live import NOMINAL
from servo_models.diagnosis.comparison.compare import Comparison
from servo_models.identification.live import MOVE, live_logs
from servo_models.identification.readings import words
from servo_models.report.live import Live
from servo_models.report.numbers import Quantity
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Cell, Section, Table

TITLE = "Measured and simulated"


@report_of.register(Comparison)
def report(comparison: Comparison, date: str = "") -> Report:
    """Return the report of a comparison: errors, values, and a panel with each set."""
    names = (NOMINAL, *comparison.sets)
    model = comparison.model
    models = live_logs(model, comparison.logs, comparison.sets, {}, {*comparison.changed}, {})
    columns = ("log", "output", *names)
    errors = Table("RMS errors", columns, tuple(_errors(comparison)))
    values = Table("Values", ("parameter", "unit", *names), tuple(_values(comparison)))
    return Report(
        f"{model.actuator.name}, variant {model.variant}: {', '.join(comparison.sets)}",
        _sentence(comparison),
        remarks=comparison.remarks,
        sections=(
            Section(TITLE, live=Live(TITLE, MOVE, models) if models else None, tables=(errors,)),
            Section("Parameters", tables=(values,)),
        ),
        date=date,
    )


@document_of.register(Comparison)
def document(comparison: Comparison) -> dict[str, Any]:
    """Return values and errors in SI."""
    names = (NOMINAL, *comparison.sets)
    return {
        "actuator": comparison.model.actuator.name,
        "variant": comparison.model.variant,
        "remarks": list(comparison.remarks),
        "errors": [
            {"log": log, "output": output, "rms": dict(zip(names, sizes))}
            for (log, output), sizes in comparison.errors.items()
        ],
        "parameters": {
            name: {NOMINAL: comparison.model.values[name]}
            | {
                title: values.get(name, comparison.model.values[name])
                for title, values in comparison.sets.items()
            }
            for name in comparison.changed
        },
    }


def _sentence(comparison: Comparison) -> str:
    """Which set leaves least of the first output, over all logs."""
    first = next(iter(comparison.logs[0].outputs))
    names = (NOMINAL, *comparison.sets)
    rows = [sizes for (_, output), sizes in comparison.errors.items() if output == first]
    total = [sum(size**2 for size in sizes) for sizes in zip(*rows)]
    wire = comparison.model.plant.wire[first]
    told = ", ".join(
        f"{name} {shown(wire, (sum_ / len(rows)) ** 0.5, 3)}"
        for name, sum_ in sorted(zip(names, total), key=lambda it: it[1])
    )
    return f"Error of {words(first)}, RMS: {told}"


def _errors(comparison: Comparison) -> Iterator[tuple[Cell, ...]]:
    for (log, output), sizes in comparison.errors.items():
        wire = comparison.model.plant.wire[output]
        yield (log, words(output), *(shown(wire, it) for it in sizes))


def _values(comparison: Comparison) -> Iterator[tuple[Cell, ...]]:
    nominal = comparison.model.values
    for name in comparison.changed:
        parameter = comparison.model.plant.parameters[name]
        every = (
            nominal[name],
            *(values.get(name, nominal[name]) for values in comparison.sets.values()),
        )
        scale = display_scale(parameter)
        yield (name, display_unit(parameter), *(Quantity(scale * it, digits=5) for it in every))
