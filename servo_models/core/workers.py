"""Threads on which simulations go on together, and how another process of Python is started."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack
from typing import TypeVar

from servo_models.errors import UserError

S = TypeVar("S")
T = TypeVar("T")

_thread = threading.local()


def python(code: str, *words: str) -> list[str]:
    """Return the command that runs Python text, with ``words``, on the path of this process.

    By itself Python looks in the current folder first, and would run what data have there.
    """
    safe = ["-P"] if sys.version_info >= (3, 11) else []  # 3.13 imports before it runs the text
    path = [str(folder) for folder in sys.path if folder]  # an empty one is the current folder
    return [sys.executable, *safe, "-c", f"import sys; sys.path[:] = {path!a}; {code}", *words]


class Workers:
    """So many threads, within ``with``; before and after it tasks are done one by one.

    Within it BLAS works in the thread that calls it: its own threads gain nothing on matrices of
    a few columns, and while they wait they take the processors from the simulations.

    Example:
        >>> with Workers(2) as workers:
        ...     list(workers.map(abs, [-1, 2]))
        [1, 2]
    """

    def __init__(self, count: int | None = None) -> None:
        """By default there are as many threads as processors.

        Raises:
            UserError: fewer than one.
        """
        self.count = os.cpu_count() or 1 if count is None else count
        if self.count < 1:
            raise UserError(f"jobs {count}: give a number of simulations at once, 1 or more")
        self._pool: ThreadPoolExecutor | None = None
        self._open = ExitStack()

    def __enter__(self) -> Workers:
        from threadpoolctl import threadpool_limits

        self._open.enter_context(threadpool_limits(1, "blas"))
        if self.count > 1:
            mark = (_thread, "is_worker", True)
            pool = ThreadPoolExecutor(self.count, initializer=setattr, initargs=mark)
            self._pool = self._open.enter_context(pool)
        return self

    def __exit__(self, *_: object) -> None:
        self._pool = None
        self._open.close()

    def map(self, function: Callable[[T], S], tasks: Iterable[T]) -> Iterator[S]:
        """Return ``map`` of a function over tasks, in order.

        A task does tasks of its own itself: all threads may be waiting for such ones.  Where one
        fails, those that were not begun are dropped, and those that were end first.
        """
        if self._pool is None or hasattr(_thread, "is_worker"):
            return map(function, tasks)
        return _results([self._pool.submit(function, task) for task in tasks])


def _results(begun: list[Future[S]]) -> Iterator[S]:
    begun.reverse()
    try:
        while begun:
            yield begun.pop().result()
    finally:
        for task in begun:
            task.cancel()
        wait(begun)


ALONE = Workers(1)  # no threads: tasks are done one by one
