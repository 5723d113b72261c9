"""Section: what the diagnosis comes from."""

from __future__ import annotations

from collections.abc import Mapping

from servo_models.data.parameters import installed_version
from servo_models.diagnosis.result import Diagnosis
from servo_models.identification.page.provenance import log_text
from servo_models.report.parts import Section, number

TITLE = "Provenance"


def section(found: Diagnosis, conditions: Mapping[str, str]) -> Section:
    """Return model, tolerance, logs with their hashes, and versions."""
    model = found.model
    facts = [
        ("actuator", f"{model.actuator.name}, variant {model.variant}"),
        ("values from", model.provenance),
        ("no gap", f"below {number(found.tolerance)} noise floors"),
        *((f"log {log.name}", log_text(log)) for log in found.logs),
        *{"servo-models": installed_version(), **conditions}.items(),
    ]
    return Section("provenance", TITLE, facts=tuple((name, text) for name, text in facts if text))
