"""Section: the responses against independent references."""

from __future__ import annotations

from servo_models.report.parts import Section
from servo_models.validation.page import claim
from servo_models.validation.rows import MODEL, Validation

TITLE = "Model: responses against references"


def section(validation: Validation) -> Section | None:
    """Return the section, None if nothing was compared with a reference."""
    rows = validation.of(MODEL)
    if not rows:
        return None
    return Section(
        "model",
        TITLE,
        "The references are written from the published equations a second time, without"
        " the blocks of the model, and solved by other methods. Errors are shares of full scale,"
        ' the largest absolute reference value of each output. "Blocks as plain functions" is'
        " another kind: it calls the blocks of the model, without the text that is printed and"
        " compiled of them, at a tenth of the internal step; errors are shares of the range of"
        " each output, and the limit is 1e-4 and twice what the step changes in that"
        " integration.",
        claim.tables(rows, "Responses against references"),
    )
