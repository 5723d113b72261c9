"""The process in which an FMU runs: ``bare_host`` behind a pipe, within limits of time.

It guards against faults, not against malice: the code of an FMU runs with the rights of whoever
runs it.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import secrets
import signal
import subprocess
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from servo_models.validation import bare_host


@dataclass(frozen=True)
class Limits:
    """Limits of time and size for one FMU.

    Attributes:
        seconds: for one comparison, wall-clock time.
        megabytes: of address space; not kept on Windows and macOS.
        unpacked_megabytes: of all its files.
    """

    seconds: float = 120.0
    megabytes: float = 1024.0
    unpacked_megabytes: float = 256.0


LIMITS = Limits()  # ours take a tenth of each

LARGEST_ANSWER = 1 << 28  # characters of an answer at most; a row of ten outputs has 200
PASSED_ON = ("PATH", "LANG", "LC_ALL", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
"""Environment variables that the process gets."""
TEMPORARY = ("HOME", "TMPDIR", "TEMP", "TMP")  # variables that name its working folder
GRACE = 5.0  # seconds in which a process has to end after it closed its pipe


class RefusedError(Exception):
    """The FMU refused a call, with its reason."""


class DeadHostError(Exception):
    """The process is gone; the text says how, and is true from now on."""


class HostProcess:
    """A running ``bare_host`` for one unpacked FMU; its methods are called by name."""

    def __init__(self, folder: Path, limits: Limits) -> None:
        """Start the process in ``folder``."""
        self.seconds = limits.seconds
        self.died = ""
        self.exchange: threading.Thread | None = None
        environment = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
        environment |= dict.fromkeys(TEMPORARY, str(folder))
        self.process = subprocess.Popen(
            [sys.executable, "-I", "-S", bare_host.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            encoding="utf-8",
            errors="replace",
            cwd=folder,
            env=environment,
            start_new_session=True,
        )

    def call(self, *request: Any) -> Any:
        """Return the result of a request, a method of ``bare_host.Session`` and its arguments.

        Raises:
            RefusedError: by the FMU.
            DeadHostError: the process ended, or did not answer in time and was ended.
        """
        if self.died:
            raise DeadHostError(self.died)
        number = secrets.token_hex(8)  # the slave may write to the pipe by chance
        line = self._exchanged(json.dumps([number, request]))
        try:
            content = json.loads(line)
            if content["number"] != number:
                raise ValueError(number)
            reason = content.get("refused")
            result = content["result"] if reason is None else None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            self._end("gives an answer that is none")
            raise DeadHostError(self.died) from error
        if reason is not None:
            raise RefusedError(str(reason))
        return result

    def close(self) -> None:
        """End the process and what it has started."""
        self._end("is closed")

    def _exchanged(self, request: str) -> str:
        """Send a line and return the next one; end the process if that takes too long."""
        answers: queue.SimpleQueue[str] = queue.SimpleQueue()

        def exchange() -> None:
            assert self.process.stdin is not None
            assert self.process.stdout is not None
            try:
                self.process.stdin.write(request + "\n")
                self.process.stdin.flush()
                answers.put(self.process.stdout.readline(LARGEST_ANSWER))
            except (OSError, ValueError):  # the other end of a pipe is gone
                answers.put("")

        # A daemon: what the slave has started may hold the pipe open for ever.
        self.exchange = threading.Thread(target=exchange, daemon=True)
        self.exchange.start()
        try:
            line = answers.get(timeout=self.seconds)
        except queue.Empty:
            self._end(f"does not answer within {self.seconds:g} s")
            raise DeadHostError(self.died) from None
        if not line:
            self._end(self._last_word())
            raise DeadHostError(self.died)
        return line

    def _last_word(self) -> str:
        """How a process with a closed pipe ended."""
        try:
            code = self.process.wait(GRACE)
        except subprocess.TimeoutExpired:
            return "closes the pipe to its host"
        if code >= 0:
            return f"ends the process with exit code {code}"
        return f"ends the process by signal {-code} ({signal.strsignal(-code)})"

    def _end(self, why: str) -> None:
        if self.died:
            return
        self.died = why
        if sys.platform == "win32":
            self.process.kill()
        else:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)  # with what it has started
        self.process.wait()
        if self.exchange:
            self.exchange.join(GRACE)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe and not (self.exchange and self.exchange.is_alive()):
                with contextlib.suppress(OSError):  # what was not sent yet goes nowhere
                    pipe.close()
