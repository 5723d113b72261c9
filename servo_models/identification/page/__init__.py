"""The page of an identification: one file = one section."""

from __future__ import annotations

from collections.abc import Mapping

from servo_models.identification.page import (
    bode,
    parameters,
    provenance,
    residuals,
    responses,
    verdict,
)
from servo_models.identification.result import Identification
from servo_models.report.page import Page, render
from servo_models.report.sheet import sheet_section
from servo_models.report.sheets import Sheet


def identification_page(
    title: str,
    found: Identification,
    figures: Sheet | None = None,
    *,
    floors: Mapping[str, float] | None = None,
    conditions: Mapping[str, str] | None = None,
    date: str = "",
) -> str:
    """Return the report of an identification as one HTML page that needs nothing else.

    Args:
        title: of the window, and above the verdict.
        found: from ``identify``.
        figures: figures of merit of the fitted model.
        floors: noise floors [SI] of outputs, by name.
        conditions: versions that figures depend on, by name.
        date: shown with the title; the same arguments give the same bytes.
    """
    return render(
        Page(
            title=title,
            kind=title,
            sentence=verdict.sentence(found),
            passed=verdict.judgement(found),
            sections=(
                verdict.warnings(found),
                parameters.section(found),
                responses.section(found),
                residuals.section(found),
                bode.section(found),
                sheet_section(figures, "figures") if figures else None,
                provenance.section(found, conditions or {}),
            ),
            remarks=verdict.remarks(found),
            counts=verdict.counts(found, floors or {}),
            date=date,
        )
    )
