"""A Python function that runs in a process of its own: a crash or a hang ends one call.

The next call starts the process anew.  It guards against faults, not against malice: the code runs
with the rights of whoever runs it.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import Any, BinaryIO, Generic, TypeVar

from servo_models.core.workers import python
from servo_models.errors import UserError

SERVE = "from servo_models.fmu.child import serve; serve()"
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


class ChildError(UserError):
    """A call that failed: ``why``, and whether its process has ``ended``."""

    def __init__(self, text: str, why: str, ended: bool) -> None:
        super().__init__(text)
        self.why, self.ended = why, ended


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
        self._exchange = threading.Thread()

    def __call__(self, *given: Any) -> Any:
        """Return what the function returns.

        Raises:
            ChildError: it raised, ended its process or took too long.
        """
        process, answers = self._running(), SimpleQueue[tuple[str, Any]]()
        words = (process, pickle.dumps(given), answers)
        # a daemon: what the function has started may hold the pipe open for ever
        self._exchange = threading.Thread(target=_exchanged, args=words, daemon=True)
        self._exchange.start()
        try:
            told, answer = answers.get(timeout=self.seconds)
        except Empty:
            cure = f": {self.cure}" if self.cure else ""
            told, answer = "late", f"does not answer within {self.seconds:g} s{cure}"
        except BaseException:  # Ctrl-C: what it answers later is no answer to the next call
            self.close()
            raise
        if told == "returned":
            return answer
        if told == "raised":
            raise ChildError(f"{self.what} fails: {answer}", answer, ended=False)
        self.close()
        raise ChildError(f"{self.what} {answer}", answer, ended=True)

    def close(self) -> None:
        """End the process and what it has started, also in the middle of a call."""
        process, self._process = self._process, None
        if process is None:
            return
        self._end()
        if self._exchange.ident:
            self._exchange.join(GRACE)
        if not self._exchange.is_alive():
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):  # what was not sent yet goes nowhere
                    pipe.close()  # type: ignore[union-attr]

    def _running(self) -> Any:
        if self._process is None:
            process: Any = subprocess.Popen(
                python(SERVE),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
            self._end = weakref.finalize(self, _ended, process)
            pickle.dump(self.begin, process.stdin)
            self._process = process
        return self._process


def _exchanged(process: Any, request: bytes, answers: SimpleQueue[tuple[str, Any]]) -> None:
    """Send a request, and put what came of it with a word for its kind."""
    try:
        process.stdin.write(request)
        process.stdin.flush()
        raised, answer = pickle.load(process.stdout)  # from a process that we started
        answers.put(("raised" if raised else "returned", answer))
    except (EOFError, OSError):
        answers.put(("gone", _last_word(process)))
    except Exception:  # it wrote into the pipe by chance
        answers.put(("unclear", "gives an answer that is none"))


def _last_word(process: subprocess.Popen[bytes]) -> str:
    """How a process with a closed pipe ended."""
    try:
        code = process.wait(GRACE)
    except subprocess.TimeoutExpired:
        return "closes the pipe to its host"
    if code >= 0:
        return f"ends the process with exit code {code}"
    return f"ends the process by signal {-code} ({signal.strsignal(-code)})"


def _ended(process: subprocess.Popen[bytes]) -> None:
    if sys.platform == "win32":
        process.kill()
    else:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)  # with what it has started
    process.wait()


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
        except UserError as error:
            answer = (True, str(error))
        except Exception as error:  # whatever a person's file may raise
            answer = (True, f"{type(error).__name__}: {error}")
        pickle.dump(answer, answers)
        answers.flush()
