"""What goes to the terminal: reports to stdout, progress to stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from servo_models.report.sections import Report
from servo_models.report.terminal import text

Progress = Callable[[int, int | None, str], None]
"""Called with steps done, steps in all where that is known, and what is being done."""

NARROW = 80
"""Columns of what is meant to be read, in a pipe too."""
ONE_LINE = 2000
"""Characters; no row of a table is longer, so a filter such as grep finds all of it."""


def show(report: Report, width: int = ONE_LINE) -> None:
    """Print a report: for the width and colours of a terminal, else in lines of ``width``, which
    by default is a line for each row."""
    if sys.stdout.isatty():
        from rich.console import Console

        Console().print(report)
    else:
        print(text(report, width))


@contextmanager
def progress(label: str, lines: bool = False) -> Iterator[Progress]:
    """Show a bar on stderr while the block runs; in a pipe ``lines``, one a job, or nothing."""
    if not sys.stderr.isatty():
        yield _print_job if lines else lambda done, total, doing: None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=None)
        yield lambda done, total, doing: bar.update(
            task, completed=done, total=total, description=doing
        )


def _print_job(done: int, total: int | None, doing: str) -> None:
    if doing:
        print(f"{done + 1} of {total}: {doing}"[:NARROW], file=sys.stderr, flush=True)
