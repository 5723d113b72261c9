"""Where jobs are done: in processes of this machine, or by the workers of a Dask cluster.

Either way a job runs in a process of its own: one that crashes or hangs ends alone.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from servo_models.data.readers.columns import extra
from servo_models.errors import UserError
from servo_models.files import scratch
from servo_models.foreign.child import Child
from servo_models.survey.job import Job, Outcome, failed, run
from servo_models.survey.store import digest, files_of

GRACE_FACTOR, GRACE_SECONDS = 3.0, 600.0  # past the time limit of a job, until its process is ended
NO_LIMIT_SECONDS = 24.0 * 3600.0
POLL_SECONDS = 0.1  # between looks at whether a thread has ended
CONNECT_SECONDS = 10.0  # in which a scheduler has to answer
IN_FLIGHT_PER_THREAD = 4  # jobs that a cluster is given at a time


class Done(NamedTuple):
    """A job with what is kept of it and its page."""

    job: Job
    outcome: Outcome
    page: bytes


def seconds_allowed(job: Job) -> float:
    """Time after which the process of a job is ended: beyond the limit that its search keeps."""
    limit = job.options.get("time_limit")
    return NO_LIMIT_SECONDS if limit is None else GRACE_FACTOR * limit + GRACE_SECONDS


class Worker:
    """A process that does jobs, one after another."""

    def __init__(self) -> None:
        self._child: Child | None = None

    def __call__(self, job: Job) -> Done:
        seconds = seconds_allowed(job)
        if self._child is None or self._child.seconds != seconds:
            self._child = Child(
                _running, (), seconds, "the diagnosis", "give it another --time-limit"
            )
        try:
            encoded, page = self._child(job)
        except UserError as error:
            return Done(job, failed(job, str(error), 0.0), b"")
        return Done(job, msgspec.json.decode(encoded, type=Outcome), page)

    def close(self) -> None:
        """End the process, also in the middle of a job."""
        if self._child is not None:
            self._child.close()


def _running() -> Callable[[Job], tuple[bytes, bytes]]:
    return _encoded


def _encoded(job: Job) -> tuple[bytes, bytes]:
    outcome, page = run(job)
    return msgspec.json.encode(outcome), page


def here(jobs: Iterator[Job], processes: int) -> Generator[Done, None, None]:
    """Yield jobs as they are done by processes of this machine; a job is taken when one is free."""
    done: queue.SimpleQueue[Done | BaseException | None] = queue.SimpleQueue()
    taking, ended = threading.Lock(), threading.Event()
    workers = [Worker() for _ in range(processes)]

    def work(worker: Worker) -> None:
        try:
            while True:
                with taking:
                    job = None if ended.is_set() else next(jobs, None)
                if job is None:
                    break
                done.put(worker(job))
        except BaseException as error:
            done.put(error)
        done.put(None)

    threads = [threading.Thread(target=work, args=(it,), daemon=True) for it in workers]
    for thread in threads:
        thread.start()
    try:
        running = processes
        while running:
            one = done.get()
            if isinstance(one, BaseException):
                raise one
            if one is None:
                running -= 1
            else:
                yield one
    finally:
        ended.set()
        for thread, worker in zip(threads, workers):
            while thread.is_alive():
                worker.close()  # which ends the job in hand, if it has begun, and then the thread
                thread.join(POLL_SECONDS)


def on_cluster(jobs: Iterator[Job], address: str) -> Generator[Done, None, None]:
    """Yield jobs as they are done by a Dask cluster, whose workers read the data if they have the
    same files, and else are sent them.

    Raises:
        UserError: no scheduler there, or it is gone; what was done until then was yielded.
    """
    distributed = extra("cluster", "distributed")
    try:
        client = distributed.Client(address, timeout=CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        raise UserError(
            f"no scheduler of Dask at '{address}' ({error}): start one there"
        ) from error
    with closing(client):
        try:
            yield from _gathered(client, jobs, distributed.as_completed)
        except (OSError, distributed.CancelledError, distributed.core.CommClosedError) as error:
            raise UserError(
                f"the scheduler at '{address}' is gone: what was done is kept; start the survey"
                " again when there is one"
            ) from error


def _gathered(client: Any, jobs: Iterator[Job], as_completed: Any) -> Iterator[Done]:
    most = IN_FLIGHT_PER_THREAD * max(1, sum(client.nthreads().values()))
    sent: dict[str, Job] = {}
    pending = as_completed()

    def submit(job: Job, files: Sequence[tuple[str, bytes]] = ()) -> None:
        sent[job.key] = job
        told = (job, {path: digest(Path(path)) for path in map(str, files_of(job.description))})
        key = f"{job.key}-{'sent' if files else 'read'}"
        pending.add(client.submit(_far, *told, files, key=key, pure=False))

    for job in jobs:
        submit(job)
        if len(sent) >= most:
            break
    for future in pending:
        key, encoded, page = future.result()
        job = sent.pop(key)
        if encoded is None:
            submit(job, _content(job))
            continue
        yield Done(job, msgspec.json.decode(encoded, type=Outcome), page)
        following = next(jobs, None)
        if following is not None:
            submit(following)


def _content(job: Job) -> list[tuple[str, bytes]]:
    """The files of a job, as they lie beside each other; the description is the first."""
    files = [path.resolve() for path in files_of(job.description)]
    root = os.path.commonpath([path.parent for path in files])
    return [(os.path.relpath(path, root), path.read_bytes()) for path in files]


_far_workers = threading.local()


def _far(
    job: Job, digests: dict[str, str], files: Sequence[tuple[str, bytes]]
) -> tuple[str, bytes | None, bytes]:
    """Do a job where a worker of Dask is; None for a result asks for the files."""
    if not hasattr(_far_workers, "one"):
        _far_workers.one = Worker()
    if not files:
        if any(digest(Path(path)) != known for path, known in digests.items()):
            return job.key, None, b""
        return _told(_far_workers.one(job))
    with scratch() as folder:
        for name, content in files:
            path = Path(folder, name)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        done = _far_workers.one(replace(job, description=Path(folder, files[0][0])))
        return _told(done._replace(job=job))


def _told(done: Done) -> tuple[str, bytes, bytes]:
    return done.job.key, msgspec.json.encode(done.outcome), done.page
