"""What may be wrong with logs, tried: does a model explain them far better as they would be right?

A question that is asked of a log is a hypothesis.  The logs are read as it says, all logs of one
recorder alike, nominal parameters are re-tuned, and what is left decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.core.workers import ALONE, Workers
from servo_models.data.audit import Audit, audits, noise_floors
from servo_models.data.description import Description
from servo_models.data.log import Log
from servo_models.data.mistakes import Mistake
from servo_models.errors import UserError
from servo_models.identification.optimise import descend
from servo_models.identification.plausibility import answer_time, mistaken_columns
from servo_models.identification.priors import prior_parameters
from servo_models.identification.problem import Problem

FAR_BETTER = 0.5  # error of logs as they would be right over that as they stand, at most
COST_TOLERANCE = 1e-3  # relative decrease of the cost that ends a trial
MOST_STEPS = 10  # of a trial

Tried = Mapping[Mistake, float]
"""By mistake the error that re-tuned parameters leave of the logs as they would be right."""


def questions(told: Description) -> tuple[Audit, ...]:
    """Audits of the logs, with the columns that contradict the model among the mistakes."""
    model, answer = told.model, answer_time(told.model)
    return tuple(
        replace(it, mistakes=(*it.mistakes, *mistaken_columns(model, it.log, answer)))
        for it in audits(told.logs, model.plant)
    )


def tried(told: Description, asked: Sequence[Audit], workers: Workers = ALONE) -> Tried:
    """Try every mistake of which another reading is known."""
    return {
        mistake: retuned(told, _mended(told.logs, log, mistake), workers)
        for log, audit in zip(told.logs, asked)
        for mistake in audit.mistakes
        if mistake.mended
    }


def likely(
    told: Description, asked: Sequence[Audit], workers: Workers = ALONE
) -> tuple[Audit, ...]:
    """Audits without the mistakes that explain nothing: the logs are no better read otherwise."""
    errors = tried(told, asked, workers)
    if not errors:
        return tuple(asked)
    most = FAR_BETTER * retuned(told, told.logs, workers)
    return tuple(
        replace(it, mistakes=tuple(m for m in it.mistakes if errors.get(m, 0.0) <= most))
        for it in asked
    )


def _mended(logs: Sequence[Log], of: Log, mistake: Mistake) -> list[Log]:
    """The logs as they would be right: all that read the columns alike, or this one alone."""

    def alike(log: Log) -> bool:
        columns = [(it.channels.get(name) for it in (log, of)) for name in mistake.columns]
        return log is of or (mistake.everywhere and all(a == b for a, b in columns))

    assert mistake.mended
    return [mistake.mended(log) if alike(log) else log for log in logs]


def retuned(told: Description, logs: Sequence[Log], workers: Workers = ALONE) -> float:
    """Error that re-tuned parameters leave, see ``error``; infinite where nothing can be fitted."""
    floors = noise_floors(audits(logs, told.model.plant))
    try:
        problem = Problem(told.model, logs, prior_parameters(told), floors, workers)
        vector = problem.start
        if problem.free:
            vector, _, _ = descend(problem, vector, COST_TOLERANCE, MOST_STEPS)
        return error(problem.responses(vector), logs)
    except UserError:
        return np.inf


def error(responses: Sequence[Mapping[str, Array]], logs: Sequence[Log]) -> float:
    """RMS error over the standard deviation of the readings, over all outputs: of any scale."""
    shares = []
    for name in dict.fromkeys(name for log in logs for name in log.outputs):
        both = [
            (log.outputs[name][log.fitted], response[name][log.fitted])
            for log, response in zip(logs, responses)
            if name in log.outputs
        ]
        measured, simulated = (np.concatenate(parts) for parts in zip(*both))
        if len(measured) and np.ptp(measured) > 0.0:
            shares.append(rms(simulated - measured) / float(np.std(measured)))
    return rms(np.array(shares)) if shares else np.inf
