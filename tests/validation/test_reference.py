"""The references themselves, against closed forms and laws."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from servo_models.core.types import Array
from servo_models.validation import solvers
from servo_models.validation.sg90 import reference as sg90
from servo_models.validation.sg90.reference import ServoBacklash
from servo_models.validation.solvers import Exit, Key, LinearSystem, Regime, Values, follow
from servo_models.validation.torque_motor import reference as torque_motor
from servo_models.validation.torque_motor.reference import MotorBacklash, TwoMasses

TABLE_1 = torque_motor.TABLE_1


def held(times: Array, **values: float | Array) -> dict[str, Array]:
    rest = {"pulse_width": 1.5e-3, "load_torque": 0.0, "supply_voltage": 5.0, "voltage": 0.0}
    return {name: np.broadcast_to(v, times.shape) * 1.0 for name, v in {**rest, **values}.items()}


def test_edges_keep_changes_only_and_come_later_by_the_delay() -> None:
    times = np.array([0.0, 1.0, 2.0, 3.0])
    values = np.array([5.0, 5.0, 7.0, 5.0])
    assert solvers.changes(times, values) == [(0.0, 5.0), (2.0, 7.0), (3.0, 5.0)]
    assert solvers.changes(times, values, delay=0.5, rest=1.0)[:2] == [(0.0, 1.0), (0.5, 5.0)]


def test_sampler_sees_an_edge_at_the_next_tick() -> None:
    edges = [(0.0, 1.0), (0.021, 2.0), (0.06, 3.0)]
    assert solvers.sampled(edges, 0.02, 0.1) == [(0.0, 1.0), (0.04, 2.0), (0.06, 3.0)]


def test_linear_system_is_a_delayed_first_order_step_with_a_load() -> None:
    system = LinearSystem.of([[-2.0]], [[2.0, -2.0]], [[1.0]], [[0.0, 0.0]])
    times = np.linspace(0.0, 3.0, 61)
    out = system.response(times, [[(0.0, 0.0), (0.33, 1.0)], [(0.0, 0.0), (1.07, 0.5)]])[:, 0]
    late = np.clip(times - 0.33, 0.0, None), np.clip(times - 1.07, 0.0, None)
    expected = -np.expm1(-2.0 * late[0]) + 0.5 * np.expm1(-2.0 * late[1])
    np.testing.assert_allclose(out, expected, atol=1e-14)


def test_equation_7_by_transfer_function_and_by_elements_agree() -> None:
    times = np.linspace(0.0, 20.0, 101)
    columns = held(times, pulse_width=2e-3)
    by_elements = sg90.Linear()(times, columns)["angle"]
    by_transfer = sg90.equation_7_response(times, columns)["angle"]
    np.testing.assert_allclose(by_elements, by_transfer, atol=1e-13)
    natural = math.sqrt(633.3 * 7.47 / 24.0 * 0.1 * 0.025)
    damping = 1.307 / (2.0 * natural)
    damped = natural * math.sqrt(1.0 - damping**2)
    swing = np.cos(damped * times) + damping * natural / damped * np.sin(damped * times)
    closed = math.radians(50.0) * (1.0 - np.exp(-damping * natural * times) * swing)
    np.testing.assert_allclose(by_elements, closed, atol=1e-13)


def test_equation_12_is_its_partial_fractions() -> None:
    times = np.linspace(0.0, 0.2, 201)
    columns = held(times, voltage=40.0)
    gain, poles = torque_motor.EQ_12
    roots = np.roots(poles)
    late = np.clip(times - 0.0011, 0.0, None)
    closed = np.full(times.shape, gain / poles[-1], dtype=complex)
    for root in roots:
        others = np.prod([root - other for other in roots if other != root])
        closed += gain / (root * others) * np.exp(root * late)
    expected = 40.0 * np.real(closed)
    for reference in (torque_motor.Equation12(), torque_motor.Linear(torque_motor.IDENTIFIED)):
        np.testing.assert_allclose(reference(times, columns)["angle"], expected, atol=1e-12)


def test_constants_of_equation_12_give_it_back_through_equation_9() -> None:
    gain, poles = torque_motor.IDENTIFIED.equation_9()
    assert gain == pytest.approx(241560.0, rel=1e-12)
    assert poles == pytest.approx(torque_motor.EQ_12[1], rel=1e-12)


class Ball:
    """A ball that falls from 1 m under 10 m/s^2 and loses half of its speed at the ground."""

    start: Sequence[float] = (1.0, 0.0)
    scale: Sequence[float] = (1.0, 5.0)
    longest_step = 0.05

    def enter(self, x: Array, u: Values) -> tuple[Key, Array]:
        return "flight", x

    def regime(self, key: Key, u: Values) -> Regime:
        bounce = Exit(lambda x: float(x[0]), 1.0, lambda x: (key, np.array([0.0, -0.5 * x[1]])))
        return Regime(lambda x: (x[1], -10.0), (bounce,))

    def outputs(self, key: Key, x: Array, u: Values) -> Sequence[float]:
        return float(x[0]), float(x[1])


def test_events_are_located() -> None:
    impact = math.sqrt(0.2)
    times = np.array([0.0, 0.3, impact + 0.1, 2.0 * impact + 0.07])
    heights = follow(Ball(), times, [[(0.0, 0.0)]])[:, 0]
    speed = 5.0 * impact
    expected = [1.0, 0.55, speed * 0.1 - 0.05, 0.5 * speed * 0.07 - 5.0 * 0.07**2]
    np.testing.assert_allclose(heights, expected, atol=1e-10)


def test_printed_servo_follows_its_exponential_on_the_first_piece() -> None:
    """With the frame taken at 0 and the motor on its line, the loop is linear until 0.5 V."""
    times = np.linspace(0.0, 0.5, 51)
    got = sg90.Printed()(times, held(times, pulse_width=2e-3))
    command = 5.0 / 1024.0 * math.floor(0.5 / (5.0 / 1024.0))
    system = LinearSystem.of(
        [[0.0, 1.0 / 24.0], [-1.307 * 425.64 * 7.47 * 0.1 * 0.025, -1.307]],
        [[0.0], [1.307]],
        [[1.0, 0.0]],
        [[0.0]],
    )
    drive = 106.76 + 425.64 * (7.47 * (command - 0.375) - 0.6)
    expected = np.radians(system.response(times, [[(0.0, drive)]])[:, 0])
    assert got["motor_voltage"][-1] > 0.6
    np.testing.assert_allclose(got["angle"], expected, atol=1e-11)


def test_printed_servo_reaches_its_top_speeds_and_limits() -> None:
    times = np.linspace(0.0, 8.0, 401)
    pulses = np.where(times < 3.99, 0.5e-3, 2.4e-3)
    got = sg90.Printed()(times, held(times, pulse_width=pulses))
    lag = 1.0 - math.exp(-1.307 * 0.5)
    assert got["motor_speed"][25] == pytest.approx(-544.0 * lag, rel=1e-9)
    assert got["saturated"][25] == 1.0
    weak = sg90.Printed()(times, held(times, pulse_width=pulses, supply_voltage=0.7))
    assert np.max(np.abs(weak["motor_voltage"])) == pytest.approx(0.7)


def test_printed_servo_stays_inside_its_dead_zone() -> None:
    times = np.linspace(0.0, 2.0, 101)
    inside = held(times, pulse_width=(0.375 + 0.5 / 7.47 - 5.0 / 1024.0) / 250.0)
    assert np.all(sg90.Printed()(times, inside)["angle"] == 0.0)


def test_servo_rests_on_its_stop_and_leaves_it() -> None:
    times = np.linspace(0.0, 20.0, 1001)
    pulses = np.where(times < 9.99, 2.4e-3, 1.0e-3)
    got = sg90.Printed(0.05)(times, held(times, pulse_width=pulses))
    at_stop = got["angle"] == math.radians(90.0)
    assert at_stop[450:500].all()
    assert np.all(got["rate"][at_stop] == 0.0)
    assert got["angle"][-1] < 0.0


FREE = torque_motor.Constants(k_t=1e-12, k_b=0.0, r=1.0, l=1.0, j=2e-6, k_f=0.0, k_s=1e-12)


def test_a_rotor_with_dry_friction_moves_as_two_parabolas_and_stands_still() -> None:
    times = np.linspace(0.0, 0.1, 1001)
    pull, dry, push_time = -0.01, 0.004, 0.02
    torque = np.where(times < push_time - 1e-9, pull, 0.0)
    got = torque_motor.Contact(FREE, friction=dry)(times, held(times, load_torque=torque))
    speed = (-pull - dry) / FREE.j * push_time
    stop_time = push_time + speed / (dry / FREE.j)
    way = 0.5 * speed * stop_time
    assert got["rate"][200] == pytest.approx(speed, rel=1e-9)
    assert np.all(got["rate"][times > stop_time] == 0.0)
    assert got["angle"][-1] == pytest.approx(way, rel=1e-9)


def test_friction_holds_what_it_can() -> None:
    times = np.linspace(0.0, 0.05, 51)
    contact = torque_motor.Contact(FREE, friction=0.004, excess=0.002, stribeck=5.0)
    assert np.all(contact(times, held(times, load_torque=0.0059))["angle"] == 0.0)
    assert contact(times, held(times, load_torque=0.0061))["angle"][-1] < 0.0


def test_impact_on_a_stop_is_inelastic_and_release_waits_for_the_torque() -> None:
    times = np.linspace(0.0, 0.05, 501)
    torque = np.where(times < 0.03 - 1e-9, -0.01, 0.01)
    contact = torque_motor.Contact(FREE, stop=0.05)
    got = contact(times, held(times, load_torque=torque))
    impact = math.sqrt(2.0 * 0.05 / (0.01 / FREE.j))
    before, after = times < impact, times > 0.03
    resting = ~before & ~after
    np.testing.assert_allclose(got["angle"][before], 2500.0 * times[before] ** 2, atol=1e-10)
    assert np.all(got["angle"][resting] == 0.05)
    assert np.all(got["rate"][resting] == 0.0)
    since = times[after] - 0.03
    back = np.maximum(0.05 - 2500.0 * since**2, -0.05)
    np.testing.assert_allclose(got["angle"][after], back, atol=1e-10)


def test_contact_without_contact_is_the_exact_linear_response() -> None:
    times = np.linspace(0.0, 0.2, 201)
    columns = held(times, voltage=30.0, load_torque=np.where(times > 0.1, 0.01, 0.0))
    exact = torque_motor.Linear(torque_motor.IDENTIFIED)(times, columns)
    followed = torque_motor.Contact(torque_motor.IDENTIFIED)(times, columns)
    for name, curve in exact.items():
        np.testing.assert_allclose(followed[name], curve, atol=1e-8 * np.max(np.abs(curve)))


def test_play_behind_the_motor_is_the_play_operator_on_its_path() -> None:
    times = np.linspace(0.0, 0.1, 2001)
    columns = held(times, voltage=30.0 * np.sign(np.sin(40.0 * math.pi * times + 1e-9)))
    width = math.radians(0.3)
    shaft = torque_motor.Linear(TABLE_1)(times, columns)["angle"]
    output, at = np.empty_like(shaft), 0.0
    for k, position in enumerate(shaft):
        at = min(max(at, position - width), position + width)
        output[k] = at
    got = MotorBacklash(TABLE_1, width)(times, columns)["angle"]
    np.testing.assert_allclose(got, output, atol=1e-4 * np.max(output))


def test_play_in_the_servo_keeps_between_its_ends_and_vanishes_with_its_width() -> None:
    times = np.linspace(0.0, 10.0, 201)
    columns = held(times, pulse_width=2e-3)
    exact = sg90.Linear()(times, columns)["angle"]
    tight = ServoBacklash(1e-7)(times, columns)["angle"]
    np.testing.assert_allclose(tight, exact, atol=1e-8)
    wide = ServoBacklash(2.0)(times, columns)
    assert np.all(wide["rate"][times < 0.1] == 0.0)
    assert np.max(np.abs(wide["angle"] - exact)) > math.radians(0.5)


def test_two_masses_resonate_where_they_should_and_rigidly_add() -> None:
    free = torque_motor.Constants(1.0, 0.0, 1.0, 1.0, 2e-6, 0.0, 0.0)
    both = TwoMasses(free, compliance=0.1, inertia=1e-6, damping=0.0).system()
    frequencies = np.sort(np.abs(np.linalg.eigvals(both.a)))
    assert frequencies[-1] == pytest.approx(math.sqrt(10.0 * (1e6 + 0.5e6)), rel=1e-9)
    times = np.linspace(0.0, 0.2, 101)
    columns = held(times, voltage=30.0)
    stiff = TwoMasses(TABLE_1, compliance=1e-5, inertia=1e-6, damping=1.0)(times, columns)
    heavier = torque_motor.Constants(
        **{**vars(TABLE_1), "j": TABLE_1.j + 1e-6},
    )
    rigid = torque_motor.Linear(heavier)(times, columns)["angle"]
    np.testing.assert_allclose(stiff["angle"], rigid, atol=1e-3 * np.max(rigid))
