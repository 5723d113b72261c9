"""An export as people read it."""

from __future__ import annotations

import math

import numpy as np

from servo_models.report.numbers import Quantity, listed
from servo_models.report.result import Report
from servo_models.report.sections import Cell, Section, Table
from servo_models.simulators.export import Export
from servo_models.simulators.simulator import LOST

FMU = "the FMU ('servo-models build --params') keeps all"


def export_report(found: Export) -> Report:
    """Return what a simulator holds of an actuator and what is lost, measured and in words."""
    title, model = found.simulator.title, found.servo.model
    held = sorted(found.held.items(), key=lambda it: it[1].degree)
    effects = tuple((place, it.degree, it.how) for place, it in held)
    fields = tuple(
        (it.name, Quantity(found.values[it.name], it.unit), it.about)
        for it in found.simulator.fields
    )
    names = ("of", "nominal", "diagnosed", title, f"{title} to diagnosed")
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            it.log or "standard excitation",
            *(_degrees(error) for error in (it.nominal, it.diagnosed, it.native)),
            _degrees(it.native_to_diagnosed),
        )
        for it in found.errors
    )
    columns: tuple[str, ...] = names
    if found.errors[0].nominal is None:
        columns, rows = (names[0], names[-1]), tuple((row[0], row[-1]) for row in rows)
    return Report(
        f"{model.actuator.name}, variant {model.variant}, for {title}",
        _sentence(found),
        remarks=tuple(_remarks(found)),
        sections=(
            Section(
                "",
                tables=(
                    Table("RMS errors", columns, rows),
                    Table("Effects", ("effect", "held", "by"), effects),
                    Table("Fields", ("field", "fitted, 0 for left out", ""), fields),
                ),
            ),
        ),
    )


def _degrees(angle: float | None) -> Cell:
    return None if angle is None else Quantity(math.degrees(angle), "deg", digits=3)


def _sentence(found: Export) -> str:
    title = found.simulator.title
    lost = [place for place, it in found.held.items() if it.degree == LOST]
    told = f"lost: {listed(lost)}; {FMU}" if lost else "no effect is lost"
    if found.kept is None:
        error = float(np.sqrt(np.mean([it.native_to_diagnosed**2 for it in found.errors])))
        return f"{title} differs from the model by {math.degrees(error):.3g} deg RMS; {told}"
    if found.kept < 0.0:
        return f"{title} is further from the logs than the nominal model; {told}"
    return f"{title} keeps {100.0 * min(found.kept, 1.0):.0f} % of the closed gap; {told}"


def _remarks(found: Export) -> list[str]:
    servo, remarks = found.servo, []
    if (servo.slope, servo.zero) != (1.0, 0.0):
        remarks.append(
            f"Goal [rad] = {servo.slope:.6g} ({servo.command.name} [{servo.command.unit}] -"
            f" {servo.zero:.6g})."
        )
    if not found.simulator.loaded:
        remarks.append(f"In {found.simulator.title} the angle is the same under any load.")
    return remarks
