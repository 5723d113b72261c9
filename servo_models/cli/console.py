"""Output to the terminal: reports to stdout, progress to stderr."""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from servo_models.core.stop import Tell, silent
from servo_models.report.result import Report
from servo_models.report.terminal import text

NARROW = 80  # columns of text for people, in a pipe too
ONE_LINE = 2000  # characters of a line; no table row is longer, so that grep finds the whole row
RUNNER_COMMAND = re.compile(r"(?:^|[\r\n])\s*:(?=:)|##\w*(?=\[)")
"""Commands to a CI runner, up to the last sign that it needs: ``::error::`` at the start of a line,
``##[error]``, ``##vso[...]`` and ``##teamcity[...]`` anywhere."""


@contextmanager
def disarmed() -> Iterator[None]:
    """Let no printed name command a CI runner: ``::error::x`` is printed as ``:\\:error::x``.

    Names may come from foreign files, and a report may break its lines anywhere, so this looks at
    all that is written to stdout and stderr.
    """
    streams = [it for it in {sys.stdout, sys.stderr} if isinstance(it, io.TextIOBase)]
    for stream in streams:
        stream.write = _Disarming(stream)  # type: ignore[method-assign]
    try:
        yield
    finally:
        for stream in streams:
            del stream.write


class _Disarming:
    """Write to a stream; ``line`` is its last line so far, since a name may come in pieces."""

    def __init__(self, stream: io.TextIOBase) -> None:
        self.stream, self.line = stream, ""

    def __call__(self, said: str) -> int:
        shown = RUNNER_COMMAND.sub(r"\g<0>\\", self.line + said)
        _as_it_is(self.stream, shown[len(self.line) :])
        self.line = re.split(r"[\r\n]", shown)[-1]
        return len(said)


def print_commands(lines: Iterable[str]) -> None:
    """Print lines that a CI runner is to obey."""
    _as_it_is(sys.stdout, "".join(f"{line}\n" for line in lines))


def _as_it_is(stream: Any, said: str) -> None:
    type(stream).write(stream, said)  # the method of its class, behind ``disarmed``


def show(report: Report, width: int = ONE_LINE) -> None:
    """Print a report: for the width and colours of a terminal, else in lines of ``width``, which
    by default is a line for each row."""
    if sys.stdout.isatty():
        from rich.console import Console

        Console().print(report)
    else:
        print(text(report, width))


@contextmanager
def progress(label: str, lines: bool = False) -> Iterator[Tell]:
    """Show a bar on stderr while the block runs; in a pipe ``lines``, one a job, or nothing.

    ``SERVO_MODELS_PROGRESS=lines`` asks every command for lines, as ``explore --serve`` does.
    """
    if not sys.stderr.isatty():
        lines = lines or os.environ.get("SERVO_MODELS_PROGRESS") == "lines"
        yield _print_job if lines else silent
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda doing, done=0, total=None: bar.update(
            task, completed=done, total=total, description=doing
        )


def _print_job(doing: str, done: int = 0, total: int | None = None) -> None:
    if doing:
        line = f"{done + 1} of {total}: {doing}"[:ONE_LINE] if total else doing
        print(line, file=sys.stderr, flush=True)
