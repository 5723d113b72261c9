"""The page of a diagnosis: one file = one section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.experiments.experiment import Experiment
from servo_models.diagnosis.page import (
    detectors,
    evidence,
    experiment,
    gap,
    imitated,
    parameters,
    provenance,
    ruled_out,
    verdict,
)
from servo_models.diagnosis.page import where as regimes
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.where import Breakdown
from servo_models.report.page import Page, render


def diagnosis_page(
    title: str,
    found: Diagnosis,
    where: Sequence[Breakdown] = (),
    experiments: Sequence[Experiment] = (),
    confirmed: Confirmation | None = None,
    *,
    conditions: Mapping[str, str] | None = None,
    date: str = "",
) -> str:
    """Return the report of a diagnosis as one HTML page that needs nothing else.

    Args:
        title: of the window, and above the verdict.
        found: from ``diagnose``.
        where: from ``diagnosis.where``.
        experiments: from ``diagnosis.experiments``, for the verdict of ``found``.
        confirmed: from ``diagnosis.confirm``.
        conditions: versions that figures depend on, by name.
        date: shown with the title; the same arguments give the same bytes.
    """
    return render(
        Page(
            title=title,
            kind=title,
            sentence=verdict.sentence(found, experiments),
            passed=verdict.judgement(found),
            sections=(
                verdict.warnings(found),
                gap.section(found, confirmed),
                regimes.section(where),
                evidence.section(found),
                detectors.section(found),
                imitated.section(found, experiments),
                ruled_out.section(found),
                parameters.section(found),
                experiment.section(found, experiments),
                provenance.section(found, conditions or {}),
            ),
            remarks=verdict.remarks(found),
            counts=verdict.counts(found),
            date=date,
        )
    )
