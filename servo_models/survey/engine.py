"""Where jobs are done: in processes of this machine, or by the workers of a Dask cluster.

Either way a job runs in a process of its own: one that crashes or hangs ends alone.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from servo_models.errors import UserError, extra
from servo_models.files import scratch
from servo_models.fmu.child import Child
from servo_models.survey.job import Done, Job, failed, run
from servo_models.survey.store import digest, files_of

GRACE_FACTOR, GRACE_SECONDS = 3.0, 600.0  # past the time limit of a job, until its process is ended
NO_LIMIT_SECONDS = 24.0 * 3600.0
POLL_SECONDS = 0.1  # between attempts to end jobs in hand
CONNECT_SECONDS = 10.0  # in which a scheduler has to answer
IN_FLIGHT_PER_THREAD = 4  # jobs that a cluster is given at a time


class Worker:
    """A process that does jobs, one after another.

    Args:
        limit: time of the search for a diagnosis [s]; some time after it the process is ended.
        failed: makes the result of a job that ended its process, with the reason.
        make, arguments: as of ``Child``.
    """

    def __init__(
        self,
        limit: float | None,
        failed: Callable[[Any, str], Any],
        make: Callable[..., Any],
        *arguments: Any,
    ) -> None:
        seconds = NO_LIMIT_SECONDS if limit is None else GRACE_FACTOR * limit + GRACE_SECONDS
        cure = "give it another --time-limit"
        self._child = Child(make, arguments, seconds, "the diagnosis", cure)
        self._failed = failed

    def __call__(self, job: Any) -> Any:
        try:
            return self._child(job)
        except UserError as error:
            return self._failed(job, str(error))

    def close(self) -> None:
        """End the process, also in the middle of a job."""
        self._child.close()


def processes(jobs: int | None) -> int:
    """Return how many jobs are done at once, by default one a processor."""
    if jobs is not None and jobs < 1:
        raise UserError(f"jobs {jobs}: give a number of processes, 1 or more")
    return jobs or os.cpu_count() or 1


def here(jobs: Iterator[Any], workers: Sequence[Worker]) -> Generator[Any, None, None]:
    """Yield jobs as they are done by processes of this machine; a job is taken when one is free."""
    free: SimpleQueue[Worker] = SimpleQueue()
    for worker in workers:
        free.put(worker)

    def do(job: Any) -> Any:
        worker = free.get()
        try:
            return worker(job)
        finally:
            free.put(worker)

    def stop() -> None:
        for worker in workers:
            worker.close()

    yield from _each(jobs, len(workers), do, stop)


def on_cluster(jobs: Iterator[Job], address: str) -> Generator[Done, None, None]:
    """Yield jobs as they are done by a Dask cluster, whose workers read the data if they have the
    same files, and else are sent them.

    Raises:
        UserError: no scheduler there, or it is gone; what was done until then was yielded.
    """
    distributed = extra("cluster", "distributed")
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what is gone we tell
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise UserError(
            f"no scheduler of Dask at '{address}' ({error}): start one there"
        ) from error

    def do(job: Job) -> Done:
        digests = {str(path): digest(path) for path in files_of(job.description)}
        done: Done | None = client.submit(_read_there, job, digests, pure=False).result()
        if done is None:
            done = client.submit(_sent_there, job, _content(job), pure=False).result()
        return done

    with closing(client):
        try:
            most = IN_FLIGHT_PER_THREAD * max(1, sum(client.nthreads().values()))
            yield from _each(jobs, most, do, client.close)
        except (OSError, distributed.CancelledError) as error:
            raise UserError(
                f"the scheduler at '{address}' is gone: what was done is kept; start the survey"
                " again when there is one"
            ) from error


def _each(
    jobs: Iterator[Any], most: int, do: Callable[[Any], Any], stop: Callable[[], None]
) -> Iterator[Any]:
    """Yield what ``do`` makes of jobs, as it comes, with ``most`` in hand; ``stop`` ends these."""
    with ThreadPoolExecutor(most) as threads:
        pending = {threads.submit(do, job) for job in islice(jobs, most)}
        try:
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                pending |= {threads.submit(do, job) for job in islice(jobs, len(done))}
                for future in done:
                    yield future.result()
        finally:
            stop()
            while wait(pending, POLL_SECONDS).not_done:
                stop()  # what has begun meanwhile


def _content(job: Job) -> list[tuple[str, bytes]]:
    """The files of a job, as they lie beside each other; the description is the first."""
    files = [path.resolve() for path in files_of(job.description)]
    root = os.path.commonpath([path.parent for path in files])
    return [(os.path.relpath(path, root), path.read_bytes()) for path in files]


_there = threading.local()  # with the process of a thread of a Dask worker


def _done_there(job: Job) -> Done:
    limit = job.options.get("time_limit")
    if getattr(_there, "limit", "of no job yet") != limit:
        _there.limit, _there.worker = limit, Worker(limit, failed, partial, run)
    done: Done = _there.worker(job)
    return done


def _read_there(job: Job, digests: dict[str, str]) -> Done | None:
    """Do a job on a cluster, None where its files are other ones there."""
    if any(digest(Path(path)) != known for path, known in digests.items()):
        return None
    return _done_there(job)


def _sent_there(job: Job, files: Sequence[tuple[str, bytes]]) -> Done:
    """Do a job on a cluster with the files that it is sent."""
    with scratch() as folder:
        for name, content in files:
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return _done_there(replace(job, description=Path(folder, files[0][0])))._replace(job=job)
