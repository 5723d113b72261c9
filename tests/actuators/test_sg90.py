"""Where the effects of the SG90 stand in its loop."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array

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


FAST = {
    "angle_unit": 1.0,
    "motor_time_constant": 0.015,
    "motor_gain": 50.0,
    "amplifier_gain": 60.0,
    "feedback_coefficient": 0.1,
    "potentiometer_gain": 1.5,
    "internal_step": 1e-3,
}
"""As fast as a real servo: 12 rad/s, 15 ms, 1.65e3 rad per second of pulse."""
GYRO = {
    "gyro_lag.time_constant": 0.02,
    "gyro_gain.error": -0.4,
    "gyro_offset.value": 0.3,
    "reading_gain.error": 0.1,
    "reading_offset.value": -0.05,
    "reading_quantisation.step": 0.01,
}


def test_a_servo_as_fast_as_a_real_one_and_the_sensors_on_its_horn() -> None:
    """Angle, rate and lagged gyro by the matrix exponential; no limits, no frame."""
    times = np.arange(0.0, 0.6, 1.0 / 75.0)
    pulse = np.where(times % 0.4 < 0.2, 1.7e-3, 1.4e-3)
    moved = simulate(model("sg90", "linear", {**FAST, **GYRO}), times, {"pulse_width": pulse})

    slowness, per_volt, stiffness = 0.015, 50.0 / 24.0 * 60.0, 0.1 * 1.5
    a = [[0, 1, 0], [-per_volt * stiffness / slowness, -1 / slowness, 0], [0, 50, -50]]
    b = [[0], [per_volt / slowness], [0]]
    volts = 250.0 * (pulse - 1.5e-3)
    _, expected, _ = lsim((a, b, np.eye(3), np.zeros((3, 1))), volts, times, interp=False)
    angle, rate, lagged = expected.T
    assert np.abs(rate).max() > 5.0
    np.testing.assert_allclose(moved["angle"], angle, atol=1e-5)
    np.testing.assert_allclose(moved["rate"], rate, atol=1e-4)
    np.testing.assert_allclose(moved["rate_reading"], 0.6 * lagged + 0.3, atol=2e-3)
    assert np.abs(moved["angle_reading"] - (1.1 * moved["angle"] - 0.05)).max() <= 0.005 + 1e-12
    codes = moved["angle_reading"] / 0.01
    np.testing.assert_allclose(codes, np.round(codes), atol=1e-9)


class TestAirframe:
    """The servo that a larger model loads, drives too far, or does not drive."""

    TIMES = np.arange(0.0, 3.0, 1e-3)
    DATA_SHEET_STALL = 1.8 * 9.80665e-2  # kg cm -> N m, at 4.8 V
    FRICTION, INERTIA = 0.00355, 0.0347 * 0.1765 / (51.1 * 4.8 / 24.0)

    def angle(self, pulse: float, load: float = 0.0, supply: float = 5.0) -> Array:
        given = {"pulse_width": pulse, "load_torque": load, "supply_voltage": supply}
        return simulate(model("sg90", "airframe"), self.TIMES, given)["angle"]

    @pytest.mark.parametrize(("pulse", "load"), [(5e-3, 0.0), (1.472e-3, -0.5), (0.0, -0.05)])
    def test_whatever_drives_it_ends_at_the_travel_of_the_data_sheet(
        self, pulse: float, load: float
    ) -> None:
        furthest = np.degrees(np.abs(self.angle(pulse, load)).max())
        assert furthest == pytest.approx(90.0, abs=5.0 + 1e-9)

    def test_without_pulses_a_load_turns_it_as_newton_says(self) -> None:
        load = 0.02
        moved = simulate(
            model("sg90", "airframe", {"transport_delay.time": 0.0}),
            self.TIMES[:300],
            {"pulse_width": 0.0, "load_torque": load},
        )
        acceleration = (load - self.FRICTION) / self.INERTIA
        expected = -0.5 * acceleration * self.TIMES[:300] ** 2
        # the supply stays on, so nothing but the pulses is missing
        np.testing.assert_allclose(moved["angle"], expected, atol=2e-3 * np.abs(expected).max())
        assert np.all(moved["motor_voltage"] == 0.0)

    def test_without_pulses_friction_holds_a_small_load(self) -> None:
        servo = model("sg90", "airframe", {"transport_delay.time": 0.0})  # else pulses come before
        given = {"pulse_width": 0.0, "load_torque": 0.9 * self.FRICTION}
        assert np.all(simulate(servo, self.TIMES, given)["angle"] == 0.0)

    @pytest.mark.parametrize(("share", "lifts"), [(0.9, True), (1.1, False)])
    def test_it_stalls_where_the_data_sheet_says(self, share: float, lifts: bool) -> None:
        angle = self.angle(2.4e-3, share * self.DATA_SHEET_STALL, 4.8)
        assert bool(angle[-1] > angle[len(angle) // 2]) is lifts

    def test_what_nobody_has_measured_is_told(self) -> None:
        given = {"pulse_width": 1.5e-3, "load_torque": np.where(self.TIMES < 0.5, 0.17, 0.18)}
        told = simulate(model("sg90", "airframe"), self.TIMES, given).warnings
        assert len(told) == 1
        assert "load_torque -0.1765 to 0.1765 N.m), at t = 0.5 s" in told[0]
