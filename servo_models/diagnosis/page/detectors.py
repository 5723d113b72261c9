"""Section: codes of a quantiser and ticks of a hold, seen apart from any error."""

from __future__ import annotations

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.diagnosis.clock import Answers
from servo_models.diagnosis.detectors import Codes, Detection, sentence
from servo_models.diagnosis.result import Diagnosis
from servo_models.identification.page.readings import words
from servo_models.report.parts import Section
from servo_models.report.style import Picture, colour, drawing, picture

TITLE = "Codes and ticks"
BARS = 40


def section(found: Diagnosis) -> Section | None:
    """Return what the detectors of believed effects have seen; None if none has one."""
    seen = [claim.detected for claim in found.claims if claim.detected is not None]
    if not seen:
        return None
    return Section(
        "detectors",
        TITLE,
        "A quantiser leaves codes in its reading, and a hold answers commands on its ticks. Both"
        " show, or do not, whatever error a fit leaves.",
        (),
        tuple(map(_picture, seen)),
    )


def _picture(seen: Detection) -> Picture:
    return _codes(seen) if isinstance(seen, Codes) else _ticks(seen)


def _codes(seen: Codes) -> Picture:
    name = f"codes-{seen.effect}"
    scale, unit = display(seen.reading)
    with drawing(name, height=2.4) as (figure, (axes,)):
        axes.hist(seen.phases, bins=BARS, range=(-0.5, 0.5), color=colour("blue"))
        axes.set(xlabel=f"distance from a code [steps of {scale * seen.step:.3g} {unit}]")
        axes.set(ylabel="readings", xlim=(-0.5, 0.5))
        return picture(
            figure,
            name,
            f"{words(seen.reading.name)}, folded at the step",
            f"{_said(seen)} A quantiser makes a peak, as wide as the noise after it; without one,"
            " the bars are level.",
        )


def _ticks(seen: Answers) -> Picture:
    name = f"ticks-{seen.effect}"
    due, late, error = (1e3 * it for it in (seen.due, seen.late, seen.error))
    with drawing(name, height=2.8) as (figure, (axes,)):
        ends = np.array([0.0, 1e3 * seen.period])
        axes.plot(ends, ends, color=colour("muted"), lw=1.0, label="answered on ticks")
        axes.errorbar(
            due, late, yerr=error, fmt="o", color=colour("blue"), ms=4.5, label="measured"
        )
        axes.set(xlabel="from the step to the next tick [ms]", ylabel="answered late by [ms]")
        axes.legend(frameon=False)
        return picture(
            figure,
            name,
            f"When steps of the command are answered, period {1e3 * seen.period:.3g} ms",
            f"{_said(seen)} On the line: a step waits for the next tick. Level: all are late"
            " alike, as by a delay. Anywhere: no clock.",
        )


def _said(seen: Detection) -> str:
    return f"{words(seen.effect).capitalize()}: {sentence(seen)}."
