"""The page of a validation."""

from __future__ import annotations

from servo_models.report import (
    accuracy,
    conditions,
    implementation,
    linear_drive,
    model,
    paper,
    sg90,
    sg90_measured,
    smart_servo,
    torque_motor,
    verdict,
)
from servo_models.report.claim import judgement
from servo_models.report.page import Page, render
from servo_models.validation.rows import Validation

SECTIONS = (
    verdict,
    implementation,
    model,
    sg90_measured,
    sg90,
    torque_motor,
    linear_drive,
    smart_servo,
    accuracy,
    paper,
    conditions,
)


def validation_page(validation: Validation, date: str) -> str:
    """Return the report of a validation as HTML."""
    sentence = verdict.sentence(validation)
    return render(
        Page(
            title=f"Validation of the servo-models: {sentence}",
            kind="validation",
            sentence=sentence,
            passed=judgement(validation.rows),
            sections=[module.section(validation) for module in SECTIONS],
            remarks=verdict.remarks(validation),
            counts=verdict.counts(validation),
            date=date,
        )
    )
