"""Two servos in one description, and one that was changed midway, are told as that."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.stop import BY_CTRL_C
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.log import Log
from servo_models.data.schema import Section
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.selection import Selection
from servo_models.diagnosis.stretches import Part, unlike_parts
from servo_models.diagnosis.verdict import OUTSIDE, PARAMETERS
from studies.far_parameters import BELIEVED, NOISE, TIMES, goals
from tests.support.logs import changed, log_of

Explain = Callable[[Fitter], FittedModel]
ONE = {"natural_frequency": 22.0, "damping_ratio": 0.62, "transport_delay.time": 0.01}
OTHER = {"natural_frequency": 27.0, "damping_ratio": 0.7, "transport_delay.time": 0.01}
"""Two servos [SI]."""


def angle(true: dict[str, float], goal: Array, seed: int) -> Array:
    servo = changed(model("second_order_servo", "bus"), true)
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(TIMES))
    return simulate(servo, TIMES, {"goal": goal})["angle"] + noise


def diagnosed(*logs: Log) -> Diagnosis:
    nominal, path = model("second_order_servo", "bus"), Path("rig.toml")
    return diagnose(Description(path, Section(path, "", {}), nominal, {}, BELIEVED, logs), jobs=1)


def moves(seed: int) -> Array:
    """Other goals than those of another seed."""
    goal = np.roll((-1.0) ** seed * goals(), 300 * seed)
    goal[:20] = 0.0
    return goal


def told(true: dict[str, float], seed: int) -> Log:
    log = log_of(TIMES, {"goal": moves(seed)}, {"angle": angle(true, moves(seed), seed)})
    return replace(log, name=f"run {seed}")


@pytest.mark.long
def test_logs_of_two_servos_are_told_apart() -> None:
    found = diagnosed(told(ONE, 0), told(OTHER, 1))
    assert found.verdict.kind == OUTSIDE
    assert "Not one actuator" in summary.sentence(found)
    assert [one.log for one in found.parts] == ["run 0", "run 1"]
    assert [one.value.name for one in found.parts] == ["natural_frequency"] * 2
    for one, true in zip(found.parts, (ONE, OTHER)):
        assert abs(one.value.value - true[one.value.name]) < 4.0 * one.value.standard_error
    assert found.document()["parts"][1]["log"] == "run 1"


@pytest.mark.thorough
def test_two_servos_with_the_same_play_are_told_apart() -> None:
    """What differs hides the play: it is sought in one log, and explains the other."""
    play = {"backlash.half_width": 0.03}
    found = diagnosed(
        told({**ONE, **play}, 0), told({**OTHER, "natural_frequency": 40.0, **play}, 1)
    )
    assert [part.sure for part in found.parts] == [True, True]
    assert found.document()["parts"][0]["sure"]
    assert "Not one actuator" in summary.headline(found)


@pytest.mark.long
def test_a_change_midway_is_told() -> None:
    goal, half = moves(0), np.arange(len(TIMES)) < len(TIMES) // 2
    reading = np.where(half, angle(ONE, goal, 0), angle(OTHER, goal, 1))
    found = diagnosed(log_of(TIMES, {"goal": goal}, {"angle": reading}))
    assert found.verdict.kind == OUTSIDE
    assert "changed midway" in summary.sentence(found)
    assert any("of each half alone, parameters of its own" in it for it in summary.warnings(found))
    assert [one.half for one in found.parts] == ["first", "second"]
    for one, true in zip(found.parts, (ONE, OTHER)):
        assert abs(one.value.value - true[one.value.name]) < 4.0 * one.value.standard_error


@pytest.mark.thorough
def test_two_logs_of_one_servo_are_of_one() -> None:
    found = diagnosed(told(ONE, 0), told(ONE, 1))
    assert found.verdict.kind == PARAMETERS
    assert not found.parts


@pytest.mark.long
def test_a_log_that_no_fit_sees_is_no_part() -> None:
    """One of two logs is held out: the halves of the other one are compared."""
    goal, half = moves(0), np.arange(len(TIMES)) < len(TIMES) // 2
    reading = np.where(half, angle(ONE, goal, 0), angle(OTHER, goal, 1))
    unseen = replace(told(ONE, 1), held_out=np.ones(len(TIMES), dtype=bool))
    found = diagnosed(log_of(TIMES, {"goal": goal}, {"angle": reading}), unseen)
    assert [one.half for one in found.parts] == ["first", "second"]


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_while_parts_are_fitted_ends_that(monkeypatch: pytest.MonkeyPatch) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def interrupted(fitter: Fitter, selection: Selection, explain: Explain) -> tuple[Part, ...]:
        signal.raise_signal(signal.SIGINT)
        return unlike_parts(fitter, selection, explain)

    monkeypatch.setattr("servo_models.diagnosis.diagnose.unlike_parts", interrupted)
    try:
        found = diagnosed(told(ONE, 0), told(OTHER, 1))
    finally:
        signal.signal(signal.SIGINT, before)
    assert found.parts == ()
    assert found.stopped == BY_CTRL_C
    assert "each part by itself" in found.unfinished
