"""A diagnosis that is stopped: by a time limit, at its first answer, or by Ctrl-C."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import count
from pathlib import Path
from threading import Event

import pytest

from servo_models.core.stop import AT_FIRST_ANSWER, Stop
from servo_models.core.workers import Workers
from servo_models.data.parameters import read_parameters
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.search.selection import STAGES, Selection, select_effects
from servo_models.errors import UserError
from servo_models.identification.simulation import InternalSteps
from tests.conftest import Run
from tests.support.delayed_motor import describe
from tests.support.diagnoses import made
from tests.support.schemas import check_schema

TWO_EFFECTS = {"coulomb_friction.level": 1.5e-3, "sensor_offset.value": 1e-4}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return describe(tmp_path_factory.mktemp("rig"), seconds=0.2)


def test_what_is_not_stopped_lacks_nothing(rig: Path) -> None:
    found = diagnose(rig, time_limit=1e6)
    assert (found.unfinished, found.stopped, found.selection.unfinished) == ((), "", [])
    assert not any("stopped" in text for text in summary.warnings(found))


def test_with_no_time_the_nominal_model_is_told(rig: Path) -> None:
    found = diagnose(rig, time_limit=1e-9)
    selection = found.selection
    assert set(STAGES).intersection(found.unfinished) == set(selection.unfinished)
    assert {"re-tuned parameters", "effects alone", "pairs of effects"} <= set(found.unfinished)
    assert selection.tried == []
    nominal = {name: found.model.values[name] for name in selection.taken.values}
    assert selection.taken.values == pytest.approx(nominal, rel=1e-12)
    assert found.gap.rms["after"] == found.gap.rms["before"] > 2.0
    assert not found.within_tolerance
    assert summary.sentence(found).startswith("Stopped after 1e-09 s, best so far: ")
    assert "Outside the catalogue" not in summary.sentence(found)
    assert summary.ruled_out(found) == {}
    assert summary.warnings(found)[0].startswith("stopped after 1e-09 s")
    check_schema(json.loads(found.to_json()))


def test_a_quick_diagnosis_names_the_cause_and_what_it_did_not_try(rig: Path) -> None:
    told: list[str] = []
    found = diagnose(rig, quick=True, tell=told.append)
    assert found.selection.taken.effects == ("transport_delay",)
    assert [len(one.effects) for one in found.selection.tried] == [1] * len(found.selection.tried)
    (line,) = (text for text in told if text.startswith("first answer"))
    assert ": transport_delay, gap " in line
    assert found.stopped == AT_FIRST_ANSWER
    assert "the next experiment" in found.unfinished
    assert found.next_experiments == ()
    assert summary.untried(found) in " ".join(str(found).split())
    if found.selection.unfinished:  # probabilities are those of whole searches
        assert all(effect.probability is None for effect in found.ranking)


def test_without_a_gap_nothing_is_left_to_be_tried(rig: Path) -> None:
    found = diagnose(rig, tolerance=1e6, time_limit=1e-9)
    assert found.within_tolerance
    assert found.unfinished == ()


@pytest.mark.parametrize("seconds", [-1.0, 0.0, math.nan, math.inf])
def test_a_limit_that_is_no_time_is_refused(rig: Path, seconds: float) -> None:
    with pytest.raises(UserError, match=r"time limit .*: give a number of seconds"):
        diagnose(rig, time_limit=seconds)


@pytest.mark.parametrize("text", ["-1s", "0s", "nan", "5 mm"])
def test_the_command_refuses_it_in_one_line(rig: Path, text: str, run: Run) -> None:
    code, out, err = run("diagnose", rig, "--time-limit", text)
    assert (code, out, len(err.splitlines())) == (2, "", 1)


class After(Stop):
    """Stops at the given request, whatever the time."""

    def __init__(self, requests: float) -> None:
        super().__init__()
        self.requests, self.asked = requests, count(1)

    def check(self) -> None:
        if self._searching and next(self.asked) >= self.requests:
            self.why = "here"
        super().check()


def stopped_after(requests: float) -> tuple[Selection, int]:
    """The selection, and how often it asked whether to stop."""
    fitter, _ = made(TWO_EFFECTS)
    stop = After(requests)
    steps = InternalSteps(fitter.model, fitter.floors, stop)
    return select_effects(replace(fitter, steps=steps)), next(stop.asked) - 1


@pytest.mark.thorough
def test_wherever_a_search_is_stopped_it_tells_what_it_has() -> None:
    """The later it is stopped, the less is left to be tried, and the less error."""
    whole, requests = stopped_after(math.inf)
    assert whole.unfinished == []
    assert set(whole.taken.effects) == {"coulomb_friction", "sensor_offset"}
    stages, left = [*STAGES], math.inf
    for share in (0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99):
        cut, asked = stopped_after(1 + share * requests)
        assert asked <= 1 + share * requests + 1
        assert 0 < len(cut.unfinished) <= len(stages)
        stages = list(cut.unfinished)
        now = cut.taken.evidence.rms
        assert now < 1.01 * left  # a fit to the end may leave a little more on unseen blocks
        left = now
        assert {one.effects for one in cut.tried} >= {cut.taken.effects} - {()}
    assert whole.taken.evidence.rms <= 1.01 * left


def test_tasks_that_were_begun_end_before_their_failure_is_told() -> None:
    """Nothing goes on behind the back of whoever has caught it."""
    begun, ended, failed = Event(), Event(), Event()

    def task(number: int) -> None:
        if number == 0:
            begun.wait()
            failed.set()
            raise UserError("no")
        begun.set()
        failed.wait()
        for _ in range(100_000):
            pass
        ended.set()

    with Workers(2) as workers:
        with pytest.raises(UserError):
            list(workers.map(task, [0, 1]))
        assert ended.is_set()


def test_the_first_ctrl_c_asks_and_the_second_one_raises() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with Stop() as stop:
            signal.raise_signal(signal.SIGINT)
            assert stop.passed
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)
        with Stop() as unasked:
            pass
        assert not unasked.passed
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_writes_the_best_so_far_whole(tmp_path: Path) -> None:
    """It comes as soon as there is a first answer, which is told in a pipe too."""
    describe(tmp_path)
    code = "import signal, sys, servo_models.cli; "
    code += "signal.signal(signal.SIGINT, signal.default_int_handler); "
    code += "sys.exit(servo_models.cli.main())"
    words = ["diagnose", "rig.toml", "--json", "d.json", "--report", "d.html", "--out", "P.toml"]
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr
        line = process.stderr.readline()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
    assert (process.returncode, err) == (1, "")
    assert line.startswith("first answer after ")
    assert "Stopped by Ctrl-C, best so far: transport_delay on 'voltage'" in out
    document = json.loads((tmp_path / "d.json").read_text())
    check_schema(document)
    assert "the next experiment" in document["unfinished"]
    assert document["warnings"][0].startswith("stopped by Ctrl-C")
    assert "Stopped by Ctrl-C" in (tmp_path / "d.html").read_text()
    assert read_parameters(tmp_path / "P.toml").warnings[0].startswith("stopped by Ctrl-C")
