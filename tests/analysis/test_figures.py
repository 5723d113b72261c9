"""Figures of merit against equations of the papers and python-control."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat

from servo_models.actuators.torque_motor.variants import TABLE_1
from servo_models.analysis.figures import figures, frequency_figures
from servo_models.analysis.linearise import linearise
from servo_models.analysis.sine_test import SineTest
from servo_models.catalogue import model
from servo_models.cli import main
from servo_models.errors import UserError
from tests.support.html_page import Page
from tests.support.papers import MEASURED, SG90, equation_12, equations_1_to_9


def equation_7(frequency: float) -> complex:
    """Equation 7 of the SG90 paper, over its static gain."""
    s = 2j * math.pi * frequency
    return 0.4927865625 / (s**2 + 1.307 * s + 0.4927865625)


def test_a_linear_servo_has_the_figures_of_its_transfer_function() -> None:
    """Both ways give -3 dB, -90 deg and the lag at a frequency of eq. 12 with its delay."""
    found = figures(model("torque_motor"), amplitude="20 V", frequencies=["10 Hz", 50.0, 100.0])
    static = 241560.0 / 184512000.0
    decibels = [-1.03, -8.40, -12.14]
    lags = [32.5, 93.5, 130.3]
    for measured, tolerance in ((found.small, 1e-6), (found.large, 2e-4)):
        assert measured is not None
        assert measured.static_gain == pytest.approx(static, rel=1e-6)
        assert measured.bandwidth is not None
        assert measured.phase_90 is not None
        edge = equation_12(measured.bandwidth) / static
        assert abs(edge) == pytest.approx(math.sqrt(0.5), rel=tolerance * 10)
        turned = np.angle(equation_12(measured.phase_90), deg=True)
        assert turned == pytest.approx(-90.0, abs=0.02)
        quarter = -np.angle(equation_12(0.25 * measured.bandwidth))
        delay = quarter / (0.5 * math.pi * measured.bandwidth)
        assert measured.delay == pytest.approx(delay, rel=tolerance * 10)
        for point, decibel, lag in zip(measured.points, decibels, lags):
            assert 20.0 * math.log10(point.gain) == pytest.approx(decibel, abs=0.01)
            assert math.degrees(point.lag) == pytest.approx(lag, abs=0.1)


def test_the_sg90_of_equation_7() -> None:
    found = figures(model(*SG90), amplitude="5 deg", frequencies=[0.05, 0.2])
    assert found.large is not None
    assert found.small is not None
    for point, other in zip(found.small.points, found.large.points):
        want = equation_7(point.frequency)
        assert point.gain == pytest.approx(abs(want), rel=1e-6)
        assert point.lag == pytest.approx(-np.angle(want), rel=1e-6)
        assert other.gain == pytest.approx(abs(want), rel=1e-3)
        assert other.lag == pytest.approx(-np.angle(want), rel=1e-3)
    assert found.step.final == pytest.approx(math.radians(5.0), rel=1e-3)


def test_a_saturated_drive_has_the_describing_function_of_a_saturation() -> None:
    """Slotine, Li, Applied Nonlinear Control, sec. 5.3.1."""
    limit, amplitude = 10.0, 30.0
    changes = {"drive_saturation.limit": limit, "end_stops.half_range": 0.0}
    chosen = model(*MEASURED, changes)
    share = limit / amplitude
    expected = 2.0 / math.pi * (math.asin(share) + share * math.sqrt(1.0 - share**2))
    linear = linearise(chosen).response(10.0, "voltage", "angle")[0]
    measured = SineTest(chosen, "voltage", "angle", amplitude).response(10.0)
    assert measured == pytest.approx(expected * linear, rel=2e-3)


def test_a_dead_zone_makes_the_answer_depend_on_the_size() -> None:
    """Slotine, Li, sec. 5.3.2: N = 1 - 2/pi (asin(d/A) + d/A sqrt(1 - d^2/A^2))."""
    half = 2.0
    chosen = model(*MEASURED, {"drive_dead_zone.half_width": half, "end_stops.half_range": 0.0})
    linear = linearise(chosen).response(10.0, "voltage", "angle")[0]
    for amplitude in (3.0, 20.0):
        share = half / amplitude
        lost = 2.0 / math.pi * (math.asin(share) + share * math.sqrt(1.0 - share**2))
        measured = SineTest(chosen, "voltage", "angle", amplitude).response(10.0)
        assert measured == pytest.approx((1.0 - lost) * linear, rel=2e-3)


def test_inside_the_dead_zone_nothing_is_reached() -> None:
    found = figures(model("sg90", "printed"), frequencies=[0.1])
    assert found.small is not None
    assert found.large is not None
    assert found.small.bandwidth is found.large.bandwidth is None
    assert found.step.delay is None
    assert "not reached" in str(found)


def test_a_loop_that_swings_says_why_there_are_no_figures() -> None:
    found = figures(model("sg90", "oscillatory_motor"))
    assert found.small is found.large is None
    assert "unstable" in found.missing[0]
    assert "unstable" in str(found)


def test_the_slew_rate_of_a_rate_limited_output_is_the_limit() -> None:
    """A rate limit on the voltage of a motor that is far faster makes the angle a ramp."""
    rate = 250.0
    chosen = model(*MEASURED, {"rate_limit.rate": rate, "end_stops.half_range": 0.0})
    static = TABLE_1["torque_constant"] / (TABLE_1["resistance"] * TABLE_1["stiffness"])
    # the ramp to 30 V takes 120 ms, the motor's slowest time constant is 8 ms
    assert figures(chosen).slew_rate == pytest.approx(rate * static, rel=0.02)


@given(
    static=st.floats(0.01, 100.0) | st.floats(-100.0, -0.01),
    corner=st.floats(0.1, 1000.0),
    delay=st.floats(0.0, 2.0),
)
@settings(max_examples=50)
def test_figures_of_a_lag_with_a_delay(static: float, corner: float, delay: float) -> None:
    """static exp(-s T) / (1 + s / corner): -3 dB at the corner, lag atan + w T, never wrapped."""
    late = delay / corner

    def response(frequency: float) -> complex:
        s = 2j * math.pi * frequency
        return complex(static * np.exp(-late * s) / (1.0 + s / corner))

    edge = corner / (2.0 * math.pi)
    found = frequency_figures(response, static, 0.01 * edge, [0.5 * edge, 4.0 * edge])
    assert found.bandwidth == pytest.approx(edge, rel=1e-4)
    for point, ratio in zip(found.points, (0.5, 4.0)):
        assert point.lag == pytest.approx(math.atan(ratio) + ratio * delay, rel=1e-6)
    assert found.delay == pytest.approx(
        (math.atan(0.25) + 0.25 * delay) / (0.25 * corner), rel=1e-4
    )
    if found.phase_90 is not None:
        ratio = 2.0 * math.pi * found.phase_90 / corner
        assert math.atan(ratio) + ratio * delay == pytest.approx(0.5 * math.pi, rel=1e-3)
    else:
        assert delay < 1e-3


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--amplitude", "5 kg"], "'kg' does not convert"),
        (["--amplitude", "0 V"], "above 0"),
        (["--amplitude", "500 V"], "outside"),
        (["--frequency", "5 deg"], "frequency"),
        (["--frequency", "-5"], "above 0"),
        (["--at", "volts=3"], "did you mean 'voltage'?"),
        (["--at", "voltage=3 A"], "does not convert to 'V'"),
        (["--out", "a.xlsx"], ".json, .mat, .npz"),
    ],
)
def test_what_cannot_be_measured_is_told_in_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["figures", "torque_motor", *words]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert said in captured.err


@pytest.mark.parametrize("suffix", [".json", ".mat", ".npz"])
def test_a_file_holds_the_state_space(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"motor{suffix}"
    words = ["figures", *MEASURED[:1], "--variant", MEASURED[1], "--frequency", "10 Hz"]
    assert main([*words, "--amplitude", "1 deg", "--out", str(path)]) == 0
    assert "bandwidth" in capsys.readouterr().out
    if suffix == ".json":
        tree = json.loads(path.read_text())
        space = tree["state_space"]
        assert tree["at_amplitude"]["points"][0]["frequency"] == 10.0
    elif suffix == ".mat":
        space = loadmat(path, simplify_cells=True)
        assert list(space["state_space"]["states"]) == ["current", "shaft_angle", "shaft_speed"]
    else:
        with np.load(path) as opened:
            space = {name: opened[name] for name in "ABCD"}
            assert json.loads(str(opened["figures"]))["variant"] == "measured"
    want = equations_1_to_9()
    np.testing.assert_allclose(np.array(space["A"]), want.A, rtol=1e-9)
    np.testing.assert_allclose(np.array(space["B"]), want.B, rtol=1e-9)


@pytest.mark.parametrize("suffix", [".json", ".mat", ".npz"])
def test_what_is_missing_does_not_stop_the_file(suffix: str, tmp_path: Path) -> None:
    figures(model("sg90", "oscillatory_motor")).write(tmp_path / f"a{suffix}")
    assert (tmp_path / f"a{suffix}").stat().st_size > 0


@pytest.mark.thorough
def test_a_model_that_drifts_has_no_working_point() -> None:
    with pytest.raises(UserError, match="does not come to rest"):
        linearise(model("sg90", "oscillatory_motor"), {"pulse_width": 1.7e-3})


def test_figures_offer_what_every_result_does(tmp_path: Path) -> None:
    found = figures(model(*MEASURED), amplitude="1 deg", frequencies=["10 Hz"])
    assert found.small is not None
    assert found.small.bandwidth is not None
    assert repr(found).startswith("<Figures of torque_motor, variant measured")
    (matrix,) = (t for title, t in found.tables().items() if title.startswith("A and B"))
    want = equations_1_to_9()
    assert matrix["load_torque"].to_list() == pytest.approx(want.B[:, 1].tolist(), rel=1e-9)
    axes = found.plot()
    hertz, gain = axes.lines[0].get_data()
    half_power = np.interp(found.small.bandwidth, np.asarray(hertz), np.asarray(gain))
    assert half_power == pytest.approx(20.0 * math.log10(math.sqrt(0.5)), abs=0.01)
    found.write_report(tmp_path / "figures.html")
    page = Page((tmp_path / "figures.html").read_text("utf-8"))
    page.assert_stands_alone()
    assert page.count("svg") == 1
