"""Angles that were written within a turn, and what only looks like them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.data.sensor import TURN, unwrapped
from tests.conftest import Run

TIMES = 0.01 * np.arange(600)


def motion(offset: float) -> Array:
    """Swings of 2 rad to either side, with noise."""
    noise = np.random.default_rng(1).normal(0.0, 2e-3, len(TIMES))
    return offset + 2.0 * np.sin(1.5 * TIMES) + noise


def within(angles: Array, low: float) -> Array:
    return (angles - low) % TURN + low


@given(st.floats(-20.0, 20.0), st.sampled_from([0.0, -np.pi]))
def test_an_angle_goes_on_by_what_it_has_moved(offset: float, low: float) -> None:
    true = motion(offset)
    found, back = unwrapped(within(true, low))
    assert np.diff(found) == pytest.approx(np.diff(true), abs=1e-12)
    assert len(back) == np.count_nonzero(np.diff(np.floor((true - low) / TURN)))


def test_what_does_not_wrap_stays() -> None:
    wild = motion(4.0)
    wild[300] = 0.0  # a reading that failed
    fast = 3.0 * np.sin(1.2 * np.arange(600))  # up to half a turn in a row
    for angles in (motion(0.0), wild, fast, np.linspace(0.0, 30.0, 600)):
        found, back = unwrapped(angles)
        assert (found == angles).all()
        assert not len(back)


def test_counts_that_wrap_go_on_and_this_is_told(run: Run, tmp_path: Path) -> None:
    """Goal and position of a bus servo of 4096 counts a turn, across its zero."""
    goal = 6.0 + 2.0 * np.sin(1.5 * TIMES)
    counts = [np.round(within(it, 0.0) / TURN * 4096) % 4096 for it in (goal, motion(6.0))]
    columns = {"time_s": TIMES, "goal_position": counts[0], "present_position": counts[1]}
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    run("check", tmp_path / "log.csv", "--init", "--actuator", "second_order_servo")

    (log,) = read_description(tmp_path / "log.toml").logs

    error = np.rad2deg(log.outputs["angle"] - motion(6.0))
    assert np.ptp(error) < 0.1
    assert np.rad2deg(log.inputs["goal"] - goal) == pytest.approx(error, abs=0.1)
    assert any("'angle' comes back by a turn, first in row" in note for note in log.notes)
