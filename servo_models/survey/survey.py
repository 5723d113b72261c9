"""Survey a robot, a data set or a fleet: what ``servo-models survey`` does."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from servo_models.data.joints.drafts import as_file
from servo_models.data.parameters import write_parameters
from servo_models.errors import UserError
from servo_models.files import write_with
from servo_models.report.numbers import plural
from servo_models.survey.engine import Done, here, on_cluster
from servo_models.survey.job import Job, Outcome, failed
from servo_models.survey.plan import Planned, plan
from servo_models.survey.result import Survey
from servo_models.survey.store import Store, key_of, read_outcomes

__all__ = ["Survey", "survey"]

Tell = Callable[[int, int | None, str], None]
"""Is told how many jobs were done before this one, how many there are, and what came of it; at
first, without these numbers, what there is to do."""
COMMON = "common"  # folder of a survey with parameter files
FIRST_GUESS_SECONDS = 8.0  # that a job takes, before any is done
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
    tell: Tell | None = None,
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
        trust: run Python files that descriptions name wherever they lie.
        tell: is told what goes on.

    Raises:
        UserError: nothing to diagnose, a folder that cannot be written, no scheduler; a job that
            fails is a row of the result.

    Example:
        >>> import servo_models as sm
        >>> fleet = sm.survey(".", out="found", jobs=2)
        >>> fleet.table().filter(verdict="effect")["causes"].to_list()
        ['drive_dead_zone']
    """
    root = Path(path)
    folder = Path(out) if out else root.parent / f"{root.stem or root.resolve().name}_survey"
    if jobs is not None and jobs < 1:
        raise UserError(f"jobs {jobs}: give a number of processes, 1 or more")
    earlier = read_outcomes(Path(before)) if before else ()
    store = Store(folder)
    planned = plan(root, folder, actuator, trust)
    options = {"seed": seed, "quick": quick, "time_limit": time_limit}
    work = _Work(store, planned.jobs, options, trust, reports, tell or (lambda *_: None))
    processes = jobs or os.cpu_count() or 1
    outcomes = work.done_by(
        lambda todo: on_cluster(todo, scheduler) if scheduler else here(todo, processes),
        "on the cluster" if scheduler else f"on {plural(processes, 'processor')}",
        1 if scheduler else processes,
    )
    found = Survey(root.resolve().name, outcomes, planned.notes, earlier, folder)
    for name, table in (("table", found.table()), ("estimates", found.estimates())):
        write_with(folder / f"{name}.csv", table.write_csv)
        write_with(folder / f"{name}.parquet", table.write_parquet)
    for joint in dict.fromkeys(joint for _, joint in found.by_place):
        _write_common(found, joint, folder / COMMON / f"{as_file(joint)}.toml")
    return found


def _write_common(found: Survey, joint: str, path: Path) -> None:
    """Write what all units of a joint have in common, if there are several, and it is known."""
    if sum(place[1] == joint for place in found.by_place) > 1:
        try:
            common = found.common(joint)
        except UserError:
            return
        write_parameters(common, path)


class _Work:
    """The jobs of a survey, and what has come of them so far."""

    def __init__(
        self,
        store: Store,
        planned: tuple[Planned, ...],
        options: Mapping[str, Any],
        trust: bool,
        reports: bool,
        tell: Tell,
    ) -> None:
        self.store, self.tell = store, tell
        self.jobs: dict[str, Job] = {}
        self.outcomes: dict[str, Outcome] = {}
        self.claims: dict[str, ExitStack] = {}
        self.begin = time.monotonic()
        for one in planned:
            key = key_of(one, options)
            where, conditions = one.description, one.conditions
            job = Job(key, one.unit, one.joint, where, conditions, options, trust, reports)
            self.jobs[key] = job
            known = store.get(key)
            if one.failure and known is None:
                known = store.put(failed(job, one.failure, 0.0), b"")
            if known is not None:
                self.outcomes[key] = known

    def done_by(
        self,
        engine: Callable[[Iterator[Job]], Generator[Done, None, None]],
        where: str,
        processes: int,
    ) -> tuple[Outcome, ...]:
        """Do what is not done, and return what came of every job, in their order."""
        before, every = len(self.outcomes), len(self.jobs)
        units = len({job.unit for job in self.jobs.values()})
        about = f"{plural(every, 'joint')} of {plural(units, 'unit')}: {before} done"
        seconds = [outcome.seconds for outcome in self.outcomes.values() if not outcome.failure]
        each = sum(seconds) / len(seconds) if seconds else FIRST_GUESS_SECONDS
        left = _duration(each * (every - before) / processes)
        self.tell(0, None, f"{about}, {every - before} to do, about {left} {where}")
        with ExitStack() as claims:
            while len(self.outcomes) < every:
                with closing(engine(self._todo(claims))) as results:
                    for job, outcome, page in results:
                        self.outcomes[job.key] = self.store.put(outcome, page)
                        self.claims.pop(job.key).close()
                        self._count(job, outcome, before)
                self._look()
        return tuple(self.outcomes[key] for key in self.jobs)

    def _todo(self, claims: ExitStack) -> Iterator[Job]:
        """Jobs that nobody has done or in hand."""
        for key, job in self.jobs.items():
            if key in self.outcomes or key in self.claims:
                continue
            claim = claims.enter_context(ExitStack())
            if claim.enter_context(self.store.claimed(key)) and self.store.get(key) is None:
                self.claims[key] = claim
                yield job
            else:
                claim.close()

    def _count(self, job: Job, outcome: Outcome, before: int) -> None:
        done, every = len(self.outcomes), len(self.jobs)
        each = (time.monotonic() - self.begin) / (done - before)
        said = outcome.failure or outcome.sentence
        left = _duration(each * (every - done))
        self.tell(done - 1, every, f"{left} left; {job.unit} {job.joint}: {said}")

    def _look(self) -> None:
        """Take over what other processes have done meanwhile."""
        for key in self.jobs.keys() - self.outcomes.keys():
            known = self.store.get(key)
            if known is not None:
                self.outcomes[key] = known
        if len(self.outcomes) < len(self.jobs):
            time.sleep(POLL_SECONDS)


def _duration(seconds: float) -> str:
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.0f} s"
