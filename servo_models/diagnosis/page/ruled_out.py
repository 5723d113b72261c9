"""Section: effects less likely than those named, and those that these logs cannot show."""

from __future__ import annotations

import inspect

from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling import words as said
from servo_models.identification.page.readings import words
from servo_models.report.parts import Line, Section, Table, number

TITLE = "Ruled out"
COLUMNS = ("effect", "acts on", "why", "moves outputs by [noise floors]", "")
NUMBERS = ("moves outputs by [noise floors]",)


def section(found: Diagnosis) -> Section | None:
    """Return why each other effect is not named, the fitted ones open; None if all are named."""
    reasons = said.ruled_out(found)
    if not reasons:
        return None
    fitted = found.causes.fitted
    seen = [name for name in reasons if found.causes.reach[name].shown >= said.SEEN]
    groups = {
        "Fitted, and less likely": [name for name in seen if name in fitted],
        "Seen, but explain less than those that were fitted": [
            name for name in seen if name not in fitted
        ],
        "Not shown by these logs": [name for name in reasons if name not in seen],
    }
    tables = [
        Table(
            f"{caption} ({len(names)})",
            COLUMNS,
            tuple(_line(found, name, reasons[name]) for name in names),
            NUMBERS,
            folded=i > 0,
        )
        for i, (caption, names) in enumerate(groups.items())
        if names
    ]
    return Section(
        "ruled-out",
        TITLE,
        "An effect moves the outputs by what the largest of the sizes tried does, without what"
        " nominal parameters can imitate. One that moves them by less than the noise floor may"
        " be there all the same.",
        tuple(tables),
    )


def _line(found: Diagnosis, name: str, reason: str) -> Line:
    plant = found.model.plant
    module = inspect.getmodule(plant.placements[name][0].effect.function)
    about = (inspect.getdoc(module) or "").partition("\n")[0]
    reach = number(found.causes.reach[name].shown, 2)
    return Line((words(name), words(plant.main_wire(name)), reason, reach, about))
