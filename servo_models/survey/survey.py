"""Survey a robot, a data set or a fleet: what ``servo-models survey`` does."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import fmean

from msgspec import structs

from servo_models.core.own_actuator import is_file
from servo_models.core.stop import Tell, silent
from servo_models.data.joints.drafts import as_file
from servo_models.data.parameters import write_parameters
from servo_models.errors import UserError
from servo_models.files import write_with
from servo_models.report.numbers import plural
from servo_models.survey.engine import GRACE_FACTOR, Worker, here, on_cluster, processes
from servo_models.survey.job import Done, Job, Outcome, failed, run
from servo_models.survey.plan import DESCRIPTIONS, counted, plan
from servo_models.survey.result import Survey, told_apart
from servo_models.survey.store import Store, key_of, read_outcomes

__all__ = ["Survey", "survey"]

COMMON = "common"  # folder of a survey with parameter files
SHORT_SECONDS = 60.0  # time limit whose effect is told where there is none
UNKNOWN = f"seconds to tens of minutes each; with --time-limit {SHORT_SECONDS:.0f}s "
POLL_SECONDS = 0.5  # between looks at what another process has in hand


def survey(
    path: str | Path,
    out: str | Path | None = None,
    actuator: str | None = None,
    jobs: int | None = None,
    scheduler: str | None = None,
    reports: bool = True,
    before: str | Path | None = None,
    seed: int = 0,
    quick: bool = False,
    time_limit: float | None = None,
    trust: bool = False,
    tell: Tell = silent,
) -> Survey:
    """Check and diagnose every joint of every unit, and compare them.

    What is done is kept in ``out``: killed and started again, a survey goes on where it was.

    Args:
        path: a recording of a robot (LeRobot, ROS 2), a folder of descriptions, recordings or logs,
            or a CSV table with columns ``log``, ``unit``, ``joint`` and any conditions.
        out: folder for results and first descriptions; by default beside the path, ``_survey``.
        actuator: what made logs without a description, by default guessed.
        jobs: processes, by default one a processor.
        scheduler: address of a Dask scheduler whose workers do the jobs.
        reports: write a page for each job.
        before: folder of an earlier survey to compare with.
        seed, quick: as for ``diagnose``.
        time_limit: time [s] for each job.
        trust: run Python files and simulations that descriptions name; without it only what a
            description that is ``path`` itself has beside it.
        tell: is told what goes on.

    Raises:
        UserError: nothing to diagnose, a folder that cannot be written, no scheduler; a job that
            fails is a row of the result.

    Example:
        >>> import servo_models as sm
        >>> fleet = sm.survey("gimbal.toml", out="found", jobs=2)
        >>> fleet.table().filter(verdict="effect")["causes"].to_list()
        ['drive_dead_zone']
    """
    root = Path(path)
    folder = Path(out) if out else root.parent / f"{root.stem or root.resolve().name}_survey"
    count = processes(jobs)
    earlier = told_apart(read_outcomes(Path(before))) if before else ()
    store = Store(folder)
    tell(f"looking for joints in '{root}'; what is found goes to '{folder}'")
    planned = plan(root, folder, actuator, trust, tell)
    drafts = folder.resolve() / DESCRIPTIONS
    if guessed := sum(drafts in one.description.parents for one in planned.jobs):
        ours = f"{plural(guessed, 'description')} of ours in '{folder / DESCRIPTIONS}'"
        tell(f"{ours}: look at what is guessed there")
    options = {"seed": seed, "quick": quick, "time_limit": time_limit}
    work = _Work(store, tell)
    for job in counted(planned.jobs, tell, "joints whose data were read"):
        key = key_of(job, options)
        work.add(replace(job, key=key, options=options, trust=trust, report=reports))
    if scheduler:
        work.do(lambda todo: on_cluster(todo, scheduler), "on the cluster", 1)
    else:
        where = f"on {plural(count, 'processor')}"
        workers = [Worker(time_limit, failed, partial, run) for _ in range(count)]
        work.do(lambda todo: here(todo, workers), where, count)
    outcomes = [
        structs.replace(work.outcomes[key], conditions=job.conditions)
        for key, job in work.jobs.items()
    ]
    found = Survey(root.resolve().name, told_apart(outcomes), tuple(planned.notes), earlier, folder)
    for name, table in (("table", found.table()), ("estimates", found.estimates())):
        write_with(folder / f"{name}.csv", table.write_csv)
        write_with(folder / f"{name}.parquet", table.write_parquet)
    for joint, units in Counter(joint for _, joint in found.by_place).items():
        if units > 1:
            with suppress(UserError):  # nothing is known that they have in common
                common = found.common(joint)
                if trust or not is_file(common.actuator):  # as kept in the folder, by anybody
                    write_parameters(common, folder / COMMON / f"{as_file(joint)}.toml")
    return found


class _Work:
    """The jobs of a survey, and what has come of them so far, by their keys."""

    def __init__(self, store: Store, tell: Tell) -> None:
        self.store, self.tell = store, tell
        self.jobs: dict[str, Job] = {}
        self.outcomes: dict[str, Outcome] = {}
        self.claims: dict[str, ExitStack] = {}

    def add(self, job: Job) -> None:
        """Add a job, with what is known of it."""
        self.jobs[job.key] = job
        known = self.store.get(job.key)
        if job.failure and known is None:
            known = self.store.put(failed(job, job.failure))
        if known is not None:
            self.outcomes[job.key] = known

    def do(
        self,
        engine: Callable[[Iterator[Job]], Generator[Done, None, None]],
        where: str,
        processes: int,
    ) -> None:
        """Do what is not done."""
        self.begin = time.monotonic()
        before, every = len(self.outcomes), len(self.jobs)
        units = len({job.unit for job in self.jobs.values()})
        seconds = [outcome.seconds for outcome in self.outcomes.values() if not outcome.failure]
        failures = f" ({before - len(seconds)} failed)" if len(seconds) < before else ""
        if before == every:
            left = ""
        elif seconds:
            left = f", about {duration(fmean(seconds) * (every - before) / processes)} {where}"
        else:
            limit = next(iter(self.jobs.values())).options["time_limit"]
            rounds = math.ceil((every - before) / processes)
            most = rounds * GRACE_FACTOR * (limit or SHORT_SECONDS)
            left = f" {where}, {'' if limit else UNKNOWN}at most about {duration(most)}"
        joints = f"{plural(every, 'joint')} of {plural(units, 'unit')}"
        self.tell(f"{joints}: {before} done{failures}, {every - before} to do{left}")
        try:
            while len(self.outcomes) < every:
                with closing(engine(self._todo())) as results:
                    for done in results:
                        outcome = self.outcomes[done.job.key] = self.store.put(done)
                        self.claims.pop(done.job.key).close()
                        self._count(outcome, before, processes)
                if len(self.outcomes) < every:  # another process has them in hand
                    time.sleep(POLL_SECONDS)
        finally:
            for claim in self.claims.values():
                claim.close()

    def _todo(self) -> Iterator[Job]:
        """Jobs that nobody has done or in hand."""
        for key, job in self.jobs.items():
            if key in self.outcomes or key in self.claims:
                continue
            claim = ExitStack()
            ours = claim.enter_context(self.store.claimed(key))
            known = self.store.get(key)
            if ours and known is None:
                self.claims[key] = claim
                yield job
                continue
            claim.close()
            if known is not None:
                self.outcomes[key] = known

    def _count(self, outcome: Outcome, before: int, processes: int) -> None:
        done, every = len(self.outcomes), len(self.jobs)
        begun = done - before + min(len(self.claims), processes) / 2  # what is in hand: half done
        left = duration((time.monotonic() - self.begin) / begun * (every - before - begun))
        said = outcome.failure or outcome.sentence
        self.tell(f"{left} left; {outcome.unit} {outcome.joint}: {said}", done - 1, every)


def duration(seconds: float) -> str:
    """Return how long something takes, as a person reads it."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} s"
