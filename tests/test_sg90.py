"""Where the effects of the SG90 stand in its loop."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.simulate import model, simulate

PULSE = 2.4e-3


@pytest.mark.parametrize("source", [1.0, 7.0, 50.0])
def test_a_sagging_supply_gives_the_standing_motor_what_ohm_allows(source: float) -> None:
    """At standstill the motor is its resistance alone: a divider with that of the source."""
    armature, supply, gain = 7.0, 5.0, 14.0
    given = {
        "supply_limit.share": 1.0,
        "supply_sag.resistance": source,
        "armature_resistance": armature,
        "amplifier_gain": gain,
    }
    start = simulate(model("sg90", "linear", given), [0.0], {"pulse_width": PULSE})
    wanted = gain * supply * (PULSE - 1.5e-3) / 20e-3
    allowed = supply * armature / (armature + source)
    assert start["motor_voltage"][0] == pytest.approx(min(wanted, allowed), rel=1e-12)


def test_warmth_weakens_the_drive_but_never_turns_it_round() -> None:
    """The winding is warmed by what the supply gives, however much the amplifier asks for."""
    given = {
        "amplifier_gain": 1000.0,
        "thermal_drift.loss": 0.1,
        "thermal_drift.time_constant": 1.0,
    }
    times = np.arange(0.0, 10.0, 0.02)
    moved = simulate(model("sg90", "printed", given), times, {"pulse_width": 2.0e-3})
    assert np.all(moved["angle"] >= 0.0)
    assert moved["angle"][-1] > 0.5
