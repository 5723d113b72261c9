"""Section: the experiment that would separate what these logs cannot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servo_models.diagnosis.causes import Explanation
from servo_models.diagnosis.experiment import Experiment
from servo_models.diagnosis.result import Diagnosis
from servo_models.experiment import display
from servo_models.identification.problem import Problem
from servo_models.report.diagnosis.stages import together
from servo_models.report.identification.readings import BUCKETS, envelope, unit_among, words
from servo_models.report.parts import Section
from servo_models.report.style import Picture, colour, drawing, picture

Array = NDArray[np.float64]

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
        items=tuple(one.text for one in experiments),
    )


def _picture(found: Diagnosis, next_: Experiment, name: str) -> Picture:
    """The command, and below it each output as either explanation predicts it."""
    rivals = {one.effects: one for one in found.verdict.rivals}
    told = {together(names): _predicted(rivals[names], next_) for names in (next_.one, next_.other)}
    outputs = list(found.floors)
    with drawing(name, rows=1 + len(outputs), height=0.7 + PANEL * (1 + len(outputs))) as (
        figure,
        (command, *panels),
    ):
        scale, unit = display(next_.wire)
        command.plot(next_.times, scale * next_.command, color=colour("ink"), lw=1.0)
        command.set_ylabel(f"{words(next_.wire.name)} [{unit}]", parse_math=False)
        for output, axes in zip(outputs, panels):
            unit, size = unit_among(found.logs, output)
            for (label, values), (tint, dash) in zip(
                told.items(), (("blue", "-"), ("orange", "--"))
            ):
                curve = envelope(next_.times, values[output] / size, BUCKETS)
                axes.plot(*curve, color=colour(tint), ls=dash, lw=1.2, label=label)
            axes.set_ylabel(f"{words(output)} [{unit}]", parse_math=False)
        panels[0].set_title(" ", fontsize=8.5)
        panels[0].legend(
            loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=2, frameon=False, fontsize=8.5
        ).set_in_layout(False)
        panels[-1].set(xlabel="time [s]", xlim=(next_.times[0], next_.times[-1]))
        figure.align_ylabels([command, *panels])
        return picture(
            figure,
            name,
            " or ".join(told),
            "Above: the command to play. Below: what either fitted model predicts.",
        )


def _predicted(explanation: Explanation, next_: Experiment) -> Mapping[str, Array]:
    """Outputs [SI] that a fitted explanation predicts for an experiment."""
    problem, n = explanation.problem, len(next_.times)
    log = replace(
        problem.logs[0],
        times=next_.times,
        inputs={next_.wire.name: next_.command},
        outputs={name: np.zeros(n) for name in problem.sigma},
        held_out=np.zeros(n, dtype=bool),
        skipped=None,
    )
    played = Problem(problem.model, [log], problem.free, sigma=problem.sigma)
    return played.responses(explanation.evidence.vector)[0]
