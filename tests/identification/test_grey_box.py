"""Physical constants of the torque motor: the paper's figures, and the truth of simulated rigs."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim
from scipy.stats import chi2

from servo_models import model, simulate
from servo_models.actuators.torque_motor.variants import (
    EQ_12,
    EQ_12_DELAY,
    GREY_BOX,
    TABLE_1,
    grey_box,
)
from servo_models.core.plant import GreyBox
from servo_models.identification.grey_box import physical_constants
from servo_models.validation.torque_motor.reference import Constants

PRINTED = {
    "torque_constant": ("{:.2f}", "5.23"),
    "back_emf_constant": ("{:.2f}", "0.08"),
    "inductance": ("{:.1f}", "29.9"),
    "friction_coefficient": ("{:.1e}", "2.7e-04"),
}
"""Table 2 of the valve paper, to its printed digits."""


def test_table_2_follows_from_eq_12() -> None:
    found = physical_constants(GREY_BOX, EQ_12, TABLE_1)
    shown = {n: form.format(found.constants[n].value) for n, (form, _) in PRINTED.items()}
    assert shown == {name: printed for name, (_, printed) in PRINTED.items()}


def test_it_says_that_eq_12_does_not_determine_the_back_emf_constant() -> None:
    found = physical_constants(GREY_BOX, EQ_12, TABLE_1)
    assert [w.split(":")[0] for w in found.warnings] == [
        "the data do not determine back_emf_constant"
    ]
    gain, s2, s1, s0 = EQ_12
    moved = grey_box(gain, s2, 1.01 * s1, s0)["back_emf_constant"]
    before = grey_box(*EQ_12)["back_emf_constant"]
    share = 100.0 * abs(moved / before - 1.0)
    assert 75.0 < share < 90.0
    assert f"1 % in coefficient s1 moves it by {share:.0f} %" in found.warnings[0]


def test_precise_coefficients_determine_every_constant_and_tell_the_conditioning() -> None:
    precise = physical_constants(GREY_BOX, EQ_12, TABLE_1, np.diag((1e-4 * np.array(EQ_12)) ** 2))
    assert all(c.determined for c in precise.constants.values())
    assert [w.split(":")[0] for w in precise.warnings] == ["back_emf_constant is ill-conditioned"]
    rough = physical_constants(GREY_BOX, EQ_12, TABLE_1, np.diag((1e-2 * np.array(EQ_12)) ** 2))
    assert [c.name for c in rough.constants.values() if not c.determined] == ["back_emf_constant"]


positive = st.floats(0.2, 5.0)


@given(st.tuples(*[positive] * 7))
def test_constants_come_back_from_the_coefficients_of_eq_9(factors: tuple[float, ...]) -> None:
    base = (5.0, 0.08, 3630.0, 30.0, 7e-7, 2.7e-4, 1.1)
    true = Constants(*(f * b for f, b in zip(factors, base)))
    gain, (_, s2, s1, s0) = true.equation_9()
    known = dict(zip(GREY_BOX.known, (true.r, true.j, true.k_s)))
    found = physical_constants(GREY_BOX, (gain, s2, s1, s0, 1e-3), known)
    expected = {
        "torque_constant": true.k_t,
        "inductance": true.l,
        "friction_coefficient": true.k_f,
    }
    for name, value in expected.items():
        assert found.constants[name].value == pytest.approx(value, rel=1e-8)
    # K_b is the small rest of large terms: its error is measured by theirs
    terms = s1 * true.j * true.l / true.k_t
    assert abs(found.constants["back_emf_constant"].value - true.k_b) < 1e-12 * terms
    assert found.estimates[GREY_BOX.delay] == (1e-3, None)


def test_the_covariance_agrees_with_a_draw_of_many_coefficients() -> None:
    rng = np.random.default_rng(3)
    mean = np.array([*EQ_12, EQ_12_DELAY])
    mix = np.diag(1e-4 * mean) @ (np.eye(5) + 0.5 * rng.standard_normal((5, 5)))
    errors = {name: 2e-4 * TABLE_1[name] for name in GREY_BOX.known}
    found = physical_constants(GREY_BOX, mean, TABLE_1, mix @ mix.T, errors)
    drawn = []
    for _ in range(4000):
        point = mean + mix @ rng.standard_normal(5)
        known = {n: TABLE_1[n] + errors[n] * rng.standard_normal() for n in GREY_BOX.known}
        drawn.append(grey_box(*map(float, point[:4]), **known))
    for name in drawn[0]:
        spread = float(np.std([d[name] for d in drawn]))
        assert found.estimates[name][1] == pytest.approx(spread, rel=0.06)


def test_the_rigs_are_what_lsim_says_of_eq_12() -> None:
    dt = 1e-4
    times = np.arange(0.0, 0.2, dt)
    voltage = np.where(times < 0.01, 0.0, np.where(times < 0.1, 25.0, -15.0))
    motor = model("torque_motor", "identified", {"end_stops.half_range": 0.0})
    angle = simulate(motor, times, {"voltage": voltage})["angle"]
    late = np.concatenate([np.zeros(11), voltage[:-11]])
    gain, *poles = EQ_12
    _, expected, _ = lsim(([gain], [1.0, *poles]), late, times, interp=False)
    assert np.max(np.abs(angle - expected)) < 1e-6 * np.max(np.abs(expected))


def test_another_actuator_may_have_a_grey_box_of_its_own() -> None:
    """k / (T s + 1) from gain / (s + s0), T known to be as it is."""
    box = GreyBox("u", "y", ("gain", "s0"), ("lag",), lambda b, a, lag: {"k": b * lag, "x": a}, "d")
    found = physical_constants(box, (2.0, 3.0), {"lag": 0.5}, np.diag((0.01, 0.04)), {"lag": 0.1})
    # by hand: var k = lag^2 var b + b^2 var lag
    assert found.estimates["k"] == pytest.approx((1.0, (0.25 * 0.01 + 4.0 * 0.01) ** 0.5))
    assert found.estimates["x"] == pytest.approx((3.0, 0.2))


@pytest.fixture(scope="module")
def study() -> ModuleType:
    path = Path(__file__).parents[2] / "studies" / "grey_box.py"
    spec = importlib.util.spec_from_file_location("grey_box", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


RIGS = 12
RARE = 1e-5


@pytest.mark.long
@pytest.mark.parametrize("coloured", [False, True], ids=["white", "coloured"])
def test_intervals_cover_the_truth_of_simulated_rigs(study: ModuleType, coloured: bool) -> None:
    """Errors over standard errors are standard normal, so their squares sum to chi square."""
    every = [study.deviations(study.rig(500 + k, coloured)) for k in range(RIGS)]
    for key in every[0]:
        total = sum(one[key][0] ** 2 for one in every)
        assert chi2.ppf(RARE, RIGS) < total < chi2.ppf(1.0 - RARE, RIGS), key
