"""Long work: who is told what goes on, and when a search ends before it has tried everything."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from time import monotonic
from types import FrameType
from typing import Protocol

AT_FIRST_ANSWER = "at its first answer"
BY_CTRL_C = "by Ctrl-C"


class Tell(Protocol):
    """Is told what goes on and, of work in jobs, how many of them are done."""

    def __call__(self, text: str, done: int = 0, of: int | None = None, /) -> object: ...


def silent(text: str, done: int = 0, of: int | None = None, /) -> None:
    """Tell nobody what goes on."""


class StoppedError(Exception):
    """A search is to end: ``Stop.search`` catches it, and what was found so far counts."""


class Stop:
    """Says when a search is to end: after a time, at its first answer, or at Ctrl-C.

    Within ``with`` the first Ctrl-C asks for the end, and the second one raises
    ``KeyboardInterrupt``.  In a thread other than the main one, and where the program handles
    Ctrl-C itself, it means what it meant before.

    Attributes:
        seconds: time from now on [s] after which the search ends.
        quick: the first answer is enough.
        why: reason for the end of the search, in words, "" while it may go on.

    Example:
        >>> stop = Stop(0.0)
        >>> with stop.search():
        ...     stop.check()
        >>> stop.why
        'after 0 s'
    """

    def __init__(self, seconds: float = inf, quick: bool = False) -> None:
        self.seconds, self.quick, self.why = seconds, quick, ""
        self._begin, self._searching = monotonic(), False

    @property
    def elapsed(self) -> float:
        """Time [s] since the beginning."""
        return monotonic() - self._begin

    @property
    def passed(self) -> bool:
        """Whether the search has to end."""
        if not self.why and self.elapsed >= self.seconds:
            self.why = f"after {self.seconds:g} s"
        return bool(self.why)

    def check(self) -> None:
        """Raise ``StoppedError`` if a search is under way that has to end; any thread may ask."""
        if self._searching and self.passed:
            raise StoppedError

    @contextmanager
    def search(self) -> Iterator[None]:
        """Let ``check`` end what is within; a search may be part of another one."""
        before, self._searching = self._searching, True
        try:
            yield
        except StoppedError:
            pass
        finally:
            self._searching = before

    def __enter__(self) -> Stop:
        main = threading.current_thread() is threading.main_thread()
        if main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._interrupted)
        return self

    def __exit__(self, *_: object) -> None:
        if signal.getsignal(signal.SIGINT) == self._interrupted:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def _interrupted(self, number: int, frame: FrameType | None) -> None:
        self.why = self.why or BY_CTRL_C
        self.__exit__()
