"""Stretches of logs by themselves: those that a description holds out, and each log or half of one.

An effect that serves on the whole may spoil one kind of motion.  There it stands for something
else, or something more is missing.

Two servos in one description, a gain changed midway, a part that has slipped: no effect of the
catalogue is that, and each log, or each half of one, is explained once its parameters are its own.
An effect that acts differently in each may look the same, so that is said as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from servo_models.data.log import Log
from servo_models.diagnosis.localisation.breakdown import grows
from servo_models.diagnosis.ranking import Value, estimates
from servo_models.diagnosis.search.crossval import BLOCKS
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.limit_cycle import lacks
from servo_models.diagnosis.search.selection import Selection
from servo_models.report.document import Document, Unbounded

APART_ERRORS = 5.0  # combined standard errors between parts beyond which a parameter has changed


class HeldOut(Document, frozen=True):
    """Samples of a log that no fit of a diagnosis has seen, RMS in noise floors.

    Attributes:
        log: its name.
        retuned: left by nominal parameters alone, NaN where these cannot be simulated.
        after: left by the fitted model that was taken, NaN where it cannot be simulated.
        worse: it leaves more, beyond what blocks of time scatter; never without ``retuned``.
    """

    log: str
    retuned: Unbounded
    after: Unbounded
    worse: bool


def held_out_scores(selection: Selection) -> tuple[HeldOut, ...]:
    """Return what the fitted model that was taken does to each log with samples held out."""
    scores = []
    stages = (selection.retuned, selection.taken)
    pairs = zip(*(it.problem.held_out_squares(it.values) for it in stages))
    for log, (old, new) in zip(selection.taken.problem.logs, pairs):
        if len(old):
            parts = np.arange(len(old)) * BLOCKS // len(old)
            retuned, after = (float(np.sqrt(part.mean())) for part in (old, new))
            grown = np.isnan(after) or grows(old, new, np.zeros_like(parts), parts, 1)[0]
            scores.append(HeldOut(log.name, retuned, after, bool(grown) and not np.isnan(retuned)))
    return tuple(scores)


@dataclass(frozen=True)
class Part:
    """A log or a half of one, explained by itself.

    Attributes:
        log: its name.
        half: ``"first"``, ``"second"``, or ``""`` for the whole log.
        value: of the parameter that differs most between parts.
        left: RMS [noise floors] that the model leaves there.
    """

    log: str
    half: str
    value: Value
    left: float


def unlike_parts(fitter: Fitter, selection: Selection) -> tuple[Part, ...]:
    """Return parts each of which parameters alone explain if they are its own, or they and the
    effects that were taken; none where a part is not explained, or no parameter differs surely."""
    fitter, parts = fitter.surveyed(), _parts(fitter.logs)
    for model in dict.fromkeys((selection.retuned, selection.taken)):
        fitted = list(_fitted(fitter, parts, model)) if model.problem.free else []
        if fitted and len(fitted) == len(parts):
            return tuple(
                Part(log.name, half, value, alone.evidence.rms)
                for (log, half), alone, value in zip(parts, fitted, _most_apart(fitted))
            )
    return ()


def _parts(logs: Sequence[Log]) -> list[tuple[Log, str]]:
    """Logs that a fit sees, or the halves of what it sees of a single one."""
    seen = [log for log in logs if log.fitted.any()]
    if len(seen) > 1:
        return [(log, "") for log in seen]
    (log,) = seen
    rows = np.flatnonzero(log.fitted)
    early = np.arange(len(log.times)) < rows[len(rows) // 2]
    halves = ((~early, "first"), (early, "second"))
    return [(replace(log, skipped=~log.counted | unseen), name) for unseen, name in halves]


def _fitted(
    fitter: Fitter, parts: Sequence[tuple[Log, str]], model: FittedModel
) -> Iterator[FittedModel]:
    """The model fitted to each part, up to one that it does not explain."""
    for log, _ in parts:
        alone = replace(fitter, logs=(log,)).fit_from(model)
        if lacks(alone, alone) or alone.evidence.rms > fitter.settings.enough_floors:
            return
        yield alone


def _most_apart(fitted: Sequence[FittedModel]) -> list[Value]:
    """The values of the parameter that differs most between parts, none where none does."""
    every = [{value.name: value for value in estimates(one)} for one in fitted]

    def apart(name: str) -> float:
        pairs = combinations([one[name] for one in every], 2)
        return max(
            (abs(a.value - b.value) / np.hypot(a.standard_error, b.standard_error))
            if a.standard_error + b.standard_error < np.inf
            else 0.0
            for a, b in pairs
        )

    distances = {name: apart(name) for name in every[0]}
    most = max(distances, key=lambda name: distances[name], default="")
    return [one[most] for one in every] if most and distances[most] > APART_ERRORS else []
