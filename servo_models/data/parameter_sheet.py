"""The data sheet of a parameter file: values beside those of the variant, and where from."""

from __future__ import annotations

from servo_models.analysis.explain import display_scale, display_unit, in_display_unit
from servo_models.core.catalogue import actuator as find_actuator
from servo_models.core.plant import Parameter
from servo_models.data.parameters import Estimate, ParameterSet
from servo_models.report.sheets import Sheet, Table, with_error


def parameter_sheet(chosen: ParameterSet) -> Sheet:
    """Return what a parameter file says, in the units that a person reads."""
    actuator = find_actuator(chosen.actuator)
    parameters = actuator.plant_of(chosen.variant).parameters
    nominal = actuator.values(chosen.variant)
    rows = tuple(_row(e, parameters[e.name], nominal[e.name]) for e in chosen.estimates)
    facts = {
        "method": chosen.method,
        "date": chosen.date and chosen.date.isoformat(),
        "made with servo-models": chosen.version,
        **{f"log {name}": digest for name, digest in chosen.logs.items()},
        **{name: f"{f.value:.5g} {f.unit}" for name, f in chosen.figures.items()},
    }
    known = tuple((name, text) for name, text in facts.items() if text)
    return Sheet(
        f"{chosen.file or 'parameters'}: {actuator.name}, variant {chosen.variant}",
        tuple(f"Warning: {text}." for text in chosen.warnings),
        (
            Table(
                "Parameters",
                ("parameter", "value", "+-", chosen.variant, "unit", "origin", ""),
                rows,
            ),
            Table("Where they come from, and what was reached", ("", ""), known),
        ),
    )


def _row(estimate: Estimate, parameter: Parameter, nominal: float) -> tuple[str, ...]:
    scale, spread = display_scale(parameter), estimate.standard_error
    return (
        estimate.name,
        *with_error(scale * estimate.value, None if spread is None else scale * spread),
        in_display_unit(nominal, parameter),
        display_unit(parameter),
        estimate.origin,
        parameter.param.about,
    )
