"""The page of a validation."""

from __future__ import annotations

from servo_models.report.page import Page, render
from servo_models.validation.linear_drive import pictures as linear_drive
from servo_models.validation.page import accuracy, conditions, implementation, model, paper, verdict
from servo_models.validation.page.claim import judgement
from servo_models.validation.rows import Validation
from servo_models.validation.sg90 import measured_pictures as sg90_measured
from servo_models.validation.sg90 import pictures as sg90
from servo_models.validation.smart_servo import pictures as smart_servo
from servo_models.validation.torque_motor import pictures as torque_motor

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
