"""Effects without memory against their formula in numpy, or the law behind them."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.block import Block
from servo_models.core.types import Array
from servo_models.effects.cogging import cogging
from servo_models.effects.constant_load import constant_load
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.direction_asymmetry import direction_asymmetry
from servo_models.effects.flux_saturation import flux_saturation
from servo_models.effects.gain_error import gain_error
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.nonlinearity import nonlinearity
from servo_models.effects.offset import offset
from servo_models.effects.quantisation import quantisation
from servo_models.effects.saturation import saturation
from servo_models.effects.supply_limit import supply_limit
from servo_models.effects.supply_sag import supply_sag
from servo_models.effects.torque_saturation import torque_saturation

U = np.concatenate([np.linspace(-3.0, 3.0, 241), [0.5, -0.5, 1e-300, -1e-300]])

FORMULAS: list[tuple[Block, dict[str, float], Callable[[Array], Array]]] = [
    (dead_zone, {"half_width": 0.5, "kept": 0.0}, lambda u: u - np.clip(u, -0.5, 0.5)),
    (dead_zone, {"half_width": 0.5, "kept": 1.0}, lambda u: np.where(abs(u) > 0.5, u, 0.0)),
    (saturation, {"limit": 1.2}, lambda u: np.clip(u, -1.2, 1.2)),
    (supply_limit, {"share": 0.4, "supply": 3.0}, lambda u: np.clip(u, -1.2, 1.2)),
    (supply_limit, {"share": 0.4, "supply": -3.0}, lambda u: np.clip(u, -1.2, 1.2)),
    (supply_limit, {"share": 1.0, "supply": 0.0}, lambda u: 0.0 * u),
    (gain_error, {"error": -0.3}, lambda u: 0.7 * u),
    (offset, {"value": -0.3}, lambda u: u - 0.3),
    (direction_asymmetry, {"ratio": 0.2}, lambda u: np.where(u > 0.0, 1.2 * u, 0.8 * u)),
    (
        nonlinearity,
        {"bow": 0.1, "cubic": -0.2, "full_scale": 2.0},
        lambda u: np.polyval([-0.2 / 4.0, 0.1 / 2.0, 1.0, 0.0], u),
    ),
    (torque_saturation, {"inverse_torque": 0.5}, lambda u: 2.0 * np.sin(np.arctan(u / 2.0))),
    (constant_load, {"torque": 0.7}, lambda u: u + 0.7),
    (
        gravity_load,
        {"torque": 0.7, "phase": 0.3, "angle": 0.9},
        lambda u: u + 0.7 * np.imag(np.exp(1.2j)),
    ),
    (
        cogging,
        {
            **{"torque": 0.7, "count": 12.0, "phase": 0.3, "shaft_angle": 0.1},
            **{"share_2": 0.5, "count_2": 24.0, "phase_2": -1.0},
            **{"share_3": 2.0, "count_3": 7.0, "phase_3": 2.0},
            **{"share_4": 0.0, "count_4": 36.0, "phase_4": 1.0},
        },
        lambda u: u + 0.7 * np.imag(np.exp(1.5j) + 0.5 * np.exp(1.4j) + 2.0 * np.exp(2.7j)),
    ),
]


@pytest.mark.parametrize(("effect", "given", "formula"), FORMULAS)
def test_formula(effect: Block, given: dict[str, float], formula: Callable[[Array], Array]) -> None:
    y = np.array([effect(u, **given) for u in U.tolist()])
    np.testing.assert_allclose(y, formula(U), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("effect", list({it.name: it for it, *_ in FORMULAS}.values()))
def test_an_effect_that_weakens_as_its_switch_grows_says_so(effect: Block) -> None:
    switches = [name for name, param in effect.params.items() if param.switch]
    wires = dict.fromkeys(effect.wires[1:], 0.3)
    others = {name: param.default for name, param in effect.params.items()}
    small, large = (
        max(
            abs(effect(u, **wires, **{**others, **dict.fromkeys(switches, size)}) - u)
            for u in U.tolist()
        )
        for size in (0.2, 0.4)
    )
    assert effect.hints.inverse == (small > large)


def test_quantisation_rounds_to_the_nearest_code() -> None:
    step = 5.0 / 1024.0
    y = np.array([quantisation(u, step=step, rounding=0.5) for u in U])
    codes = y / step
    assert np.array_equal(codes, np.rint(codes))
    assert np.max(np.abs(y - U)) <= 0.5 * step * (1 + 1e-12)


def test_quantisation_of_the_paper_truncates_to_1024_codes() -> None:
    step = 5.0 / 1024.0
    signal = np.linspace(0.0, 5.0, 20001)[:-1]
    y = np.array([quantisation(u, step=step, rounding=0.0) for u in signal.tolist()])
    assert len(np.unique(y)) == 1024
    assert np.all((signal - y >= 0.0) & (signal - y < step))


@pytest.mark.parametrize("step", [0.0, 1e-19, 1e-300, 5e-324])
def test_quantisation_finer_than_a_float_is_the_signal(step: float) -> None:
    """No overflow of the code, which numba keeps in 64 bits and Python does not."""
    assert quantisation(1.0 / 3.0, step=step, rounding=0.5) == pytest.approx(1 / 3, rel=1e-12)


@pytest.mark.parametrize("source", [0.0, 0.5, 20.0])
def test_supply_sag_is_the_voltage_divider(source: float) -> None:
    """A motor with back EMF e behind its resistance, fed through the source's resistance."""
    supply, emf, armature = 5.0, 1.4, 7.0
    exact = supply - source * (supply - emf) / (armature + source)
    stiff_current = (supply - emf) / armature
    sagged = supply_sag(
        supply,
        supply_current=stiff_current,
        supply_conductance=1.0 / armature,
        resistance=source,
    )
    assert sagged == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize(("inverse_current", "curvature"), [(50.0, 0.0), (0.0, 30.0), (50.0, 30.0)])
