"""A Python function that runs in a process of its own: a crash or a hang ends one call.

The next call starts the process anew.  It guards against faults, not against malice: the code runs
with the rights of whoever runs it.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from typing import Any, BinaryIO, Generic, TypeVar

from servo_models.core.workers import python
from servo_models.errors import UserError

SERVE = "from servo_models.foreign.child import serve; serve()"
SECONDS = 60.0  # s that one run may take
GRACE = 5.0  # s that a process may take to end
T = TypeVar("T")


class Pool(Generic[T]):
    """As many of a thing as calls go on together; each call has one to itself.

    ``known`` are there already; ``make`` gives another one.
    """

    def __init__(self, make: Callable[[], T], *known: T) -> None:
        self._make, self._idle = make, [*known]

    @contextmanager
    def one(self) -> Iterator[T]:
        """One that nobody else has until the end of ``with``."""
        try:
            lent = self._idle.pop()
        except IndexError:
            lent = self._make()
        try:
            yield lent
        finally:
            self._idle.append(lent)


class Child:
    """A function, called in another process, one call at a time.

    Args:
        make: of a module that can be imported; called there with ``arguments``, it gives the
            function.
        seconds: that one call may take.
        what: names the function in errors.
        cure: what is to be done where that is not enough.
    """

    def __init__(
        self,
        make: Callable[..., Any],
        arguments: tuple[Any, ...],
        seconds: float,
        what: str,
        cure: str = "make a run shorter",
    ) -> None:
        self.begin, self.seconds, self.what, self.cure = (make, arguments), seconds, what, cure
        self._process: subprocess.Popen[bytes] | None = None

    def __call__(self, *given: Any) -> Any:
        """Return what the function returns.

        Raises:
            UserError: it raised, ended its process or took too long.
        """
        process = self._running()
        late = threading.Event()
        timer = threading.Timer(self.seconds, _end, (late, process))
        timer.start()
        try:
            pickle.dump(given, process.stdin)
            process.stdin.flush()
            raised, answer = pickle.load(process.stdout)  # from a process that we started
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            code = process.wait(GRACE)
            self._process = None
            if late.is_set():
                why = f"does not answer within {self.seconds:g} s: {self.cure}"
            else:
                why = f"ended its process (exit code {code})"
            raise UserError(f"{self.what} {why}") from error
        except BaseException:  # Ctrl-C: what it answers later is no answer to the next call
            self.close()
            self._process = None
            raise
        finally:
            timer.cancel()
        if raised:
            raise UserError(f"{self.what} fails: {answer}")
        return answer

    def close(self) -> None:
        """End the process, also in the middle of a call."""
        if self._process is not None:
            self._process.kill()

    def _running(self) -> Any:
        if self._process is None:
            process: Any = subprocess.Popen(
                python(SERVE), stdin=subprocess.PIPE, stdout=subprocess.PIPE
            )
            weakref.finalize(self, process.kill)
            pickle.dump(self.begin, process.stdin)
            self._process = process
        return self._process


def _end(late: threading.Event, process: subprocess.Popen[bytes]) -> None:
    late.set()
    process.kill()


def _listen(calls: BinaryIO, waiting: SimpleQueue[tuple[Any, ...]]) -> None:
    """Take calls until who started this process is gone, and then end it, also in mid-work."""
    try:
        while True:
            waiting.put(pickle.load(calls))
    finally:
        os._exit(1)


def serve() -> None:
    """Answer calls until standard input ends; what the function prints is not shown."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started this process
    calls, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    for number in (0, 1):
        os.dup2(os.open(os.devnull, os.O_RDWR), number)
    make, arguments = pickle.load(calls)  # from the process that started this one
    function: Any = None
    waiting: SimpleQueue[tuple[Any, ...]] = SimpleQueue()
    threading.Thread(target=_listen, args=(calls, waiting), daemon=True).start()
    while True:
        given = waiting.get()
        try:
            function = function or make(*arguments)
            answer = (False, function(*given))
        except Exception as error:  # whatever a person's file may raise
            answer = (True, f"{type(error).__name__}: {error}")
        pickle.dump(answer, answers)
        answers.flush()
