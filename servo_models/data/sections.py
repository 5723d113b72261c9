"""The report of a parameter file: values beside those of the variant, and where from."""

from __future__ import annotations

from servo_models.analysis.explain import shown_value
from servo_models.catalogue import actuator as find_actuator
from servo_models.core.plant import Parameter
from servo_models.data.parameters import Estimate, ParameterSet
from servo_models.report.numbers import Quantity
from servo_models.report.result import Report, data_sheet
from servo_models.report.sections import Cell, Table


def parameter_report(chosen: ParameterSet) -> Report:
    """Return what a parameter file says, in the units that a person reads."""
    actuator = find_actuator(chosen.actuator)
    parameters = actuator.plant_of(chosen.variant).parameters
    nominal = actuator.values(chosen.variant)
    rows = tuple(_row(e, parameters[e.name], nominal[e.name]) for e in chosen.estimates)
    facts = {
        "method": chosen.method,
        "date": chosen.date.isoformat() if chosen.date else "",
        "made with servo-models": chosen.version,
        **{f"log {name}": digest for name, digest in chosen.logs.items()},
        **{name: str(Quantity(f.value, f.unit)) for name, f in chosen.figures.items()},
    }
    known = tuple((name, text) for name, text in facts.items() if text)
    return data_sheet(
        f"{chosen.file or 'parameters'}: {actuator.name}, variant {chosen.variant}",
        tuple(f"Warning: {text}." for text in chosen.warnings),
        (
            Table("Parameters", ("parameter", "value", chosen.variant, "origin", ""), rows),
            Table("Where they come from, and what was reached", ("", ""), known),
        ),
    )


def _row(estimate: Estimate, parameter: Parameter, nominal: float) -> tuple[Cell, ...]:
    return (
        estimate.name,
        shown_value(parameter, estimate.value, estimate.standard_error, 6),
        shown_value(parameter, nominal, digits=6),
        estimate.origin,
        parameter.param.about,
    )
