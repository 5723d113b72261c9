"""Jobs a minute of a survey, memory, and what its engine adds to a job.

Run: ``python -m benchmarks.bench_survey`` (five minutes; needs ``servo-models[cluster]``).

What the engine adds is the time of one process in which no job runs, over the time in jobs: both
are of one run, so that other work on the machine lengthens both.  Times the processor time of a job
alone, it is what the engine costs.
"""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import psutil
from distributed import LocalCluster

from servo_models import survey
from servo_models.files import scratch
from servo_models.survey.job import Job, run

GIMBAL = Path(__file__).parents[1] / "examples" / "gimbal"
JOBS = 12
JOB_SECONDS = 5.0  # of the job to which the engine is compared


def main() -> None:
    """Print a row for each engine."""
    with scratch() as folder:
        fleet = folder / "fleet"
        for k in range(JOBS):
            shutil.copytree(GIMBAL, fleet / f"unit_{k}", ignore=shutil.ignore_patterns("*.ipynb"))
        job = Job("unit_0", "gimbal", fleet / "unit_0" / "gimbal.toml")
        run(job)  # compiles
        begin = time.process_time()
        run(job)
        alone = time.process_time() - begin
        added = alone * (1.0 / _row("processes 1", fleet, folder / "one", jobs=1) - 1.0)
        _row("processes 2", fleet, folder / "two", jobs=2)
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster:
            address = cluster.scheduler_address
            _row("Dask workers 2", fleet, folder / "far", scheduler=address)
    print(
        f"a job alone: {alone:.1f} s of processor; the engine adds {added:.2f} s,"
        f" {added / JOB_SECONDS:.1%} of a job of {JOB_SECONDS:.0f} s"
    )


def _row(name: str, fleet: Path, out: Path, **options: object) -> float:
    """Print it, and return the time in jobs over the time that the survey took."""
    me, largest = psutil.Process(), 0

    def look(*_: object) -> None:
        nonlocal largest
        sizes = [it.memory_info().rss for it in me.children(recursive=True)]
        largest = max(largest, *sizes, 0)

    begin, processor = time.perf_counter(), time.process_time()
    found = survey(fleet, out, tell=look, trust=True, **options)  # type: ignore[arg-type]
    spent, processor = time.perf_counter() - begin, time.process_time() - processor
    busy = sum(outcome.seconds for outcome in found.outcomes)
    mine, processor = me.memory_info().rss, processor / JOBS
    print(
        f"{name:14}{60.0 * JOBS / spent:6.1f} jobs a minute{busy / spent:6.3f} at work, engine"
        f" {processor:.2f} s a job, {mine / 2**20:.0f} MB, a worker {largest / 2**20:.0f} MB",
        flush=True,
    )
    return busy / spent


if __name__ == "__main__":
    main()

# Result: two cores, quiet, CPython 3.11.  The scheduler of Dask runs in the first process.
#
# processes 1     26.8 jobs a minute 0.950 at work, engine 0.01 s a job, 278 MB, a worker 250 MB
# processes 2     43.2 jobs a minute 1.755 at work, engine 0.01 s a job, 279 MB, a worker 247 MB
# Dask workers 2  46.5 jobs a minute 1.765 at work, engine 0.07 s a job, 281 MB, a worker 245 MB
# a job alone: 2.0 s of processor; the engine adds 0.10 s, 2.1% of a job of 5 s
