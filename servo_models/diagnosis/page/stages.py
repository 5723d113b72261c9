"""The models that a diagnosis compares, and how a page speaks of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling.words import listed
from servo_models.identification.page.readings import Reading, reading, words

NOMINAL, RETUNED, WITH_ONE, WITH_MORE = "nominal", "re-tuned", "with effect", "with effects"


def stages(found: Diagnosis) -> dict[str, str]:
    """Return the stages of ``Gap.rms`` that differ, each with its name for people."""
    taken = found.causes.taken
    named = {"before": NOMINAL}
    if found.causes.retuned.problem.free and not found.within_tolerance:
        named["retuned"] = RETUNED
    if taken.effects:
        named["after"] = WITH_ONE if len(taken.effects) == 1 else WITH_MORE
    return named


def readings(found: Diagnosis) -> list[Reading]:
    """Return every output of every log beside what each model makes of it, in their order.

    A model that cannot be simulated on a log that no fit has seen makes nothing of it.
    """
    causes, said = found.causes, []
    nominal = causes.retuned.problem
    values = {
        "before": nominal.values(causes.before.vector),
        "retuned": causes.retuned.values,
        "after": causes.taken.values,
    }
    for log, run in zip(found.logs, nominal.runs):
        responses = {n: run.outputs_or_nan(values[stage]) for stage, n in stages(found).items()}
        finite = {name: it for name, it in responses.items() if np.isfinite(it).all()}
        for k, output in enumerate(log.outputs):
            said.append(reading(log, output, {name: it[:, k] for name, it in finite.items()}))
    return said


def together(effects: Sequence[str]) -> str:
    """Return effects that act at once, in words."""
    return listed(map(words, effects)) if effects else "parameters alone"
