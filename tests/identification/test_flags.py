"""Outputs that say yes or no, in an audit and in a fit: one sample that differs is one error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.identification.identify import identify
from tests.conftest import Run

HEAD = """
actuator = "torque_motor"
variant = "measured"
free = ["torque_constant"]
[[logs]]
file = "log.csv"
time = "t"
inputs.voltage = "u"
outputs.angle = { column = "angle", unit = "deg" }
"""
FLAG = 'outputs.at_stop = "stop"\n'


def describe(folder: Path, volts: float, flag: bool) -> Path:
    """Steps of a motor whose constant is 3 % smaller, with noise of 0.05 degrees."""
    times = 1e-3 * np.arange(600)
    voltage = volts * np.sign(np.sin(40.0 * times))
    weaker = 0.97 * model("torque_motor", "measured").values["torque_constant"]
    rig = model("torque_motor", "measured", {"torque_constant": weaker})
    found = simulate(rig, times, {"voltage": voltage})
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(times))
    columns = (times, voltage, np.degrees(found["angle"]) + noise, found["at_stop"])
    table = np.column_stack(columns)
    np.savetxt(
        folder / "log.csv", table, "%.9g", delimiter=",", header="t,u,angle,stop", comments=""
    )
    path = folder / "rig.toml"
    path.write_text(HEAD + (FLAG if flag else ""))
    return path


@pytest.mark.parametrize("volts", [5.0, 90.0])
def test_a_flag_is_audited_whether_or_not_it_changes(
    tmp_path: Path, run: Run, volts: float
) -> None:
    code, out, err = run("check", describe(tmp_path, volts, flag=True))
    assert code in (0, 1), err
    (line,) = [line for line in out.splitlines() if line.startswith("at_stop")]
    assert "0.2887" in line  # a step of 1 over the root of 12
    assert "'at_stop'" not in out  # nothing is doubtful in it


def test_a_flag_that_is_met_exactly_outweighs_nothing(tmp_path: Path) -> None:
    errors = []
    for flag in (False, True):
        result = identify(describe(tmp_path, 90.0, flag))
        assert result.result
        times, volts, _, seen = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1).T
        met = simulate(result.result.fitted, times, {"voltage": volts})["at_stop"]
        assert np.array_equal(met, seen)  # else one sample that differs makes the interval wider
        found = result.parameters
        assert found
        (estimate,) = [it for it in found.estimates if it.name == "torque_constant"]
        assert estimate.standard_error
        errors.append(estimate.standard_error)
    assert errors[1] == pytest.approx(errors[0], rel=0.3)
