"""A job of a survey: the joint of a unit, checked and diagnosed, and what is kept of it.

What is kept is one JSON document: figures of the diagnosis that are compared between jobs, the
values of every episode by itself, and the diagnosis whole.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgspec
import numpy as np

from servo_models.data.description import read_description
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.ranking import Value
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.summary import sentence
from servo_models.diagnosis.verdict import NO_GAP, OUTSIDE, weights_by_effects
from servo_models.errors import UserError
from servo_models.identification.check import check
from servo_models.identification.linear_inference import spread
from servo_models.identification.optimise import descend
from servo_models.report.document import Digest, Document, Figure, Magnitude, Share, about
from servo_models.report.html import page
from servo_models.report.numbers import plural
from servo_models.report.result import page_of

FAILED = "failed"
VERSION = 2  # of what is kept: it counts up when a reader of the one before would go wrong
EPISODE_COST_TOLERANCE = 1e-4  # of the fit to an episode, which begins at that to all of them
LIMITS = 2.0  # time limits from the begin of a job, after which no single log is fitted
EPISODE_STEPS = 20  # least-squares steps of such a fit


@dataclass(frozen=True)
class Job:
    """The joint of a unit, and how it is diagnosed.

    Attributes:
        unit, joint: whose logs they are.
        description: its file.
        conditions: what is known of the unit beside its logs, by name.
        failure: why there is no description that can be read.
        key: hash of the description, its data, the version and ``options``.
        options: keywords of ``diagnose``, such as ``seed`` and ``quick``.
        trust: Python files that the description names are run wherever they lie.
        report: a page is wanted.
    """

    unit: str
    joint: str
    description: Path
    conditions: Mapping[str, str] = field(default_factory=dict)
    failure: str = ""
    key: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    trust: bool = False
    report: bool = True


class Done(NamedTuple):
    """A job with the JSON that is kept of it and its page, empty where none is wanted."""

    job: Job
    kept: bytes
    page: bytes = b""


class Estimate(Document, frozen=True):
    """A parameter, of the model or of an effect [SI].  ``standard_error`` is null where the logs do
    not tell, ``prior`` where nothing is known before."""

    name: str
    unit: str
    nominal: float
    prior: Annotated[Figure, about("Standard deviation of the nominal value.")]
    value: float
    standard_error: Figure


class Cause(Document, frozen=True):
    """An effect that was fitted; see the diagnosis."""

    effect: str
    taken: bool
    in_set: bool
    probability: Share | None
    sizes: list[Estimate]


class Explanation(Document, frozen=True):
    """A fitted model of the set that cannot be told apart, with its model weight."""

    effects: Sequence[str]
    weight: Share


class Episode(Document, frozen=True):
    """A log with the diagnosed model fitted to it alone, from its nominal values and their errors.
    ``left`` [noise floors] is what the model of all logs leaves there."""

    log: str
    held_out: bool
    left: Figure
    estimates: list[Estimate]


class Outcome(Document, frozen=True, kw_only=True):
    """What is kept of a job.  Where it failed, ``failure`` says why, and figures are null."""

    schema_version: int = VERSION
    key: Digest
    unit: str
    joint: str
    conditions: Annotated[Mapping[str, str], about("As of then; no diagnosis uses them.")]
    description: Annotated[str, about("Name of its file.")]
    actuator: Annotated[str, about("Its name, or the path of its file.")] = ""
    variant: str = ""
    failure: str = ""
    seconds: Magnitude
    warnings: Sequence[str] = ()
    verdict: str = ""
    sentence: str = ""
    stopped: Annotated[str, about("Why its search ended early.")] = ""
    gap_before: Figure = None
    gap_before_interval: Annotated[tuple[float, float] | None, about("Of 95 %.")] = None
    gap_after: Figure = None
    held_out: Annotated[Figure, about("RMS of what no fit has seen, largest of all logs.")] = None
    causes: Sequence[Cause] = ()
    explanations: Sequence[Explanation] = ()
    parameters: Annotated[Sequence[Estimate], about("Nominal parameters, as re-tuned.")] = ()
    episodes: Sequence[Episode] = ()
    diagnosis: Annotated[
        msgspec.Raw, about("As of servo-models diagnose --json; null: failed.")
    ] = msgspec.Raw(b"null")

    @property
    def said(self) -> str:
        """The verdict, ``failed`` where there is none."""
        return self.verdict or FAILED

    @property
    def conclusive(self) -> bool:
        """Whether its diagnosis ended by itself, and inside the catalogue: else its causes are only
        the best so far, or what is nearest, and nobody's."""
        return not (self.failure or self.stopped or self.verdict == OUTSIDE)

    @property
    def taken(self) -> list[Cause]:
        """The effects that were taken, most likely first."""
        return [cause for cause in self.causes if cause.taken]

    @property
    def badness(self) -> tuple[int, float]:
        """What sorts outcomes: no gap, then what failed, then gaps by size."""
        rank = 1 if self.failure else 2 * (self.verdict != NO_GAP)
        return rank, self.gap_before or 0.0

    @property
    def model(self) -> str:
        """Actuator, of which each unit may have a copy, and variant."""
        return f"{Path(self.actuator).name} {self.variant}"


