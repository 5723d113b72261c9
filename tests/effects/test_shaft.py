"""Friction, loads, stops and compliance of a shaft against solved mechanics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import ellipk

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.plant import Placement, place
from servo_models.core.types import Array
from servo_models.effects.cogging import cogging
from servo_models.effects.constant_load import constant_load
from servo_models.effects.coulomb_friction import coulomb_friction
from servo_models.effects.end_stops import end_stops
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.presliding_friction import presliding_friction
from servo_models.effects.stribeck_friction import stribeck_friction
from servo_models.effects.viscous_friction import viscous_friction
from tests.support.bench import respond, shaft_bench

COULOMB = place("coulomb", coulomb_friction, "friction")
STRIBECK = place("stribeck", stribeck_friction, "friction")
VISCOUS = place("viscous", viscous_friction, "load")
PRESLIDING = place("presliding", presliding_friction, "load")
STOPS = place("stops", end_stops, "travel")
GRAVITY = place("gravity", gravity_load, "load")
COMPLIANCE: tuple[Placement, ...] = (
    place("gear_compliance", resonance_step, "internal_step"),
    place("gear_compliance", compliant_output, "angle", "rate", "load_rate"),
    place("gear_compliance", compliant_load, "load", "load_acceleration"),
)
TIMES = np.linspace(0.0, 2.0, 201)
"""One internal step of the bench, 1 ms, is a tenth of a communication step."""


@pytest.mark.parametrize("speed", [2.0, -2.0])
def test_sliding_mass_stops_after_v2_over_2a_and_stays(speed: float) -> None:
    level, inertia = 1.7, 0.8
    given = {"coulomb.level": level, "inertia": inertia}
    out = respond(shaft_bench(COULOMB, speed=speed), given, TIMES)
    stop = 2.0 * inertia / level
    t = np.minimum(TIMES, stop)
    exact = math.copysign(1.0, speed) * (2.0 * t - 0.5 * level / inertia * t**2)
    np.testing.assert_allclose(out["shaft_angle"], exact, atol=1e-9)
    assert np.all(out["shaft_speed"][stop + 1e-3 < TIMES] == 0.0)


@pytest.mark.parametrize("torque", [0.999, -0.999])
def test_mass_at_rest_sticks_below_the_level(torque: float) -> None:
    inputs = np.column_stack([np.full(len(TIMES), torque), np.zeros(len(TIMES))])
    out = respond(shaft_bench(COULOMB), {"coulomb.level": 1.0}, TIMES, inputs)
    assert np.all(out["shaft_speed"] == 0.0)
    assert np.all(out["shaft_angle"] == 0.0)


def test_mass_at_rest_slides_above_the_level() -> None:
    inputs = np.column_stack([np.full(len(TIMES), 1.5), np.zeros(len(TIMES))])
    out = respond(shaft_bench(COULOMB), {"coulomb.level": 1.0}, TIMES, inputs)
    np.testing.assert_allclose(out["shaft_angle"], 0.25 * TIMES**2, atol=1e-12)


def half_cycles(amplitude: float, offset: float, omega: float, times: Array) -> Array:
    """Spring and Coulomb friction: cosines about +/- offset, until a reversal lies inside."""
    angle, start, out = amplitude, 0.0, np.full(len(times), np.nan)
    while abs(angle) > offset:
        centre = math.copysign(offset, angle)
        here = (times >= start) & (times <= start + math.pi / omega)
        out[here] = centre + (angle - centre) * np.cos(omega * (times[here] - start))
        angle, start = 2.0 * centre - angle, start + math.pi / omega
    out[np.isnan(out)] = angle
    return out


def test_spring_with_coulomb_friction_loses_the_same_every_half_cycle() -> None:
    """Reversals and standstill are located, so they leave the method its fourth order."""
    omega, level = 12.0, 0.13 * 144.0
    exact = half_cycles(1.0, 0.13, omega, TIMES)
    assert exact[-1] == pytest.approx(-0.04)
    errors = []
    for step in (4e-3, 2e-3, 1e-3, 5e-4):
        plant = shaft_bench(COULOMB, step=step, angle=1.0)
        out = respond(plant, {"coulomb.level": level, "spring": 144.0}, TIMES)
        errors.append(np.abs(out["shaft_angle"] - exact).max())
        assert out["shaft_speed"][-1] == 0.0
    order = np.polyfit(np.log([4e-3, 2e-3, 1e-3, 5e-4]), np.log(errors), 1)[0]
    assert order > 3.5, errors
    assert errors[2] < 1e-8


def test_breakaway_needs_sliding_level_and_excess() -> None:
    given = {"coulomb.level": 1.0, "stribeck.excess": 0.4}
    for torque, moves in ((1.39, False), (1.41, True)):
        inputs = np.column_stack([np.full(len(TIMES), torque), np.zeros(len(TIMES))])
        out = respond(shaft_bench(COULOMB, STRIBECK), given, TIMES, inputs)
        assert (out["shaft_speed"][-1] > 0.0) == moves


def test_stribeck_curve_slows_the_mass_as_the_equation_says() -> None:
    given = {"coulomb.level": 0.3, "stribeck.excess": 0.4, "stribeck.speed": 0.1}
    out = respond(shaft_bench(COULOMB, STRIBECK, speed=2.0), given, TIMES)
    exact = solve_ivp(
        lambda _, v: -0.3 - 0.4 * np.exp(-((v / 1.0) ** 2)),
        (0.0, 2.0),
        [2.0],
        t_eval=TIMES,
        rtol=1e-11,
        atol=1e-12,
    ).y[0]
    assert exact[-1] > 0.0
    np.testing.assert_allclose(out["shaft_speed"], exact, atol=1e-9)


def test_friction_that_gives_takes_the_energy_of_its_law() -> None:
    """Dahl's: v^2 / 2 falls by the integral of level (1 - exp(-stiffness x / level)) on the way."""
    given = {"presliding.level": 0.4, "presliding.stiffness": 3.0, "presliding.speed": 1e9}
    out = respond(shaft_bench(PRESLIDING, speed=1.3), given, TIMES)
    x, v = out["shaft_angle"], out["shaft_speed"]
    assert v.min() > 0.5
    spent = 0.4 * x + 0.4**2 / 3.0 * np.expm1(-3.0 * x / 0.4)
    np.testing.assert_allclose(0.5 * v**2, 0.5 * 1.3**2 - spent, atol=1e-6)


