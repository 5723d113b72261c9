"""The models that a diagnosis compares, and how a page speaks of them."""

from __future__ import annotations

from collections.abc import Iterable

from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling.words import listed
from servo_models.report.identification.readings import Reading, reading, words

NOMINAL, RETUNED, WITH_ONE, WITH_MORE = "nominal", "re-tuned", "with effect", "with effects"


def stages(found: Diagnosis) -> dict[str, str]:
    """Return the stages of ``Gap.rms`` that differ, each with its name for people."""
    taken = found.causes.taken
    named = {"before": NOMINAL}
    if taken.problem.free and found.causes.retuned.problem.free:
        named["retuned"] = RETUNED
    if taken.effects:
        named["after"] = WITH_ONE if len(taken.effects) == 1 else WITH_MORE
    return named


def readings(found: Diagnosis) -> list[Reading]:
    """Return every output of every log beside what each model makes of it, in their order."""
    causes = found.causes
    vectors = {
        "before": (causes.retuned.problem, causes.before.vector),
        "retuned": (causes.retuned.problem, causes.retuned.evidence.vector),
        "after": (causes.taken.problem, causes.taken.evidence.vector),
    }
    responses = {
        name: vectors[stage][0].responses(vectors[stage][1])
        for stage, name in stages(found).items()
    }
    return [
        reading(log, output, {name: runs[k][output] for name, runs in responses.items()})
        for k, log in enumerate(found.logs)
        for output in log.outputs
    ]


def together(effects: Iterable[str]) -> str:
    """Return effects that act at once, in words."""
    return listed(map(words, effects))