def test_flux_slopes_are_the_derivatives_of_one_flux(
    inverse_current: float, curvature: float
) -> None:
    inductance, turning = 30.0, 0.08

    def flux(i: complex, theta: complex) -> complex:
        bent = np.arctan(inverse_current * i) / inverse_current if inverse_current else i
        return complex(inductance * bent * (1.0 + curvature * theta**2) + turning * theta)

    i, theta, tiny = 0.013, 0.04, 1e-30
    slopes = flux_saturation(
        inductance,
        turning,
        current=i,
        shaft_angle=theta,
        inverse_current=inverse_current,
        curvature=curvature,
    )
    exact = (
        flux(i + tiny * 1j, theta).imag / tiny,  # the complex step has no cancellation
        flux(i, theta + tiny * 1j).imag / tiny,
    )
    assert slopes == pytest.approx(exact, rel=1e-13)


def at_rest(voltage: float, **parameters: float) -> float:
    """Final angle [rad] of the torque motor without stops."""
    names = {name.replace("__", "."): value for name, value in parameters.items()}
    chosen = model("torque_motor", "measured", {"end_stops.half_range": 0.0, **names})
    times = np.linspace(0.0, 0.5, 51)
    return float(simulate(chosen, times, {"voltage": voltage})["angle"][-1])


K_T, RESISTANCE, STIFFNESS = 6.432, 3630.0, 1.1


def test_null_shift_is_where_the_rotor_rests_without_current() -> None:
    assert at_rest(0.0, null_shift__angle=0.01) == pytest.approx(0.01, rel=1e-9)


def test_hardening_spring_rests_where_its_torque_is_the_motor_s() -> None:
    voltage, bend = 20.0, 300.0
    torque = K_T * voltage / RESISTANCE
    exact = brentq(lambda x: STIFFNESS * x * (1.0 + bend * x**2) - torque, 0.0, 0.1, xtol=1e-15)
    assert at_rest(voltage, stiffness_hardening__coefficient=bend) == pytest.approx(exact, rel=1e-9)


def test_saturated_torque_moves_less() -> None:
    voltage, largest = 20.0, 0.04
    torque = K_T * voltage / RESISTANCE
    exact = torque / math.hypot(1.0, torque / largest) / STIFFNESS
    angle = at_rest(voltage, torque_saturation__inverse_torque=1.0 / largest)
    assert angle == pytest.approx(exact, rel=1e-9)