def test_friction_that_gives_springs_back() -> None:
    """Moves far below level / stiffness are those of a spring, damped a little by its loop."""
    given = {"presliding.level": 4.0, "presliding.stiffness": 25.0, "presliding.speed": 1e9}
    out = respond(shaft_bench(PRESLIDING, speed=0.02), given, TIMES)["shaft_angle"]
    np.testing.assert_allclose(out, 0.02 / 5.0 * np.sin(5.0 * TIMES), atol=4e-4)


def test_friction_without_stiffness_creeps_by_its_speed() -> None:
    """v' = -level tanh(v / speed): sinh(v / speed) decays with level / speed."""
    given = {"presliding.level": 0.6, "presliding.stiffness": 0.0, "presliding.speed": 0.03}
    out = respond(shaft_bench(PRESLIDING, speed=1.0), given, TIMES)["shaft_speed"]
    exact = 0.3 * np.arcsinh(np.sinh(1.0 / 0.3) * np.exp(-2.0 * TIMES))
    np.testing.assert_allclose(out, exact, atol=1e-9)


def test_loaded_friction_decelerates_by_load_and_share_of_it() -> None:
    share = place("share", load_friction, "friction")
    constant = place("constant", constant_load, "load")
    given = {"share.coefficient": 0.25, "constant.torque": 0.4}
    out = respond(shaft_bench(share, constant, speed=3.0), given, TIMES)
    np.testing.assert_allclose(out["shaft_speed"], 3.0 - 0.5 * TIMES, atol=1e-12)


def test_viscous_friction_and_inertia_give_an_exponential() -> None:
    inertia = place("inertia_effect", load_inertia, "shaft_inertia")
    given = {"viscous.torque": 6.0, "inertia": 0.2, "inertia_effect.inertia": 0.3}
    out = respond(shaft_bench(VISCOUS, inertia, speed=1.0), given, TIMES)
    np.testing.assert_allclose(out["shaft_speed"], np.exp(-0.6 / 0.5 * TIMES), atol=1e-11)


def test_pendulum_swings_with_the_period_of_the_elliptic_integral() -> None:
    amplitude, torque = 2.0, 40.0
    period = 4.0 * ellipk(math.sin(0.5 * amplitude) ** 2) / math.sqrt(torque)
    times = period * np.linspace(0.0, 1.0, 5)
    out = respond(shaft_bench(GRAVITY, angle=amplitude), {"gravity.torque": torque}, times)
    expected = [amplitude, 0.0, -amplitude, 0.0, amplitude]
    np.testing.assert_allclose(out["shaft_angle"], expected, atol=1e-8)


