"""Volts that were logged in steps of 10 mV and sent finer are no cogging, and hide no friction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.schema import Section
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.verdict import EFFECT, PARAMETERS
from tests.support.logs import changed, log_of

TIMES: Array = 2e-3 * np.arange(3000)
NOISE = 1e-3  # rad


def told(true: dict[str, float], step: float) -> Description:
    """An open loop, whose angle keeps every error of the volts."""
    motor, path, random = model("dc_motor", "direct"), Path("rig.toml"), np.random.default_rng(0)
    levels = random.uniform(-1.0, 1.0, 30)
    volts = levels[(TIMES / 0.2).astype(int)] + 2.0 * np.sin(2.0 * np.pi * 1.3 * TIMES)
    angle = simulate(changed(motor, true), TIMES, {"voltage": volts})["encoder_angle"]
    angle = angle + NOISE * random.standard_normal(len(TIMES))
    log = log_of(TIMES, {"voltage": np.round(volts / step) * step}, {"encoder_angle": angle})
    names = ("torque_constant", "resistance", "rotor_inertia")
    believed = {name: 0.1 * motor.values[name] for name in names}
    return Description(path, Section(path, "", {}), motor, {}, believed, (log,))


@pytest.mark.thorough
@pytest.mark.parametrize("step", [0.01, 0.05])
def test_steps_of_the_volts_are_no_cogging(step: float) -> None:
    found = diagnose(told({"torque_constant": 0.031}, step), jobs=1)
    assert found.verdict.kind == PARAMETERS
    value = next(it for it in found.found if it.name == "torque_constant")
    assert abs(value.value - 0.031) < 4.0 * value.standard_error


@pytest.mark.thorough
@pytest.mark.parametrize("step", [0.01, 0.05])
def test_a_friction_is_found_beside_them(step: float) -> None:
    found = diagnose(told({"coulomb_friction.level": 0.005}, step), jobs=1)
    assert found.verdict.kind == EFFECT
    assert found.selection.taken.effects == ("coulomb_friction",)
    value = next(it for it in found.found if it.name == "coulomb_friction.level")
    assert abs(value.value - 0.005) < 4.0 * value.standard_error
