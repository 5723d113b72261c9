"""Linear state spaces against equations of the papers and python-control."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from numpy.typing import NDArray

from servo_models.actuators.torque_motor.variants import TABLE_1
from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.linearise import linearise
from servo_models.analysis.sine_test import SineTest
from servo_models.catalogue import actuator, model
from tests.support.papers import MEASURED, SG90, equation_12, equations_1_to_9


def test_the_state_space_is_that_of_the_papers_equations() -> None:
    found = linearise(model(*MEASURED))
    a, b, c, d = found.matrices()
    want = equations_1_to_9()
    assert found.states == ("current", "shaft_angle", "shaft_speed")
    assert found.inputs == ("voltage", "load_torque")
    np.testing.assert_allclose(a, want.A, rtol=1e-9)
    np.testing.assert_allclose(b, want.B, rtol=1e-9)
    np.testing.assert_allclose(c[:1], want.C, rtol=1e-9)
    np.testing.assert_allclose(d[:1], want.D, atol=1e-12)


def test_delays_are_exact_and_apart_from_a_b_c_d() -> None:
    found = linearise(model("torque_motor", "identified"))
    frequencies = [1.0, 10.0, 50.0, 187.8, 1000.0]
    np.testing.assert_allclose(
        found.response(frequencies, "voltage", "angle"), equation_12(frequencies), rtol=1e-8
    )
    a, b, c, d = found.channel("voltage", "angle")
    numerator, denominator = control.tfdata(control.ss2tf(control.ss(a, b, c, d)))
    assert denominator[0][0] == pytest.approx([1.0, 492.0, 1582240.0, 184512000.0], rel=1e-8)
    assert numerator[0][0][-1] == pytest.approx(241560.0, rel=1e-8)
    assert found.delays == {"transport_delay": 0.0011}


def test_a_lag_is_one_more_state() -> None:
    plain = linearise(model(*MEASURED))
    late = linearise(model(*MEASURED, {"sensor_lag.time_constant": "2 ms"}))
    assert late.states == (*plain.states, "sensor_lag")
    frequencies = np.array([1.0, 20.0, 100.0])
    route = (frequencies, "voltage", "angle")
    ratio = late.response(*route) / plain.response(*route)
    np.testing.assert_allclose(ratio, 1.0 / (1.0 + 2j * np.pi * frequencies * 2e-3), rtol=1e-8)


def test_the_working_point_shifts_what_is_not_linear() -> None:
    """A spring k theta (1 + c theta^2) has the slope k (1 + 3 c theta^2)."""
    hard = {"stiffness_hardening.coefficient": 200.0, "end_stops.half_range": 0.0}
    found = linearise(model(*MEASURED, hard), {"voltage": 20.0})
    angle = found.point["angle"]
    torque = TABLE_1["torque_constant"] * 20.0 / TABLE_1["resistance"]
    stiffness = TABLE_1["stiffness"]
    spring = [200.0 * stiffness, 0.0, stiffness, -torque]
    assert angle == pytest.approx(np.roots(spring)[np.isreal(np.roots(spring))].real[0], rel=1e-6)
    slope = -found.matrices()[0][2, 1] * TABLE_1["rotor_inertia"]
    assert slope == pytest.approx(stiffness * (1.0 + 600.0 * angle**2), rel=1e-5)


JUMPS = {
    "backlash.half_width": "0.1 deg",
    "coulomb_friction.level": 0.002,
    "drive_dead_zone.half_width": 1.0,
    "direction_asymmetry.ratio": 0.2,
    "sensor_quantisation.step": "0.01 deg",
    "sample_hold.period": "2 ms",
}


def test_what_has_no_derivative_is_left_out_and_named() -> None:
    found = linearise(model(*MEASURED, JUMPS))
    assert set(found.left_out) == {name.split(".")[0] for name in JUMPS}
    np.testing.assert_allclose(found.matrices()[0], linearise(model(*MEASURED)).matrices()[0])


def test_what_is_smooth_here_is_kept() -> None:
    smooth = {"drive_saturation.limit": 20.0, "gain_error.error": 0.1, "cogging.torque": 1e-4}
    assert linearise(model(*MEASURED, smooth)).left_out == {}
    assert set(linearise(model(*MEASURED, smooth), {"voltage": 30.0}).left_out) == {
        "drive_saturation"
    }


@pytest.mark.parametrize("effect", list(actuator("torque_motor").plant.placements))
def test_every_effect_is_in_the_linear_model_or_named(effect: str) -> None:
    """With all kept effects a small sine has the response of the state space."""
    switches = {
        p.name: p.param.typical or p.param.default
        for p in actuator("torque_motor").plant.parameters.values()
        if p.owner == effect and p.param.switch
    }
    chosen = model(*MEASURED, switches)
    found = linearise(chosen)
    assert set(found.left_out) <= {effect}
    if effect not in found.left_out:
        linear = found.response(30.0, "voltage", "angle")[0]
        measured = SineTest(chosen, "voltage", "angle", 0.05).response(30.0)
        assert measured == pytest.approx(linear, rel=2e-3)


def linear_drive(delay: float, friction: float = 0.0) -> LinearModel:
    changes = {"transport_delay.time": delay, "coulomb_friction.level": friction}
    return linearise(model("linear_drive", "identified", changes))


def discrete_loop(frequency: float, delay: float) -> complex:
    """Position over reference of the EMPS loop with an undisturbed sampled controller.

    Mass and damper between samples by the zero-order hold of python-control; the delay cuts
    each period in two (Franklin, Powell, Workman, sec. 4.3.4).
    """
    values = model("linear_drive", "identified").values
    mass, damping = values["mass"], values["viscous_coefficient"]
    gain, period = values["force_gain"], values["sample_time"]
    a = np.array([[0.0, 1.0], [0.0, -damping / mass]])
    b = np.array([[0.0], [gain / mass]])
    whole = math.floor(delay / period + 1e-9)
    rest = delay - whole * period

    def held(span: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if span <= 0.0:
            return np.eye(2), np.zeros((2, 1))
        made = control.c2d(control.ss(a, b, np.eye(2), 0.0), span)
        return np.asarray(made.A), np.asarray(made.B)

    phi, _ = held(period)
    late_phi, young = held(period - rest)
    old = late_phi @ held(rest)[1]
    z = np.exp(2j * math.pi * frequency * period)
    force = young * z**-whole + old * z ** -(whole + 1)
    plant = (np.linalg.solve(z * np.eye(2) - phi, force))[0, 0]
    k_p, k_v = values["position_gain"], values["speed_gain"]
    speed = 0.5 * (1.0 - z**-2) / period
    return complex(k_v * k_p * plant / (1.0 + k_v * (k_p + speed) * plant))


@pytest.mark.parametrize("delay", [0.0, 0.0004, 0.001, 0.0023])
def test_a_sampled_loop_is_linear_from_tick_to_tick(delay: float) -> None:
    found = linear_drive(delay)
    assert found.period == pytest.approx(1e-3, rel=1e-9)
    for frequency in (1.0, 10.0, 40.0, 200.0):
        got = found.response(frequency, "reference", "position")[0]
        assert got == pytest.approx(discrete_loop(frequency, delay), rel=1e-5)


def test_friction_of_a_sampled_loop_is_left_out() -> None:
    assert "coulomb_friction" in linear_drive(0.0, friction=20.0).left_out


def test_an_offset_of_a_sensor_moves_the_point_of_rest_only() -> None:
    plain = linear_drive(0.0)
    moved = linearise(
        model(
            "linear_drive",
            "identified",
            {
                "transport_delay.time": 0.0,
                "coulomb_friction.level": 0.0,
                "sensor_offset.value": "2 mm",
            },
        )
    )
    assert moved.left_out == {}
    np.testing.assert_allclose(moved.matrices()[0], plain.matrices()[0], rtol=1e-6, atol=1e-9)
    assert moved.point["position"] == pytest.approx(plain.point["position"] - 2e-3, abs=1e-9)


def test_poles_that_grow_are_seen() -> None:
    assert linearise(model(*SG90)).is_stable()
    assert not linearise(model("sg90", "oscillatory_motor")).is_stable()
    assert linear_drive(0.0).is_stable()


@pytest.mark.parametrize("stop_time", [1.0, 1.003])
def test_a_controller_without_states_also_ticks_at_the_end_of_the_standard_run(
    stop_time: float,
) -> None:
    """A gain that is read every 20 ms: nothing of it is 0, wherever its standard run ends."""
    path = Path(__file__).parents[2] / "examples" / "uav" / "autopilot.py"
    pilot = model(replace(actuator(str(path)), stop_time=stop_time))
    found, gains = linearise(pilot), pilot.values
    _, _, _, through = found.channel("roll_command", "aileron")
    assert through.item() == pytest.approx(gains["roll_gain"])
    assert found.channel("pitch_rate", "elevator")[3].item() == pytest.approx(
        gains["pitch_damping"]
    )
    sums = found.matrices()[1][found.states.index("control.roll_sum")]
    assert sums[found.inputs.index("roll_command")] == pytest.approx(0.02)
