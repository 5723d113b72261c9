"""Section: what the validation ran on."""

from __future__ import annotations

from servo_models.report.parts import Section
from servo_models.validation.rows import Validation

TITLE = "Conditions"


def section(validation: Validation) -> Section | None:
    """Return the section, None if no conditions are known."""
    if not validation.conditions:
        return None
    return Section("conditions", TITLE, facts=tuple(validation.conditions.items()))
