"""Jobs a minute of a survey, memory, and what its engine adds to a job.

Run: ``python -m benchmarks.bench_survey`` (five minutes; needs ``servo-models[cluster]``).

What the engine adds is the time in which no job runs, on one process, over the time in jobs: both
are of one run, so that other work on the machine lengthens both.  Beside it stand the processor
times of a job alone and of the process that keeps what is done.
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


def main() -> None:
    """Print a row for each engine."""
    with scratch() as folder:
        fleet = folder / "fleet"
        for k in range(JOBS):
            shutil.copytree(GIMBAL, fleet / f"unit_{k}", ignore=shutil.ignore_patterns("*.ipynb"))
        job = Job("", "unit_0", "gimbal", fleet / "unit_0" / "gimbal.toml")
        run(job)  # compiles
        begin = time.process_time()
        run(job)
        print(f"a job alone: {time.process_time() - begin:.1f} s of processor")
        for jobs in (1, 2):
            _row(f"processes {jobs}", fleet, folder / f"out_{jobs}", jobs=jobs)
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster:
            address = cluster.scheduler_address
            _row("Dask workers 2", fleet, folder / "far", scheduler=address)


def _row(name: str, fleet: Path, out: Path, **options: object) -> None:
    me, largest = psutil.Process(), 0

    def look(*_: object) -> None:
        nonlocal largest
        sizes = [it.memory_info().rss for it in me.children(recursive=True)]
        largest = max(largest, *sizes, 0)

    begin, processor = time.perf_counter(), time.process_time()
    found = survey(fleet, out, tell=look, **options)  # type: ignore[arg-type]
    spent, processor = time.perf_counter() - begin, time.process_time() - processor
    busy = sum(outcome.seconds for outcome in found.outcomes)
    print(
        f"{name:15}{60.0 * JOBS / spent:6.1f} jobs a minute, {busy / spent:.3f} at work;"
        f" engine {processor / JOBS:.2f} s of processor a job,"
        f" {me.memory_info().rss / 2**20:.0f} MB; largest worker {largest / 2**20:.0f} MB",
        flush=True,
    )


if __name__ == "__main__":
    main()
