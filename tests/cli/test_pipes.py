"""A reader that has seen enough, and a child that is gone, are two things."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from servo_models.cli import main
from servo_models.errors import UserError
from servo_models.fmu.child import Child

PRINTS_FOR_EVER = """
import sys
from servo_models import cli
cli.app.command(name="print")(lambda: [print("a line") for _ in iter(int, 1)])
sys.exit(cli.main(["print"]))
"""


WORKS_FOR_EVER = """
import time
from functools import partial
from threading import Thread
from servo_models.fmu.child import Child
child = Child(partial, (time.sleep, 600.0), 600.0, "the call")
Thread(target=child).start()
while child._process is None:
    time.sleep(0.01)
print("it works", flush=True)
"""


def test_a_command_ends_without_a_word_when_its_reader_has_seen_enough() -> None:
    words = [sys.executable, "-c", PRINTS_FOR_EVER]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == b"a line\n"
        process.stdout.close()
        assert process.wait(30) == 128 + signal.SIGPIPE
        assert process.stderr.read() == b""


def _answers() -> object:
    return abs


def test_a_child_that_is_gone_does_not_end_a_command(capsys: pytest.CaptureFixture[str]) -> None:
    main(["list"])
    child = Child(_answers, (), 30.0, "the child")
    assert child(-1) == 1
    assert child._process is not None
    child._process.kill()
    child._process.wait(30)
    with pytest.raises(UserError, match=r"ends the process by signal 9 \(Killed\)"):
        child(-1)
    assert child(-2) == 2


def test_a_child_in_the_middle_of_its_work_ends_with_who_started_it() -> None:
    words = [sys.executable, "-c", WORKS_FOR_EVER]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"it works\n"
        time.sleep(2.0)
        process.kill()
        process.communicate(timeout=10.0)  # which waits for the child, whose stderr it is too
