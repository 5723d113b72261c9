"""Stretches of logs by themselves: those that a description holds out, and each log or half of one.

An effect that serves on the whole may spoil one kind of motion.  There it stands for something
else, or something more is missing.

Two servos in one description, a gain changed midway, a part that has slipped: no effect of the
catalogue is that, and each log, or each half of one, is explained once its parameters are its own.
An effect that acts differently in each may look the same, so that is said as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.localisation.breakdown import grows
from servo_models.diagnosis.ranking import Value, estimates
from servo_models.diagnosis.search.crossval import BLOCKS
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.limit_cycle import lacks
from servo_models.diagnosis.search.selection import Selection
from servo_models.identification.problem import Problem
from servo_models.report.document import Document, Unbounded

FAR_LESS = 0.5  # RMS of parts by themselves over that of all together, from which they may differ
APART_ERRORS = 5.0  # combined standard errors between parts beyond which a parameter has changed


class UnseenOutput(Document, frozen=True):
    """RMS [SI] of an output at samples that the description holds out, unweighted: of the nominal
    model, re-tuned, and of the model that was taken; null where one cannot be simulated."""

    unit: str
    before: Unbounded
    retuned: Unbounded
    after: Unbounded


class HeldOut(Document, frozen=True):
    """The same of all outputs of a log, in noise floors.

    Attributes:
        log: its name.
        samples: how many are held out.
        before, retuned, after: NaN where that model cannot be simulated.
        worse: the model that was taken leaves more than parameters alone, beyond what blocks of
            time scatter; never where these cannot be simulated.
        outputs: each by itself.
    """

    log: str
    samples: int
    before: Unbounded
    retuned: Unbounded
    after: Unbounded
    worse: bool
    outputs: dict[str, UnseenOutput]


def held_out_scores(selection: Selection) -> tuple[HeldOut, ...]:
    """Return what each stage leaves of every log with samples held out."""
    retuned, taken = selection.retuned, selection.taken
    nominal = retuned.problem.values(selection.before.vector)
    runs = ((retuned, nominal), (retuned, retuned.values), (taken, taken.values))
    stages = zip(*(one.problem.held_out_squares(values) for one, values in runs))
    logs = zip(taken.problem.logs, stages)
    return tuple(_held_out(taken.problem, log, each) for log, each in logs if log.checked.any())


def _held_out(problem: Problem, log: Log, stages: Sequence[Array]) -> HeldOut:
    _, old, new = (np.mean(squares, axis=0) for squares in stages)
    parts = np.arange(len(old)) * BLOCKS // len(old)
    grown = np.isnan(new).any() or grows(old, new, np.zeros_like(parts), parts, 1)[0]
    worse = bool(grown) and not np.isnan(old).any()
    sizes = np.sqrt([np.mean(squares, axis=1) for squares in stages])
    wires = problem.model.plant.wire
    outputs = {
        name: UnseenOutput(wires[name].unit, *(problem.sigma[name] * each).tolist())
        for name, each in zip(log.outputs, sizes.T)
    }
    before, retuned, after = np.sqrt(np.mean(sizes**2, axis=1)).tolist()
    return HeldOut(log.name, len(old), before, retuned, after, worse, outputs)


def held_out_outputs(scores: Sequence[HeldOut]) -> dict[str, UnseenOutput]:
    """Return what each stage leaves of every output, of all logs together."""
    found = {}
    for name in dict.fromkeys(name for one in scores for name in one.outputs):
        logs = [(one.samples, one.outputs[name]) for one in scores if name in one.outputs]
        squares = [[it.before**2, it.retuned**2, it.after**2] for _, it in logs]
        mean = np.average(squares, axis=0, weights=[samples for samples, _ in logs])
        found[name] = UnseenOutput(logs[0][1].unit, *np.sqrt(mean).tolist())
    return found


def gains(scores: Sequence[HeldOut], since: str, least_gain: float) -> bool:
    """Return whether the model that was taken lowers the error of a stage by this share, of all
    samples held out that the stage can simulate; True where there are none."""
    each = [(one.samples, getattr(one, since), one.after) for one in scores]
    count, old, new = np.array([it for it in each if not np.isnan(it[1])]).reshape(-1, 3).T
    return bool(count @ new**2 <= (1.0 - least_gain) ** 2 * (count @ old**2))


def contradicted(
    selection: Selection, scores: Sequence[HeldOut], least_gain: float
) -> tuple[str, ...]:
    """Return the effects against which speaks what is held out: all that were taken where a log
    gets worse, or all logs better by less than the least gain; else those that, beside the others,
    lower its error by less."""
    taken = selection.taken
    if any(one.worse for one in scores) or not gains(scores, "retuned", least_gain):
        return taken.effects
    fewer = {frozenset(it.causes): it for it in reversed(selection.tried)}
    others = {name: fewer.get(frozenset(taken.causes) - {name}) for name in taken.effects}
    least = _unseen(taken) / (1.0 - least_gain) ** 2
    return tuple(name for name, model in others.items() if model and _unseen(model) < least)


def _unseen(model: FittedModel) -> float:
    """Squared errors [noise floors^2] at samples that are held out."""
    squares = model.problem.held_out_squares(model.values)
    return float(sum(np.mean(each, axis=0).sum() for each in squares))


@dataclass(frozen=True)
class Part:
    """A log or a half of one, fitted by itself.

    Attributes:
        log: its name.
        half: ``"first"``, ``"second"``, or ``""`` for the whole log.
        value: of the parameter that differs most between parts.
        left: RMS [noise floors] that the model leaves there.
        sure: each part is explained by parameters of its own; else each is merely far nearer.
    """

    log: str
    half: str
    value: Value
    left: float
    sure: bool


def unlike_parts(
    fitter: Fitter, selection: Selection, explain: Callable[[Fitter], FittedModel]
) -> tuple[Part, ...]:
    """Return logs, or halves of them, of which parameters alone leave noise only if they are their
    own, or they and the effects that were taken, or those that ``explain`` the first part.  Where
    something is left, parts of which far less is left; none where no parameter differs surely."""
    fitter, possible = fitter.surveyed(), tuple[Part, ...]()
    logs = [log for log in fitter.logs if log.fitted.any()]
    halves = [half for log in logs for half in _halves(log)]
    for parts in ([(log, "") for log in logs], halves)[len(logs) == 1 :]:
        each = [replace(fitter, logs=(log,)) for log, _ in parts]
        least, models = FAR_LESS * selection.taken.evidence.rms, [selection.taken]
        if selection.retuned is not selection.taken:
            models.insert(0, selection.retuned)
        for model in models:
            fitted = [alone.fit_from(model) for alone in each if model.problem.free]
            left = np.array([one.evidence.rms for one in fitted])
            if not fitted or rms(left) > least:
                continue
            sure = left.max() <= fitter.settings.enough_floors
            sure = sure and not any(lacks(one, one) for one in fitted)
            told = tuple(
                Part(log.name, half, value, one.evidence.rms, sure)
                for (log, half), one, value in zip(parts, fitted, _most_apart(fitted))
            )
            if told and sure:
                return told
            possible = possible or told
            if model is selection.taken:
                models.append(explain(each[0]))  # beside what differs, an effect is not seen
    return possible


def _halves(log: Log) -> list[tuple[Log, str]]:
    """The halves of what a fit sees of a log."""
    rows = np.flatnonzero(log.fitted)
    early = np.arange(len(log.times)) < rows[len(rows) // 2]
    halves = ((~early, "first"), (early, "second"))
    return [(replace(log, skipped=~log.counted | unseen), name) for unseen, name in halves]


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