def test_pendulum_under_torque_rests_where_gravity_balances_it() -> None:
    times = np.linspace(0.0, 20.0, 21)
    inputs = np.column_stack([np.full(21, 3.0), np.zeros(21)])
    given = {"gravity.torque": 5.0, "gravity.phase": 0.2, "viscous.torque": 20.0}
    out = respond(shaft_bench(GRAVITY, VISCOUS), given, times, inputs)
    assert out["shaft_angle"][-1] == pytest.approx(math.asin(3.0 / 5.0) - 0.2, abs=1e-8)


@pytest.mark.parametrize("further", [0, 1, 2, 3])
def test_cogging_keeps_the_energy(further: int) -> None:
    ripple = place("ripple", cogging, "load")
    given = {"ripple.torque": 0.5, "ripple.count": 12.0, "ripple.phase": 0.3}
    sines = [(0.5, 12.0, 0.3)]
    for k, (share, count, phase) in enumerate(
        [(0.4, 24.0, -1.0), (1.5, 7.0, 2.0), (0.2, 36.0, 0.0)]
    ):
        if k < further:
            sines.append((0.5 * share, count, phase))
            own = {"share": share, "count": count, "phase": phase}
            given |= {f"ripple.{key}_{k + 2}": value for key, value in own.items()}
    out = respond(shaft_bench(ripple, speed=1.0), given, TIMES)
    energy = 0.5 * out["shaft_speed"] ** 2
    for torque, count, phase in sines:
        energy -= torque / count * np.cos(count * out["shaft_angle"] + phase)
    assert np.ptp(out["shaft_speed"]) > 0.08
    np.testing.assert_allclose(energy, energy[0], atol=1e-8)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stop_is_inelastic_and_lets_go_when_the_torque_turns(side: float) -> None:
    times = np.linspace(0.0, 4.0, 401)
    torque = side * np.where(times < 2.0, 1.0, -1.0)
    inputs = np.column_stack([torque, np.zeros(401)])
    out = respond(shaft_bench(STOPS), {"stops.half_range": 0.5}, times, inputs)
    angle = side * out["shaft_angle"]
    free = times <= 1.0
    np.testing.assert_allclose(angle[free], 0.5 * times[free] ** 2, atol=1e-12)
    held = (times > 1.0 + 1e-9) & (times <= 2.0)
    assert np.all(angle[held] == 0.5)
    assert np.all(out["shaft_speed"][held] == 0.0)
    back = (times >= 2.0) & (times < 2.0 + math.sqrt(2.0) - 1e-3)
    expected = 0.5 - 0.5 * (times[back] - 2.0) ** 2
    np.testing.assert_allclose(angle[back], expected, atol=1e-12)
    assert np.all(angle[times > 2.0 + math.sqrt(2.0) + 1e-3] == -0.5)


def test_the_narrower_travel_counts() -> None:
    assert end_stops(0.0, half_range=0.5) == 0.5
    assert end_stops(0.3, half_range=0.5) == 0.3
    assert end_stops(0.7, half_range=0.5) == 0.5


def two_masses(
    damping: float,
    external: float,
    times: Array,
    speed: float,
    shaft: float = 0.5,
    load: float = 0.02,
) -> Array:
    """Shaft and load [kg m^2] on a spring of 200 N m/rad: exact on an even grid."""
    stiffness = 200.0
    drag = 2.0 * damping * math.sqrt(load * stiffness)
    a = np.zeros((5, 5))
    a[0, 1] = a[2, 3] = 1.0
    spring = np.array([stiffness, drag, -stiffness, -drag, 0.0])
    a[1], a[3] = -spring / shaft, spring / load
    a[3, 4] = -external / load
    state, step, out = np.array([0.0, speed, 0.0, 0.0, 1.0]), expm(a * times[1]), []
    for _ in times:
        out.append(state)
        state = step @ state
    return np.array(out)


TWIST = {"gear_compliance.compliance": 1.0 / 200.0, "gear_compliance.inertia": 0.02, "inertia": 0.5}


