"""Rehearse a diagnosis: what would these commands show, if an effect were there?

Each effect in turn is switched on in the user's own model, at sizes whose gap is so many noise
floors, with nominal parameters drawn from what is believed of them.  Its logs are simulated with
the noise of the sensors and diagnosed.  They are made by the equations that are fitted, an inverse
crime: what is found is an upper bound of what a real log shows.
Source: Wirgin, "The inverse crime", arXiv:math-ph/0401050 (2004).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import field

from servo_models.analysis.explain import shown_value
from servo_models.analysis.statistics import rms
from servo_models.core.plant import check_known
from servo_models.core.stop import Tell, silent
from servo_models.core.types import Array
from servo_models.data.audit import audits, noise_floors
from servo_models.data.description import read_description
from servo_models.data.log import Log
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.preconditions import without_flags
from servo_models.diagnosis.search.candidates import LEAST_OVER_TYPICAL, Values, candidates
from servo_models.diagnosis.verdict import NO_GAP, NOT_IDENTIFIABLE, OUTSIDE, PARAMETERS
from servo_models.errors import UserError
from servo_models.identification.fit import checked_logs
from servo_models.identification.problem import prior_parameters
from servo_models.identification.simulation import prepared
from servo_models.report.document import Document, Figure, Magnitude, Share, about, choice
from servo_models.report.numbers import listed, plural
from servo_models.report.result import Result
from servo_models.survey.engine import Worker, here, processes
from servo_models.survey.survey import duration
from servo_models.units import parse

__all__ = ["Rehearsal", "rehearse"]

GAPS = (3.0, 10.0)  # noise floors: a gap that is seen, and one that is large
LADDER = 30  # sizes among which a gap is sought, and again between two of these
QUANTUM = 12.0**-0.5  # standard deviation of rounding, over the step
SECONDS_PER_EFFECT, RUNS_PER_EFFECT = 0.1, 150  # of a diagnosis: a first guess of its time

FOUND = "found"
AMONG = "one of several"
IMITATED = "imitated by parameters"
UNSEEN = "no gap"
OTHER = "taken for another"
BEYOND = "outside the catalogue"
CANNOT_SHOW = "cannot show"
NO_EFFECT = "no effect"  # right where there is none
FAILED = "failed"
TOLD = (FOUND, AMONG, IMITATED, UNSEEN, OTHER, BEYOND, CANNOT_SHOW, NO_EFFECT, FAILED)


class Sensor(NamedTuple):
    """How an output is read: white noise of a standard ``deviation``, then ``step`` [SI]."""

    unit: str
    deviation: float
    step: float

    @property
    def floor(self) -> float:
        """Noise floor [SI]."""
        return float(np.hypot(self.deviation, self.step * QUANTUM))

    def read(self, values: Array, random: np.random.Generator) -> Array:
        """Return a signal as it is read, shape (n,)."""
        noisy = values + self.deviation * random.standard_normal(len(values))
        return self.step * np.round(noisy / self.step) if self.step else noisy


class Case(NamedTuple):
    """An effect to be put into the model, "" for none, and the gap wanted [noise floors]."""

    effect: str
    wanted: float


class Answer(Document, frozen=True):
    """What a diagnosis told of an effect that was in the model; ``effect`` is "" for none.

    Where it cannot show, ``size`` is that with the largest gap, and nothing was diagnosed.
    """

    effect: str
    wanted: Annotated[float, about("Gap to be made [noise floors].")]
    told: Annotated[str, choice(*TOLD)]
    parameter: str = ""
    unit: str = ""
    size: Figure = None
    gap: Annotated[Figure, about("That it makes [RMS, noise floors].")] = None
    named: list[str] = field(default_factory=list)
    weights: Annotated[dict[str, Share], about("Of effects that are told, 1 of a verdict.")] = (
        field(default_factory=dict)
    )
    seconds: Magnitude = 0.0
    failure: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Rehearsal(Result):
    """What a diagnosis would tell of each effect.

    Attributes:
        name: of the description.
        answers: what was told, without an effect first, then of the largest gap wanted.
        sensors: by output.
        notes: what is not measured yet.
        unfinished: cases that were not tried, since it was stopped.
    """

    name: str
    answers: tuple[Answer, ...]
    sensors: Mapping[str, Sensor]
    notes: tuple[str, ...] = ()
    unfinished: int = 0


def rehearse(
    description: str | Path,
    noise: Mapping[str, float | str] | None = None,
    gaps: Sequence[float] = GAPS,
    effects: Iterable[str] = (),
    jobs: int | None = None,
    seed: int = 0,
    time_limit: float | None = None,
    trust: bool = False,
    tell: Tell = silent,
) -> Rehearsal:
    """Ask the diagnosis what it would tell of each effect, from these commands.

    Ctrl-C ends it with what was done.

    Args:
        description: TOML file; its logs may lack the columns of outputs, before they are measured.
        noise: standard deviation of readings, by output; by default as in the logs, or by the
            resolution of a column, which is its ``scale``.
        gaps: that an effect is to make, RMS [noise floors].
        effects: which, by default all that the model has switched off.
        jobs: processes, by default one a processor.
        seed: of noise and of the true parameters, drawn from what is believed of them.
        time_limit: time [s] for each diagnosis.
        trust: run Python files that the description names wherever they lie.
        tell: is told what goes on.

    Raises:
        UserError: an unknown output, or effect, or one that no diagnosis of these logs tries; noise
            that nobody tells; gaps or jobs that are not above 0; see ``read_description`` and
            ``identification.fit.checked_logs``.

    Example:
        >>> import servo_models as sm
        >>> found = sm.rehearse("gimbal.toml", effects=["transport_delay"], gaps=[10.0], jobs=1)
        >>> [(answer.effect, answer.told) for answer in found.answers]
        [('', 'no effect'), ('transport_delay', 'found')]
    """
    count = processes(jobs)
    if not all(0.0 < gap < np.inf for gap in gaps):
        raise UserError(f"gaps {[*gaps]}: give numbers of noise floors, such as 3 and 10")
    arguments = (Path(description), trust, noise or {}, seed, time_limit)
    rig = Rig(*arguments)
    chosen = [*effects] or [*rig.candidates]
    rig.check_tried(chosen)
    cases = [Case("", 0.0), *(Case(it, gap) for gap in sorted(gaps)[::-1] for it in chosen)]
    lasts = f"about {duration(len(cases) * rig.seconds / count)} on"
    tell(f"{len(cases)} diagnoses to do, {lasts} {plural(count, 'processor')}")
    answers: dict[Case, Answer] = {}
    begin = time.monotonic()
    workers = [Worker(time_limit, _failed, Rig, *arguments) for _ in range(count)]
    with suppress(KeyboardInterrupt), closing(here(iter(cases), workers)) as results:
        for one in results:
            answers[Case(one.effect, one.wanted)] = one
            left = (time.monotonic() - begin) / len(answers) * (len(cases) - len(answers))
            said = f"{duration(left)} left; {one.effect or 'no effect'}: {one.told}"
            tell(said, len(answers) - 1, len(cases))
    return Rehearsal(
        rig.description.path.stem,
        tuple(answers[it] for it in cases if it in answers),
        rig.sensors,
        tuple(note for log in rig.description.logs if _is_planned(log) for note in log.notes),
        len(cases) - len(answers),
    )


def _failed(case: Case, why: str) -> Answer:
    return Answer(*case, FAILED, failure=why)


class Rig:
    """The user's model, which an effect is put into, and the commands of which it makes logs."""

    def __init__(
        self,
        path: Path,
        trust: bool,
        noise: Mapping[str, float | str],
        seed: int,
        limit: float | None,
    ) -> None:
        """See ``rehearse``."""
        told = read_description(path, trust, planned=True)
        logs, _ = without_flags(told.logs, told.model.plant)
        self.description, self.seed, self.limit = replace(told, logs=logs), seed, limit
        self.priors = prior_parameters(told)
        measured = [log for log in logs if not _is_planned(log)]
        begun = iter(checked_logs(told.model, measured, 0, path) if measured else ())
        self.runs = [
            # nothing tells how it begins where that is to be fitted
            prepared(told.model, replace(log, start=None) if _is_planned(log) else next(begun))
            for log in logs
        ]
        self.sensors = self._sensors(measured, noise)
        blank = self.logs({}, np.random.default_rng(seed))
        self.candidates = {it.name: it for it in candidates(told.model, blank)}

    def _sensors(
        self, measured: Sequence[Log], given: Mapping[str, float | str]
    ) -> dict[str, Sensor]:
        """Sensors of the outputs: as given, as measured, or from the resolution of a column."""
        plant = self.description.model.plant
        channels = {k: log.channels[k] for log in self.description.logs for k in log.outputs}
        check_known("output", given, channels, "noise")
        audited = audits(measured, plant) if measured else ()
        floors, sensors = noise_floors(audited), {}
        steps = {it.name: it.step for one in audited for it in one.readings}
        for name, channel in channels.items():
            unit = plant.wire[name].unit
            step = steps.get(name, abs(channel.scale) if channel.told[0] != 1.0 else 0.0)
            beyond = max(floors.get(name, 0.0) ** 2 - (QUANTUM * step) ** 2, 0.0) ** 0.5
            sensor = Sensor(unit, parse(given[name], unit) if name in given else beyond, step)
            if not (sensor.deviation >= 0.0 and 0.0 < sensor.floor < np.inf):
                raise UserError(
                    f"'{self.description.path}': nothing tells the noise of '{name}'; give its"
                    f" standard deviation above 0, such as --noise {name}='0.1 {unit}'"
                )
            sensors[name] = sensor
        return sensors

    def check_tried(self, effects: Iterable[str]) -> None:
        """Raise UserError, with the reason, for an effect that no diagnosis of these logs tries."""
        model, path = self.description.model, self.description.path
        for name in (it for it in effects if it not in self.candidates):
            check_known("effect", [name], {**self.candidates, **model.plant.placements})
            link, every = model.plant.main(name), model.plant.parameters.values()
            switches = [it for it in every if it.owner == name and it.param.switch]
            on = {it.name: shown_value(it, v) for it in switches if (v := model.values[it.name])}
            if on:
                values = listed(f"{parameter} = {value}" for parameter, value in on.items())
                off = listed(f"'{parameter} = 0'" for parameter in on)
                why = f"it is on in the model ({values}), where it is a parameter; to rehearse it"
                why += f" as an effect write {off} under [parameters] of '{path}'"
            elif link.effect.hints.learnt:
                why = "it is learnt from what a diagnosis leaves, and never tried: leave it out"
            else:
                why = f"'{link.on[0]}' has one value in all logs: let it change, or leave it out"
            raise UserError(f"effect '{name}' cannot be rehearsed: {why}")

    @property
    def seconds(self) -> float:
        """About the time that a diagnosis takes [s]."""
        runs = []
        for seed in range(3):  # the first may compile
            values, begin = self.drawn(np.random.default_rng(seed)), time.perf_counter()
            self.changed({}, values)
            runs.append(time.perf_counter() - begin)
        return len(self.candidates) * (SECONDS_PER_EFFECT + RUNS_PER_EFFECT * min(runs))

    def logs(self, values: Values, random: np.random.Generator) -> tuple[Log, ...]:
        """Logs with these values [SI], as the sensors read them."""
        return tuple(
            replace(
                log,
                outputs={
                    name: self.sensors[name].read(clean, random)
                    for name, clean in zip(run.log.outputs, run.outputs(values).T)
                },
            )
            for log, run in zip(self.description.logs, self.runs)
        )

    def changed(self, values: Values, others: Values) -> float:
        """RMS [noise floors] by which other values change what a fit sees; infinite where they
        cannot be simulated."""
        changes = []
        for run in self.runs:
            floors = [self.sensors[name].floor for name in run.log.outputs]
            try:
                change = (run.outputs(others) - run.outputs(values)) / floors
            except UserError:
                return np.inf
            changes.append(change[run.log.fitted].ravel())
        return rms(np.concatenate(changes))

    def drawn(self, random: np.random.Generator) -> Values:
        """True parameters [SI], from what is believed of them."""
        return {
            it.name: float(np.clip(random.normal(it.nominal, it.prior or 0.0), it.low, it.high))
            for it in self.priors
        }

    def sized(self, effect: str, values: Values, wanted: float) -> tuple[str, float, float]:
        """Return the switch of an effect, the least size [SI] that makes the gap wanted and the gap
        of that, else the size with the largest gap."""
        candidate = self.candidates[effect]
        switch = next(it for it in candidate.free if it.name == candidate.switches[0])

        def gap(size: float) -> float:
            return self.changed(values, {**values, switch.name: size})

        param = self.description.model.plant.parameters[switch.name].param
        # not the low end of a fit: without the limit, the logs of a rehearsal exceed it
        weak, strong = max(param.low, LEAST_OVER_TYPICAL * param.typical), switch.high
        if gap(weak) >= gap(strong):  # a limit
            weak, strong = strong, weak
        for _ in range(2):
            sizes = np.geomspace(weak, strong, LADDER)
            gaps = np.array([gap(float(size)) for size in sizes])
            k = int(np.argmax(gaps >= wanted if gaps.max() >= wanted else gaps))
            weak, strong = sizes[max(k - 1, 0)], sizes[k]
        return switch.name, float(sizes[k]), float(gaps[k])

    def __call__(self, case: Case) -> Answer:
        """Make the logs of a case and diagnose them."""
        begin = time.perf_counter()
        random = np.random.default_rng([self.seed, int(1e3 * case.wanted), *case.effect.encode()])
        try:
            values = self.drawn(random)
            known: dict[str, Any] = {}
            if case.effect:
                parameter, size, gap = self.sized(case.effect, values, case.wanted)
                unit = self.description.model.plant.parameters[parameter].param.unit
                known = {"parameter": parameter, "unit": unit, "size": size, "gap": gap}
                if gap < case.wanted:
                    return Answer(*case, CANNOT_SHOW, **known)
                values[parameter] = size
            logs = self.logs(values, random)
            found = diagnose(replace(self.description, logs=logs), jobs=1, time_limit=self.limit)
        except UserError as error:
            return _failed(case, str(error))
        verdict, weights = found.verdict, {}
        if found.stopped and verdict.kind == OUTSIDE:  # nothing was told yet
            return _failed(case, f"stopped {found.stopped}, before an answer: give it more time")
        if verdict.kind not in (NO_GAP, PARAMETERS, OUTSIDE):
            weights = {name: verdict.weights[name] for name in verdict.members}
        named = list(found.selection.taken.effects)
        return Answer(
            *case,
            _told(case.effect, verdict.kind, {*verdict.members, *named}),
            **known,
            named=named,
            weights=weights or {verdict.kind: 1.0},
            seconds=time.perf_counter() - begin,
        )


def _told(effect: str, kind: str, names: set[str]) -> str:
    """What a diagnosis says of an effect that is there, from its verdict and what it names."""
    if kind in (NO_GAP, PARAMETERS):
        return (UNSEEN if kind == NO_GAP else IMITATED) if effect else NO_EFFECT
    if kind == OUTSIDE:
        return BEYOND
    if effect not in names:
        return OTHER
    return FOUND if names == {effect} and kind != NOT_IDENTIFIABLE else AMONG


def _is_planned(log: Log) -> bool:
    """Whether an output is yet to be measured."""
    return any(np.isnan(values).any() for values in log.outputs.values())
