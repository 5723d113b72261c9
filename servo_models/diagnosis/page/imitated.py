"""Section: effects that re-tuned parameters imitate, and which experiment would show them."""

from __future__ import annotations

from collections.abc import Sequence

from servo_models.diagnosis.experiments.experiment import Experiment
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling.words import shown_by
from servo_models.identification.page.readings import words
from servo_models.report.parts import Line, Section, Table, number

TITLE = "Not ruled out"
COLUMNS = ("effect", "noise floors", "experiment", "acts on")
NUMBERS = ("noise floors",)


def section(found: Diagnosis, experiments: Sequence[Experiment]) -> Section | None:
    """Return what parameters that explain the gap may hide; None for nothing."""
    if not found.imitated:
        return None
    plant = found.model.plant
    lines = tuple(
        Line(
            (
                words(one.name),
                number(one.moved, 3),
                shown_by(one, experiments),
                words(plant.main_wire(one.name)),
            )
        )
        for one in found.imitated
    )
    return Section(
        "imitated",
        TITLE,
        "Effects that may be there all the same: with one of them in the model, parameters re-tuned"
        " beside it leave no more than without. How far it moves the outputs is told at the largest"
        " size found, with the experiment that would show it. One without an experiment is small,"
        " or it is much like another parameter under every command tried.",
        (Table(f"Imitated by re-tuned parameters ({len(lines)})", COLUMNS, lines, NUMBERS),),
    )
