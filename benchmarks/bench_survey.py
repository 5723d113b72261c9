"""Jobs a minute of a survey, memory, and what its engine adds to a job.

Run: ``python -m benchmarks.bench_survey`` (five minutes, POSIX; needs ``servo-models[cluster]``).
"""

from __future__ import annotations

import resource
import shutil
import sys
import time
from pathlib import Path

from servo_models import survey
from servo_models.files import scratch

GIMBAL = Path(__file__).parents[1] / "examples" / "gimbal"
BROKEN = 'actuator = "dc_motor"\n[[logs]]\nfile = "gone.csv"\n'
"""Fails at once: what such a job takes is what the engine takes."""
JOBS, BROKEN_JOBS = 16, 400
JOB_SECONDS = 5.0  # of the job to which the engine is compared


def main() -> None:
    """Print a row for each engine."""
    with scratch() as folder:
        fleet, broken = Path(folder, "fleet"), Path(folder, "broken")
        for k in range(JOBS):
            shutil.copytree(GIMBAL, fleet / f"unit_{k}", ignore=shutil.ignore_patterns("*.ipynb"))
        for k in range(BROKEN_JOBS):
            unit = broken / f"unit_{k}"
            unit.mkdir(parents=True)
            (unit / "joint.toml").write_text(BROKEN)
        survey(fleet, Path(folder, "warm"), jobs=1, quick=True, reports=False)
        for jobs in (1, 2):
            _row(f"processes {jobs}", fleet, Path(folder, f"out_{jobs}"), jobs=jobs)
        _row("without pages", fleet, Path(folder, "bare"), jobs=2, reports=False)
        try:
            from distributed import LocalCluster
        except ImportError:
            print("2 Dask workers: pip install 'servo-models[cluster]'")
        else:
            with LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
            ) as cluster:
                address = cluster.scheduler_address
                _row("Dask workers 2", fleet, Path(folder, "far"), scheduler=address)
        begin = time.perf_counter()
        survey(broken, Path(folder, "none"), jobs=1)
        each = (time.perf_counter() - begin) / BROKEN_JOBS
    print(
        f"engine {1e3 * each:.0f} ms a job: {each / JOB_SECONDS:.1%} of one of {JOB_SECONDS:.0f} s"
    )


def _row(name: str, fleet: Path, out: Path, **options: object) -> None:
    begin = time.perf_counter()
    found = survey(fleet, out, **options)  # type: ignore[arg-type]
    spent = time.perf_counter() - begin
    busy = sum(outcome.seconds for outcome in found.outcomes)
    unit = 2**20 if sys.platform == "darwin" else 2**10
    largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / unit
    mine = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
    print(
        f"{name:16}{60.0 * JOBS / spent:7.1f} jobs a minute{busy / spent:6.2f} busy"
        f"{mine:6.0f} MB, a process {largest:.0f} MB",
        flush=True,
    )


if __name__ == "__main__":
    main()
