"""A valve that sticks is found from its steps and a triangle, with its band and its jump."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.isolability import experiment
from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.diagnosis.diagnose import diagnose

STEP, NOISE = 5e-4, 2e-5
TRIANGLE = 12.0 * (4.0 * np.abs(np.mod(np.arange(600) / 300.0 + 0.25, 1.0) - 0.5) - 1.0)
VOLTAGE: Array = np.concatenate(
    [np.repeat([0.0, 15.0, -15.0, 30.0, 5.0, 7.5, 6.0, 0.0], 60), TRIANGLE]
)
RIG = """
actuator = "torque_motor"
variant = "measured"
[[logs]]
file = "log.csv"
time = "t"
inputs.voltage = "voltage"
outputs.angle = "angle"
"""


@pytest.mark.parametrize(
    ("band", "jump"),
    [
        (5.0, 0.15),
        pytest.param(4.0, 0.8, marks=pytest.mark.thorough),
        pytest.param(
            *(2.2, 0.3),
            marks=[
                pytest.mark.thorough,
                pytest.mark.xfail(reason="a small load is named beside it, see docs/limits.md"),
            ],
        ),
    ],
)
def test_stiction_is_named_with_its_band_and_jump(tmp_path: Path, band: float, jump: float) -> None:
    sticking = {"stiction.band": band, "stiction.jump": jump}
    times: Array = STEP * np.arange(float(len(VOLTAGE)))
    angle = simulate(model("torque_motor", "measured", sticking), times, {"voltage": VOLTAGE})
    reading = angle["angle"] + NOISE * np.random.default_rng(1).standard_normal(len(times))
    rows = np.column_stack([times, VOLTAGE, reading])
    path = tmp_path / "log.csv"
    np.savetxt(path, rows, "%.9g", delimiter=",", header="t,voltage,angle", comments="")
    (tmp_path / "rig.toml").write_text(RIG)
    found = diagnose(tmp_path / "rig.toml")
    assert (found.verdict.kind, found.verdict.members) == ("effect", ("stiction",))
    assert found.fitted.values["stiction.band"] == pytest.approx(band, rel=0.03)
    assert found.fitted.values["stiction.jump"] == pytest.approx(jump, abs=0.03)
    # a slip that comes a row early or late leaves some noise floors
    assert found.gap.rms["after"] < 0.1 * found.gap.rms["before"]


@pytest.mark.parametrize(
    "other", ["backlash", "dead_band", "hysteresis", "coulomb_friction", "stribeck_friction"]
)
def test_what_looks_like_it_is_told_apart_by_an_experiment(other: str) -> None:
    plant = model("torque_motor", "measured").plant
    assert "slow triangle" in experiment("stiction", other, plant)
