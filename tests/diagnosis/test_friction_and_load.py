"""A motor with dry friction and a constant load or offset: neither alone explains it, both do."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.arrays import describe
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.verdict import EFFECTS

TIMES: Array = 5e-3 * np.arange(1600.0)
NOISE = 1.0  # rad/s
TRUE = {"torque_constant": 0.033, "rotor_inertia": 1.2e-5}
BELIEVED = {"torque_constant": "20 %", "rotor_inertia": "30 %", "viscous_coefficient": "50 %"}
FRICTIONS = {"coulomb_friction", "load_friction"}
LOADS = {"constant_load", "command_offset"}  # effects that nearly the same log would have


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("motor", "command", "largest", "effects"),
    [
        (
            "dc_motor",
            "voltage",
            12.0,
            {"coulomb_friction.level": 4e-3, "constant_load.torque": 3e-3},
        ),
        (
            "dc_motor",
            "voltage",
            12.0,
            {"coulomb_friction.level": 4e-3, "command_offset.value": 0.4},
        ),
        (
            "dc_motor_current",
            "current_command",
            0.8,
            {"coulomb_friction.level": 4e-3, "command_offset.value": 0.05},
        ),
        (
            "dc_motor_current",
            "current_command",
            0.8,
            {"coulomb_friction.level": 12e-3, "constant_load.torque": 0.01},
        ),
    ],
)
def test_both_are_named(
    motor: str, command: str, largest: float, effects: dict[str, float]
) -> None:
    random = np.random.default_rng(1)
    levels = random.uniform(-1.0, 1.0, 20)
    levels[0] = 0.0
    sent = largest * np.repeat(levels, 80)
    speed = simulate(model(motor, None, {**TRUE, **effects}), TIMES, {command: sent})[
        "encoder_speed"
    ]
    log = {
        "time": TIMES,
        command: sent,
        "encoder_speed": speed + NOISE * random.standard_normal(1600),
    }
    found = diagnose(
        describe(model(motor), {"rig": log}, {name: name for name in log}, uncertainty=BELIEVED)
    )
    taken = {*found.selection.taken.effects}
    assert found.verdict.kind == EFFECTS
    assert (len(taken), len(taken & FRICTIONS), len(taken & LOADS)) == (2, 1, 1)
    assert found.gap.rms["after"] < 1.1 < 0.2 * found.gap.rms["retuned"]