@pytest.mark.parametrize("damping", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("external", [0.0, 3.0])
def test_compliance_is_the_two_mass_system(damping: float, external: float) -> None:
    inputs = np.column_stack([np.zeros(len(TIMES)), np.full(len(TIMES), external)])
    given = {**TWIST, "gear_compliance.damping": damping}
    out = respond(shaft_bench(*COMPLIANCE, speed=2.0, step=5e-4), given, TIMES, inputs)
    exact = two_masses(damping, external, TIMES, speed=2.0)
    for column, name in enumerate(("shaft_angle", "shaft_speed", "angle", "rate")):
        error = np.abs(out[name] - exact[:, column]).max()
        assert error < 1e-5 * np.abs(exact[:, column]).max(), name


@pytest.mark.parametrize(("shaft", "load"), [(0.5, 0.02), (0.005, 0.5)])
def test_the_internal_step_follows_a_stiff_gear(shaft: float, load: float) -> None:
    """The lighter side sets the resonance, which a step of 20 ms would not resolve."""
    masses = {"inertia": shaft, "gear_compliance.inertia": load, "gear_compliance.damping": 0.0}
    bench = shaft_bench(*COMPLIANCE, speed=2.0, step=20e-3)
    out = respond(bench, {**TWIST, **masses}, TIMES[:21])
    exact = two_masses(0.0, 0.0, TIMES[:21], speed=2.0, shaft=shaft, load=load)
    twist = exact[:, 0] - exact[:, 2]
    error = (out["shaft_angle"] - out["angle"]) - twist
    assert np.abs(error).max() < 1e-3 * np.abs(twist).max()


def test_compliant_gear_keeps_the_energy() -> None:
    given = {**TWIST, "gear_compliance.damping": 0.0}
    out = respond(shaft_bench(*COMPLIANCE, speed=2.0), given, TIMES)
    energy = (
        0.5 * 0.5 * out["shaft_speed"] ** 2
        + 0.5 * 0.02 * out["rate"] ** 2
        + 0.5 * 200.0 * (out["shaft_angle"] - out["angle"]) ** 2
    )
    np.testing.assert_allclose(energy, 0.5 * 0.5 * 4.0, rtol=2e-6)


@pytest.mark.parametrize("friction", [0.01, 0.05, 0.12])
def test_viscous_friction_calms_a_compliant_gear(friction: float) -> None:
    """It brakes the shaft that it turns with; on the far side it would feed the resonance."""
    times = np.linspace(0.0, 0.2, 2001)
    voltage = np.where(times < 0.1, 20.0, 0.0)
    ringing = []
    for level in (0.0, friction):
        given = {
            "end_stops.half_range": 0.0,
            "gear_compliance.compliance": 0.3,
            "gear_compliance.damping": 0.01,
            "viscous_friction.torque": level,
        }
        response = simulate(model("torque_motor", "measured", given), times, {"voltage": voltage})
        ringing.append(np.std(response["rate"][1200:]))
    assert ringing[1] < ringing[0]


@pytest.mark.parametrize("name", ["sg90", "torque_motor"])
def test_a_compliance_too_small_to_matter_is_rigid_and_costs_nothing(name: str) -> None:
    """A resonance that no step could follow would otherwise never end the first step."""
    times = np.linspace(0.0, 0.1, 51)
    bare, stiff = model(name), model(name, parameters={"gear_compliance.compliance": 1e-30})
    inputs = np.column_stack([np.full(51, float(w.rest)) for w in bare.plant.inputs])
    inputs[:, 0] = bare.actuator.step[1]
    assert np.array_equal(stiff.run(times, inputs), bare.run(times, inputs))


@pytest.mark.parametrize("unit", [math.pi / 180.0, 1.0])
def test_the_resonance_of_a_compliant_servo_does_not_hang_on_its_angle_unit(unit: float) -> None:
    """The load swings against the slow gearbox with 2 pi sqrt(compliance inertia)."""
    given = {
        "angle_unit": unit,
        "gear_compliance.compliance": 0.2,
        "gear_compliance.inertia": 1e-4,
        "gear_compliance.damping": 0.0,
    }
    times = np.arange(0.0, 0.3, 2e-4)
    rate = simulate(model("sg90", "linear", given), times, {"load_torque": 0.01})["rate"]
    turns = times[1:][np.diff(np.sign(rate)) > 0]
    expected = 2.0 * math.pi * math.sqrt(0.2 * 1e-4)
    assert np.mean(np.diff(turns)) == pytest.approx(expected, rel=0.05)
