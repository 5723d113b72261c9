"""The diagnosed model as a parameter file: the loop from log to FMU is closed."""

from __future__ import annotations

import datetime

from servo_models.data.log import hashes
from servo_models.data.parameters import Estimate, Figure, ParameterSet, known_error, with_given
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling import words
from servo_models.diagnosis.telling.cautions import cautions


def parameter_set(found: Diagnosis, date: datetime.date | None = None) -> ParameterSet:
    """Return ``found.fitted`` with standard errors, and what it is known from."""
    model = found.fitted
    tuned = () if found.within_tolerance else found.found  # without a gap nothing is
    estimated = {
        one.name: Estimate(one.name, one.value, known_error(one.standard_error), "diagnosed")
        for one in tuned
    }
    wires = model.plant.wire
    return ParameterSet(
        actuator=model.actuator.key,
        variant=model.variant,
        estimates=with_given(model.actuator.values(model.variant), model.values, estimated),
        method=f"diagnosis, {found.verdict.kind}: {_causes(found)}",
        logs={name: f"sha256:{digest}" for name, digest in hashes(found.logs).items()},
        date=date,
        figures={
            f"{gap.output}_rms_unseen_blocks": Figure(gap.rms["after"], wires[gap.output].unit)
            for gap in found.gaps
        },
        warnings=cautions(found),
    )


def _causes(found: Diagnosis) -> str:
    taken = found.causes.taken.effects
    return f"parameters and {words.placed(found, taken)}" if taken else "parameters alone"
