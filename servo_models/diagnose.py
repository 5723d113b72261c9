"""Diagnose the gap between a model and logs: what ``servo-models diagnose`` does."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from servo_models.audit import NO_NOISE, Audit, audit, noise_floors
from servo_models.description import Description, read_description
from servo_models.diagnosis.claims import claims, estimates
from servo_models.diagnosis.fitting.explanation import Bench
from servo_models.diagnosis.fitting.nominal import nominal_parameters
from servo_models.diagnosis.gap import gaps, whole_gap
from servo_models.diagnosis.preconditions import check_logs, without_flags
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.causes import find_causes
from servo_models.diagnosis.search.fits import Tell
from servo_models.diagnosis.verdict import TOLERANCE, decide
from servo_models.threads import one_blas_thread

__all__ = ["Diagnosis", "diagnose"]


def diagnose(
    description: Description | str | Path,
    tolerance: float = TOLERANCE,
    seed: int = 0,
    jobs: int | None = None,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
) -> Diagnosis:
    """Find out where a gap lies, what causes it and how far it closes.

    Args:
        description: model, uncertainties of its parameters and logs; or its TOML file.
        tolerance: gap in noise floors that counts as none.
        seed: of the bootstrap.
        jobs: simulations at once, by default the processors there are.
        left_out: effects that are not considered.
        tell: is told what goes on.

    Raises:
        UserError: see ``read_description`` and ``preconditions``.
    """
    told = description if isinstance(description, Description) else read_description(description)
    logs, flags = without_flags(told.logs, told.model.plant)
    told = replace(told, logs=logs)
    check_logs(told.path, told.model, told.logs)
    with one_blas_thread():
        found = _diagnose(told, tolerance, seed, jobs or os.cpu_count() or 1, left_out, tell)
    return replace(found, flags=flags)


def _diagnose(
    told: Description,
    tolerance: float,
    seed: int,
    jobs: int,
    left_out: Iterable[str],
    tell: Tell | None,
) -> Diagnosis:
    audits = tuple(audit(log, told.model.plant) for log in told.logs)
    floors = noise_floors(audits)
    origins = _origins(audits, floors)
    bench = Bench(told.model, told.logs, nominal_parameters(told), floors, jobs)
    causes = find_causes(bench, left_out, tell, tolerance)
    verdict = decide(causes, tolerance)
    return Diagnosis(
        model=told.model,
        logs=told.logs,
        audits=audits,
        floors=floors,
        causes=causes,
        verdict=verdict,
        gap=whole_gap(causes, seed),
        gaps=gaps(causes, floors, origins, seed),
        claims=claims(causes, verdict),
        moved=estimates(causes.retuned),
        tolerance=tolerance,
    )


def _origins(audits: Iterable[Audit], floors: Mapping[str, float]) -> dict[str, str]:
    """What the noise floor of each output comes from, in the log that has the largest."""
    largest: dict[str, tuple[float, str]] = {}
    for reading in (reading for one in audits for reading in one.readings):
        found = (reading.floor.value, reading.floor.origin)
        largest[reading.name] = max(found, largest.get(reading.name, found))
    return {
        name: origin if value >= floors[name] else NO_NOISE
        for name, (value, origin) in largest.items()
    }
