"""The linear drive against its closed form, at random, and against the rig itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.clock import regular
from servo_models.validation.linear_drive.reference import LinearDrive

TICK = 1e-3


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    mass=st.floats(60.0, 300.0),
    viscous=st.floats(20.0, 1000.0),
    coulomb=st.floats(0.0, 50.0),
    offset=st.floats(-20.0, 20.0),
    delay=st.floats(0.0, 1.5e-3),
    ticks=st.integers(1, 5),
    seed=st.integers(0, 1000),
)
def test_any_rig_follows_its_closed_form(
    mass: float,
    viscous: float,
    coulomb: float,
    offset: float,
    delay: float,
    ticks: int,
    seed: int,
) -> None:
    """Smooth commands and pulses, loads of any size, one to five ticks a row."""
    random = np.random.default_rng(seed)
    times = ticks * TICK * np.arange(300)
    sway = random.uniform(2.0, 20.0) * times
    inputs = {
        "reference": 1e-3 * random.uniform(0.0, 5.0) * (1.0 - np.cos(sway)),
        "disturbance": random.choice([0.0, 2.0], 300),
        "load_force": np.repeat(random.uniform(-60.0, 60.0, 6), 50),
    }
    values = {
        "mass": mass,
        "viscous_coefficient": viscous,
        "coulomb_friction.level": coulomb,
        "force_offset": offset,
        "transport_delay.time": delay,
    }
    found = simulate(model("linear_drive", "simple", values), times, inputs)
    expected = LinearDrive(mass, viscous, coulomb, offset, delay)(times, inputs)
    for name, curve in expected.items():
        np.testing.assert_allclose(found[name], curve, atol=1e-4 * np.abs(curve).max())


def test_rounded_time_stamps_of_a_log_do_not_lose_a_tick() -> None:
    """A row 30 ns early or late still meets its own tick, with the delay's edge beside it."""
    exact = TICK * np.arange(1000)
    rounded = exact + np.random.default_rng(2).uniform(-3e-8, 3e-8, 1000)
    rounded[0] = 0.0
    command = {"reference": 0.01 * (1.0 - np.cos(10.0 * exact))}
    one, other = (simulate(model("linear_drive"), t, command) for t in (exact, rounded))
    np.testing.assert_allclose(other["position"], one["position"], atol=1e-8)
    np.testing.assert_allclose(other["drive"], one["drive"], atol=1e-3)


def rms(error: Array) -> float:
    """Root of the mean square after the first second."""
    return float(np.sqrt(np.mean(error[1000:] ** 2)))


@pytest.fixture
def rig(logs_folder: Path, request: pytest.FixtureRequest) -> dict[str, Array]:
    from scipy.io import loadmat

    found = loadmat(logs_folder / "emps" / request.param)
    return {k: v.ravel().astype(float) for k, v in found.items() if not k.startswith("__")}


@pytest.mark.parametrize("rig", ["DATA_EMPS.mat"], indirect=True)
def test_the_published_constants_meet_the_rig(rig: dict[str, Array]) -> None:
    """Simulated from the command in the closed loop; the stroke is 0.24 m."""
    times = regular(rig["t"] - rig["t"][0])
    run = simulate(model("linear_drive"), times, {"reference": rig["qg"]})
    assert rms(run["position"] - rig["qm"]) < 1.7e-6
    assert rms(run["drive"][1:] - rig["vir"][:-1]) < 0.075


@pytest.mark.parametrize("rig", ["DATA_EMPS_PULSES.mat"], indirect=True)
def test_pulses_are_added_to_the_logged_drive(rig: dict[str, Array]) -> None:
    """The log's drive is stamped as it is computed, pulses included; an output a row later."""
    times = regular(rig["t"] - rig["t"][0])
    inputs = {"reference": rig["qg"], "disturbance": rig["pulses_N"]}
    run = simulate(model("linear_drive"), times, inputs)
    assert rms(run["position"] - rig["qm"]) < 2.5e-6
    assert rms(run["drive"][1:] - rig["vir"][:-1]) < 0.095
    without = simulate(model("linear_drive"), times, {"reference": rig["qg"]})
    assert rms(without["position"] - rig["qm"]) > 1e-5
