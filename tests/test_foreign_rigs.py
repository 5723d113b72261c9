"""The study of simulations that are not ours: its rigs, and two of its diagnoses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servo_models import diagnose, model, simulate
from studies.foreign_rigs import KINDS, figures, what, write
from studies.second_plant.rigs import goals

PERIOD = 0.01  # s


@pytest.mark.thorough
@pytest.mark.parametrize("name", KINDS)
def test_a_simulation_and_the_law_of_its_rigs_agree(tmp_path: Path, name: str) -> None:
    """Two implementations of one physics; what is left is that of the simulation's steps."""
    if name == "mjcf":
        pytest.importorskip("mujoco", reason="the extra 'benchmark' is not installed")
    kind = KINDS[name]
    kind.write(tmp_path)
    goal = goals(PERIOD, np.random.default_rng(3))[0]
    inputs, times = {kind.signals[0]: goal}, PERIOD * np.arange(len(goal))
    found = simulate(model(str(tmp_path / kind.actuator)), times, inputs)["angle"]
    assert np.ptp(found) > 0.5
    np.testing.assert_allclose(found, kind.curves(times, inputs)["angle"], atol=6e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("cause", ["backlash", ""])
def test_what_is_planted_is_named_and_nothing_else(tmp_path: Path, cause: str) -> None:
    write(tmp_path / "rig", KINDS["function"], cause, np.random.default_rng(5))
    found = diagnose(tmp_path / "rig" / "description.toml", jobs=1, quick=True)
    assert found.selection.taken.effects == ((cause,) if cause else ())


def test_what_acts_before_a_linear_simulation_is_what_acts_behind_it() -> None:
    for before, behind in (("command_gain", "sensor_gain"), ("command_lag", "sensor_lag")):
        assert what(before) == what(behind)
    assert what("dead_band") != what("backlash")


def test_a_false_name_beside_the_right_one_is_counted() -> None:
    row = {
        "truth": "backlash",
        "named": ["backlash", "sensor_lag"],
        "ranking": ["backlash", "sensor_lag"],
        "set": ["backlash"],
        "verdict": "effects",
        "processor_seconds": 1.0,
    }
    shares = dict(line.split(" | ")[:2] for line in figures([row]) if line.count("|") == 2)
    assert {name for name, told in shares.items() if told.startswith("1.00")} == {
        "first in the ranking",
        "in the set",
        "something false is named",
    }