def run(job: Job) -> Done:
    """Check and diagnose; a fault of the description or of its logs is an outcome, too."""
    begin = time.perf_counter()
    try:
        description = read_description(job.description, job.trust)
        warnings = check(description).warnings
        found = replace(diagnose(description, jobs=1, **job.options), written=())
        titled = replace(found, name=f"{job.unit}, {job.joint}")
        shown = page(page_of(titled)).encode() if job.report else b""
    except (UserError, MemoryError) as error:
        why = str(error) or "it needs more memory"
        return failed(job, why, time.perf_counter() - begin)
    known = {free.name for free in found.selection.taken.nominal}  # of effects that are on as well
    weights = weights_by_effects(found.selection, found.verdict)
    limit = job.options.get("time_limit") or math.inf
    episodes = [*_episodes(found, begin + LIMITS * limit)]
    problem = found.selection.taken.problem
    if problem.free and (left := len(problem.logs) - len(episodes)):
        warnings = (*warnings, f"no time was left to fit {plural(left, 'log')} alone")
    kept = _kept(
        job,
        actuator=found.model.actuator.key,
        variant=found.model.variant,
        warnings=warnings,
        verdict=found.verdict.kind,
        sentence=sentence(found),
        stopped=found.stopped,
        gap_before=found.gap.rms["before"],
        gap_before_interval=found.gap.intervals["before"],
        gap_after=found.gap.rms["after"],
        held_out=max((log.after for log in found.held_out), default=None),
        causes=[
            Cause.made_from(effect, effect=effect.name, sizes=_estimates(found, effect.parameters))
            for effect in found.ranking
        ],
        explanations=[Explanation(it.effects, weights[it.effects]) for it in found.verdict.rivals],
        parameters=_estimates(found, (value for value in found.found if value.name in known)),
        episodes=episodes,
        diagnosis=msgspec.Raw(found.to_json().encode()),
        seconds=time.perf_counter() - begin,
    )
    return Done(job, kept, shown)


def failed(job: Job, why: str, seconds: float = 0.0) -> Done:
    """Return what is kept of a job that came to nothing."""
    return Done(job, _kept(job, failure=why, seconds=seconds))


def _kept(job: Job, **known: Any) -> bytes:
    outcome = Outcome(
        key=job.key,
        unit=job.unit,
        joint=job.joint,
        conditions=job.conditions,
        description=job.description.name,
        **known,
    )
    return msgspec.json.encode(outcome)


def _estimates(found: Diagnosis, values: Iterable[Value]) -> list[Estimate]:
    parameters = found.model.plant.parameters
    priors = {free.name: free.believed for free in found.selection.taken.nominal}
    return [
        Estimate(
            value.name,
            parameters[value.name].param.unit,
            value.nominal,
            priors.get(value.name),
            value.value,
            value.standard_error if np.isfinite(value.standard_error) else None,
        )
        for value in values
    ]


def _episodes(found: Diagnosis, end: float) -> Iterator[Episode]:
    """The taken model, fitted to each log alone, as many as begin before this moment."""
    taken = found.selection.taken
    problem, begin = taken.problem, taken.evidence.vector
    for log in problem.logs if problem.free else ():
        if time.perf_counter() > end:
            return
        unseen, seen = (
            replace(problem, logs=(replace(log, held_out=np.full_like(log.held_out, is_unseen)),))
            for is_unseen in (True, False)
        )
        (squares,) = unseen.held_out_squares(taken.values)
        vector, _, _ = descend(seen, begin, EPISODE_COST_TOLERANCE, EPISODE_STEPS)
        values, errors = seen.values(vector), spread(seen, vector).standard_errors
        fitted = [
            Value(free.name, free.nominal, values[free.name], float(error))
            for free, error in zip(problem.free, errors)
        ]
        left = float(np.sqrt(np.mean(squares)))
        yield Episode(log.name, bool(log.held_out.any()), left, _estimates(found, fitted))
