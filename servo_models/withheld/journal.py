"""Work on many cases in processes of their own, kept line by line so that it can be resumed."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread
from typing import Any, TypeVar

from servo_models.errors import UserError

Task = TypeVar("Task")
Row = dict[str, Any]


def work_through(
    path: Path,
    tasks: Mapping[str, Task],
    do: Callable[[Task], Row],
    jobs: int,
    tell: Callable[[int, int], None],
) -> dict[str, Row]:
    """Return what ``do`` makes of every task, by case; what ``path`` holds is not done again.

    Args:
        path: a line of JSON for every case that is done.
        tasks: by case.
        do: from a task to a row with its ``"case"``, a function of a module.
        jobs: processes.
        tell: is told how many cases are done, and how many there are.

    Raises:
        UserError: a process ended before its work, or a task failed; all others are kept.
    """
    rows = _read(path)
    left = {case: task for case, task in tasks.items() if case not in rows}
    tell(len(rows), len(tasks))
    if not left:
        return rows
    failed: dict[str, Exception] = {}
    processes = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(jobs, len(left)), processes, initializer=_be_quiet)
    try:
        with path.open("a", encoding="utf-8") as file:
            begun = {pool.submit(do, task): case for case, task in left.items()}
            for future in as_completed(begun):
                try:
                    row = future.result()
                except BrokenProcessPool:
                    raise
                except Exception as error:  # the other cases go on
                    failed[begun[future]] = error
                    continue
                rows[row["case"]] = row
                file.write(json.dumps(row) + "\n")
                file.flush()
                tell(len(rows), len(tasks))
    except BrokenProcessPool as error:
        raise UserError(
            f"a process ended before its work after {len(rows)} cases: use fewer --jobs where"
            " memory is short, and the same --folder to go on"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)
    for case, reason in failed.items():
        raise UserError(
            f"{len(failed)} of {len(tasks)} cases failed, case '{case}' with"
            f" {type(reason).__name__}: {reason}; the others are in '{path}': mend that, and use"
            " the same --folder to go on"
        ) from reason
    return rows


def _be_quiet() -> None:
    """Ctrl-C is for the process that waits: the others finish their case and end.

    Where that process is killed they end at once, since nobody would keep what they find.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent
    wait([parent.sentinel])
    os._exit(1)


def _read(path: Path) -> dict[str, Row]:
    """Rows by case; a line that was being written when everything stopped is cut off."""
    if not path.exists():
        return {}
    text = path.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if whole != text:
        path.write_bytes(whole)
    rows = [json.loads(line) for line in whole.splitlines()]
    return {row["case"]: row for row in rows}
