"""Section: the FMU against the simulation in this process."""

from __future__ import annotations

from servo_models.report.parts import Section
from servo_models.validation.page import claim
from servo_models.validation.rows import IMPLEMENTATION, Validation

TITLE = "Implementation: FMU against simulation"


def section(validation: Validation) -> Section | None:
    """Return the section, None if no FMU was run."""
    rows = validation.of(IMPLEMENTATION)
    if not rows:
        return None
    return Section(
        "implementation",
        TITLE,
        "The FMU and the simulation in this process get the same inputs on the same"
        " communication points. A value of 0 is equality to the last bit.",
        claim.tables(rows, "FMU against simulation"),
    )
