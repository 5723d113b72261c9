"""Section: the experiment that would separate what these logs cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from servo_models.analysis.experiment import display
from servo_models.core.types import Array
from servo_models.diagnosis.experiments.experiment import Experiment
from servo_models.diagnosis.experiments.experiment_search import played
from servo_models.diagnosis.fitting.explanation import Explanation
from servo_models.diagnosis.page.stages import together
from servo_models.diagnosis.result import Diagnosis
from servo_models.identification.page.readings import BUCKETS, envelope, unit_among, words
from servo_models.identification.page.responses import (
    JUDGED,
    NOMINAL,
    draw_curve,
    draw_legend,
)
from servo_models.report.parts import Section
from servo_models.report.style import SERIES, Picture, colour, drawing, picture

TITLE = "Next experiment"
PANEL = 1.45
"""Height of a panel [inch]."""


def section(found: Diagnosis, experiments: Sequence[Experiment]) -> Section | None:
    """Return what to play next and what the fitted models say will happen; None for nothing."""
    if not experiments:
        return None
    return Section(
        "experiment",
        TITLE,
        "The command inside the actuator's limits on which the fitted models differ most, their"
        " parameters re-fitted to imitate one another. Log it and diagnose it with the old logs.",
        pictures=tuple(_picture(found, one, f"next-{i}") for i, one in enumerate(experiments)),
        items=tuple(f"{k}: {one.instruction}" for k, one in enumerate(experiments, start=1)),
    )


def _picture(found: Diagnosis, next_: Experiment, name: str) -> Picture:
    """The command, each output as either explanation predicts it, and how far these differ."""
    rivals = {one.effects: one for one in found.undecided}
    told = {together(it): _predicted(rivals[it], next_) for it in (next_.one, next_.other)}
    rows = 2 + len(found.floors)
    with drawing(name, rows=rows, height=0.7 + PANEL * rows) as (figure, panels):
        command, *predicted, difference = panels
        scale, unit = display(next_.wire)
        thin = envelope(next_.times, scale * next_.command, BUCKETS)
        command.plot(*thin, color=colour("ink"), lw=0.9)
        command.set_ylabel(f"{words(next_.wire.name)}\n[{unit}]", parse_math=False)
        for output, axes, series in zip(found.floors, predicted, SERIES * len(predicted)):
            unit, size = unit_among(found.logs, output)
            for (label, values), style in zip(told.items(), (JUDGED, NOMINAL)):
                draw_curve(axes, next_.times, values[output] / size, label, style)
            axes.set_ylabel(f"{words(output)}\n[{unit}]", parse_math=False)
            one, other = (values[output] / found.floors[output] for values in told.values())
            draw_curve(difference, next_.times, one - other, words(output), (series, "-", 1.0, 1.0))
        draw_legend(predicted[0], len(told))
        if len(predicted) > 1:
            draw_legend(difference, len(predicted))
        difference.axhspan(-1.0, 1.0, color=colour("grid"), alpha=0.8, lw=0, zorder=0)
        difference.set(xlabel="time [s]", xlim=(next_.times[0], next_.times[-1]))
        difference.set_ylabel("difference\n[noise floors]")
        figure.align_ylabels(panels)
        return picture(
            figure,
            name,
            " or ".join(told),
            "From above: the command to play, what either fitted model predicts, and by how much"
            " they differ before either is re-fitted. Shaded: the noise floor.",
        )


def _predicted(explanation: Explanation, next_: Experiment) -> Mapping[str, Array]:
    """Outputs [SI] that a fitted explanation predicts for an experiment."""
    return played(explanation, next_.plan).responses(explanation.evidence.vector)[0]
