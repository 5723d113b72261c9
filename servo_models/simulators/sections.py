"""An export as people and programs read it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar

import numpy as np

from servo_models.report.document import Document, Figure, about, choice
from servo_models.report.numbers import Quantity, listed
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Cell, Section, Table
from servo_models.simulators.export import Errors, Export
from servo_models.simulators.simulator import APPROXIMATE, EXACT, LOST

FMU = "the FMU ('servo-models build --params') keeps all"


class HeldEffect(Document, frozen=True):
    held: Annotated[str, choice(EXACT, APPROXIMATE, LOST)]
    by: str


class NativeField(Document, frozen=True):
    value: Annotated[float, about("0: left out.")]
    unit: str


class ExportDocument(Document, frozen=True):
    """An actuator as a simulator takes it: goal [rad] = slope (command - zero)."""

    title: ClassVar[str] = "servo-models export"

    simulator: str
    actuator: str
    variant: str
    time_step: Annotated[float, about("Of the simulator [s]; a delay is in such steps.")]
    inertia: Annotated[float, about("Of all that turns [kg m2].")]
    command: str
    command_unit: str
    slope: float
    zero: float
    fields: dict[str, NativeField]
    lines: Annotated[str, about("To paste.")]
    effects: Annotated[dict[str, HeldEffect], about("That are on.")]
    errors: Sequence[Errors]
    kept: Annotated[Figure, about("Fraction of the closed gap in all logs; null without one.")]


@document_of.register(Export)
def export_document(exported: Export) -> ExportDocument:
    """Return an export as what JSON is made of."""
    servo = exported.servo
    return ExportDocument.made_from(
        exported,
        simulator=exported.simulator.title,
        actuator=servo.model.actuator.name,
        variant=servo.model.variant,
        time_step=exported.step,
        inertia=servo.inertia,
        command=servo.command.name,
        command_unit=servo.command.unit,
        slope=servo.slope,
        zero=servo.zero,
        fields={
            it.name: NativeField(exported.values[it.name], it.unit)
            for it in exported.simulator.fields
        },
        effects={name: HeldEffect(it.degree, it.how) for name, it in exported.held.items()},
    )


@report_of.register(Export)
def export_report(exported: Export, date: str = "") -> Report:
    """Return what a simulator holds of an actuator and what is lost, measured and in words."""
    title, model = exported.simulator.title, exported.servo.model
    held = sorted(exported.held.items(), key=lambda it: it[1].degree)
    effects = tuple((place, it.degree, it.how) for place, it in held)
    fields = tuple(
        (field.name, Quantity(exported.values[field.name], field.unit), field.about)
        for field in exported.simulator.fields
    )
    columns = {
        "nominal": "nominal",
        "diagnosed": "diagnosed",
        "native": title,
        "native_to_diagnosed": f"{title} to diagnosed",
    }
    known = [key for key in columns if getattr(exported.errors[0], key) is not None]
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            it.log or "standard excitation",
            *(Quantity(math.degrees(getattr(it, key)), "deg", digits=3) for key in known),
        )
        for it in exported.errors
    )
    return Report(
        f"{model.actuator.name}, variant {model.variant}, for {title}",
        _sentence(exported),
        remarks=tuple(_remarks(exported)),
        sections=(
            Section(
                "",
                tables=(
                    Table("RMS errors", ("of", *(columns[key] for key in known)), rows),
                    Table("Effects", ("effect", "held", "by"), effects),
                    Table("Fields", ("field", "fitted, 0 for left out", ""), fields),
                ),
            ),
        ),
        date=date,
    )


def _sentence(exported: Export) -> str:
    title = exported.simulator.title
    lost = [place for place, it in exported.held.items() if it.degree == LOST]
    told = f"lost: {listed(lost)}; {FMU}" if lost else "no effect is lost"
    if exported.kept is None:
        error = float(np.sqrt(np.mean([it.native_to_diagnosed**2 for it in exported.errors])))
        return f"{title} differs from the model by {math.degrees(error):.3g} deg RMS; {told}"
    if exported.kept < 0.0:
        return f"{title} is further from the logs than the nominal model; {told}"
    return f"{title} keeps {100.0 * min(exported.kept, 1.0):.0f} % of the closed gap; {told}"


def _remarks(exported: Export) -> list[str]:
    servo, remarks = exported.servo, []
    if (servo.slope, servo.zero) != (1.0, 0.0):
        remarks.append(
            f"Goal [rad] = {servo.slope:.6g} ({servo.command.name} [{servo.command.unit}] -"
            f" {servo.zero:.6g})."
        )
    if not exported.simulator.loaded:
        remarks.append(f"In {exported.simulator.title} the angle is the same under any load.")
    return remarks
