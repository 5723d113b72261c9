"""The rigs of the second withheld study against laws of mechanics, and its figures by hand."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import servo_models as sm
from servo_models.data.description import read_description
from servo_models.errors import UserError
from servo_models.report.terminal import text
from servo_models.withheld.oracle import Diagnosed
from servo_models.withheld.rig.laws import CODE
from studies.second_plant import __main__ as command
from studies.second_plant import figures, rigs
from studies.second_plant.firmware import Firmware, Plant, Profile, run
from studies.second_plant.judge import Observed, sets_of
from studies.second_plant.mujoco_plant import MujocoPlant, engine
from studies.second_plant.two_mass import STEP, Drive, TwoMass

MOTOR = Drive(torque_constant=0.5, resistance=5.0, motor_inertia=3e-3, output_inertia=1e-3)
COASTING = replace(MOTOR, resistance=1e12)
TAU = (MOTOR.motor_inertia + MOTOR.output_inertia) * MOTOR.resistance / MOTOR.torque_constant**2
"""Time constant [s] of the motor with its output."""
Array = NDArray[np.float64]
Build = Callable[[Drive], Plant]


def _mujoco(drive: Drive) -> Plant:
    pytest.importorskip("mujoco")
    return MujocoPlant(drive)


both_engines = pytest.mark.parametrize("build", [TwoMass, _mujoco], ids=["two_mass", "mujoco"])


def angles(plant: Plant, voltage: float, seconds: float, every: float = 1e-3) -> Array:
    """The angle of the output, after each of some intervals under a voltage."""
    found = []
    for _ in range(round(seconds / every)):
        plant.advance(voltage, every)
        found.append(plant.angle())
    return np.array(found)


def test_two_free_masses_ring_as_the_closed_form_says() -> None:
    plant = TwoMass(replace(COASTING, contact=100.0, contact_damping=0.05))
    twist = 1e-3
    plant.state[:] = twist, 0.0, 0.0, 0.0
    times = 1e-4 * np.arange(1, 301)
    found = []
    for _ in times:
        plant.advance(0.0, 1e-4)
        found.append(plant.state[0] - plant.state[2])
    reduced = 1.0 / (1.0 / COASTING.motor_inertia + 1.0 / COASTING.output_inertia)
    stiffness = COASTING.output_inertia * (2.0 * math.pi * 100.0) ** 2
    damping = 2.0 * 0.05 * COASTING.output_inertia * 2.0 * math.pi * 100.0
    decay = damping / (2.0 * reduced)
    ringing = math.sqrt(stiffness / reduced - decay**2)
    exact = np.exp(-decay * times)
    exact *= np.cos(ringing * times) + decay / ringing * np.sin(ringing * times)
    assert np.allclose(found, twist * exact, rtol=0.0, atol=0.01 * twist)


def test_the_gear_keeps_the_momentum() -> None:
    plant = TwoMass(replace(COASTING, play=0.01))
    plant.state[:] = 0.0, 2.0, 0.0, -3.0
    inertias = np.array([COASTING.motor_inertia, COASTING.output_inertia])
    before = inertias @ plant.state[1::2]
    plant.advance(0.0, 0.5)
    assert inertias @ plant.state[1::2] == pytest.approx(before, rel=1e-9)
    assert abs(plant.state[0] - plant.state[2]) > 0.0


def test_energy_that_goes_in_is_stored_or_lost() -> None:
    drive = replace(
        MOTOR,
        motor_friction=0.02,
        output_friction=0.01,
        motor_drag=2e-3,
        output_drag=1e-3,
        gravity=0.05,
        contact_damping=0.0,
    )
    plant = TwoMass(drive)
    work = lost = 0.0
    for i in range(20_000):
        voltage = 4.0 if i < 12_000 else -3.0
        before = plant.state.copy()
        plant.advance(voltage, STEP)
        motor, output = 0.5 * (before[1::2] + plant.state[1::2])
        k = drive.torque_constant
        work += STEP * k * (voltage - k * motor) / drive.resistance * motor
        lost += STEP * (drive.motor_drag * motor**2 + drive.output_drag * output**2)
        lost += STEP * (drive.motor_friction * abs(motor) + drive.output_friction * abs(output))
    a_m, w_m, a_o, w_o = plant.state
    stiffness = drive.output_inertia * (2.0 * math.pi * drive.contact) ** 2
    stored = 0.5 * (drive.motor_inertia * w_m**2 + drive.output_inertia * w_o**2)
    stored += 0.5 * stiffness * (a_m - a_o) ** 2 + drive.gravity * (1.0 - math.cos(a_o))
    assert lost > 0.2 * work
    assert stored + lost == pytest.approx(work, rel=0.01)


@both_engines
def test_a_motor_comes_to_its_speed_in_its_time_constant(build: Build) -> None:
    found = angles(build(MOTOR), 5.0, 4.0 * TAU)
    times = 1e-3 * np.arange(1, len(found) + 1)
    exact = 5.0 / MOTOR.torque_constant * (times - TAU * (1.0 - np.exp(-times / TAU)))
    assert np.allclose(found, exact, rtol=0.0, atol=0.005 * exact[-1])


@both_engines
def test_a_limited_current_is_a_constant_torque_until_the_back_emf_takes_over(build: Build) -> None:
    volts, limit = 5.0, 0.2
    k, inertia = MOTOR.torque_constant, MOTOR.motor_inertia + MOTOR.output_inertia
    free = (volts - limit * MOTOR.resistance / k) / k  # speed from which the limit is not reached
    ends = free * inertia / limit
    found = angles(build(replace(MOTOR, torque_limit=limit)), volts, 3.0 * TAU)
    times = 1e-3 * np.arange(1, len(found) + 1)
    after = np.maximum(times - ends, 0.0)
    top, way = volts / k, 0.5 * limit / inertia * np.minimum(times, ends) ** 2
    way += top * after - (top - free) * TAU * (1.0 - np.exp(-after / TAU))
    assert 0.2 * times[-1] < ends < 0.8 * times[-1]
    assert np.allclose(found, way, rtol=0.0, atol=0.005 * way[-1])
    other = angles(build(replace(MOTOR, torque_limit=limit)), -volts, 3.0 * TAU)
    assert np.allclose(other, -found, rtol=0.0, atol=1e-6)


@both_engines
def test_below_its_level_dry_friction_holds(build: Build) -> None:
    level, per_volt = 0.06, MOTOR.torque_constant / MOTOR.resistance
    rubbing = replace(MOTOR, motor_friction=0.04, output_friction=0.02)
    held = angles(build(rubbing), 0.8 * level / per_volt, 0.3)
    assert np.abs(held).max() < CODE / 2.0
    moved = angles(build(rubbing), 2.0 * level / per_volt, 0.05)
    times = 0.05
    speed = level / MOTOR.torque_constant**2 * MOTOR.resistance  # of the torque beyond the level
    exact = speed * (times - TAU * (1.0 - math.exp(-times / TAU)))
    assert moved[-1] == pytest.approx(exact, rel=0.03)


def test_a_mass_that_sticks_stands_still() -> None:
    plant = TwoMass(replace(MOTOR, motor_friction=0.05, output_friction=0.05))
    plant.advance(0.4, 0.2)
    at = plant.state.copy()
    plant.advance(0.4, 0.2)
    assert plant.state[3] == 0.0
    assert np.array_equal(plant.state, at)


@both_engines
def test_a_reversal_is_lost_in_the_play(build: Build) -> None:
    """By momentum: until the motor is through, the output rests; then both move on together."""
    play = 0.02
    plant = build(replace(MOTOR, motor_friction=0.01, output_friction=0.06, play=play))
    angles(plant, 2.0, 0.2)
    angles(plant, 0.0, 0.3)
    rest = plant.angle()
    there = angles(plant, -2.0, 0.3, 2e-4)
    speed = 0.0  # of the motor alone, until it is through the play
    crossed, time = 0.0, 0.0
    while crossed < play:
        torque = MOTOR.torque_constant * (2.0 - MOTOR.torque_constant * speed) / MOTOR.resistance
        speed += 1e-5 * (torque - 0.01) / MOTOR.motor_inertia
        crossed += 1e-5 * speed
        time += 1e-5
    begun = 2e-4 * (1 + np.flatnonzero(there < rest - CODE / 2.0)[0])
    assert begun == pytest.approx(time, rel=0.15)


@both_engines
def test_an_arm_swings_with_its_own_frequency(build: Build) -> None:
    """It hangs at -phase, a tenth of a radian beside where it begins."""
    torque, phase = 0.2, 0.1
    inertia = COASTING.motor_inertia + COASTING.output_inertia
    period = 2.0 * math.pi * math.sqrt(inertia / torque)
    found = angles(build(replace(COASTING, gravity=torque, phase=phase)), 0.0, period)
    assert found[len(found) // 2] == pytest.approx(-2.0 * phase, rel=0.02)
    assert found[-1] == pytest.approx(0.0, abs=0.02 * phase)


def test_both_engines_say_the_same_of_a_loop_with_friction_and_gravity() -> None:
    pytest.importorskip("mujoco")
    drive = replace(
        MOTOR, motor_friction=0.02, output_friction=0.01, motor_drag=5e-3, gravity=0.05, phase=0.5
    )
    goals = np.repeat([0.0, 0.6, -0.3, 0.1], 100)
    loop = Firmware(0.9, 5.0, 1e-3, delay=7)
    one, other = (
        run(loop, plant, goals, 4, 200, np.random.default_rng(0))
        for plant in (TwoMass(drive), MujocoPlant(drive))
    )
    assert np.ptp(one) > 500
    assert np.sqrt(np.mean((one - other) ** 2.0)) < 1.0


def test_soft_friction_is_a_drag_at_low_speed() -> None:
    """Terminal speed of a drag of level / speed."""
    level, smooth = 0.3, 1.0
    plant = TwoMass(replace(MOTOR, motor_friction=level, smooth_speed=smooth))
    plant.advance(0.3, 2.0)
    slope = level / smooth + MOTOR.torque_constant**2 / MOTOR.resistance
    terminal = MOTOR.torque_constant / MOTOR.resistance * 0.3 / slope
    assert plant.state[1] == pytest.approx(terminal, rel=0.01)


def test_stribeck_friction_breaks_away_above_its_sliding_level() -> None:
    per_volt = MOTOR.torque_constant / MOTOR.resistance
    drive = replace(MOTOR, motor_friction=0.05, breakaway=1.5, stribeck_speed=0.2)
    held, loose = TwoMass(drive), TwoMass(drive)
    held.advance(0.07 / per_volt, 0.5)
    loose.advance(0.08 / per_volt, 0.5)
    assert abs(held.angle()) < CODE / 2.0
    assert loose.angle() > 100 * CODE


@dataclass
class Follower:
    """A plant whose angle is the voltage."""

    now: float = 0.0

    def angle(self) -> float:
        return self.now

    def advance(self, voltage: float, seconds: float) -> None:
        self.now = voltage


def test_a_goal_is_seen_as_many_ticks_late_as_the_bus_takes() -> None:
    """Voltages are codes here: at each tick goal - angle; five ticks a row of the log."""
    goals = CODE * np.array([0.0, 100.0, 100.0, 0.0])
    prompt, late = (
        run(Firmware(1.0, 1.0, 1e-3, delay), Follower(), goals, 1, 3, np.random.default_rng(0))
        for delay in (0, 2)
    )
    assert prompt.tolist() == [0, 0, 100, 0]
    assert late.tolist() == [0, 0, 0, 0]
    longer = np.concatenate([goals, goals[:2]])
    later = run(Firmware(1.0, 1.0, 1e-3, 2), Follower(), longer, 1, 3, np.random.default_rng(0))
    assert later[2:].tolist() == prompt.tolist()


def test_duty_has_a_limit_and_the_encoder_rounds() -> None:
    goals = np.full(4, 10.0)
    codes = run(Firmware(1.0, 2.6 * CODE, 1e-3), Follower(), goals, 1, 0, np.random.default_rng(0))
    assert codes.tolist() == [0, 3, 3, 3]


def test_duty_has_a_lower_limit_in_a_register() -> None:
    goals = np.array([0.0, 10.0, 10.0, -10.0, -10.0])
    loop = Firmware(1.0, 20.0 * CODE, 1e-3, duty_limit=0.25)
    codes = run(loop, Follower(), goals, 1, 0, np.random.default_rng(0))
    assert codes.tolist() == [0, 0, 5, 5, -5]


TICK = 1e-3
PROFILED = Firmware(1.0, 5.0, TICK, speed=2.0, acceleration_time=0.1)
ACCELERATION = PROFILED.speed / PROFILED.acceleration_time


def profiled(firmware: Firmware, goals: Array) -> Array:
    """The angles at the ticks of a profile."""
    profile = Profile(firmware)
    return np.array([profile.toward(float(goal)) for goal in goals])


@pytest.mark.parametrize("goal", [1.0, -0.3, 0.15, 0.05])
def test_a_profile_is_the_trapezoid_or_triangle_of_its_closed_form(goal: float) -> None:
    ticks = 900
    found = profiled(PROFILED, np.full(ticks, goal))
    size, times = abs(goal), TICK * np.arange(ticks)
    top = min(PROFILED.speed, math.sqrt(ACCELERATION * size))
    ramp, whole = top / ACCELERATION, size / top + top / ACCELERATION
    rising = 0.5 * ACCELERATION * times**2
    falling = size - 0.5 * ACCELERATION * (whole - times) ** 2
    between = 0.5 * top * ramp + top * (times - ramp)
    exact = np.where(times < ramp, rising, np.where(times < whole - ramp, between, falling))
    exact[times >= whole] = size
    near = ACCELERATION * TICK**2  # a ramp ends between two ticks
    assert np.allclose(found, math.copysign(1.0, goal) * exact, rtol=0.0, atol=near)
    assert found[-1] == goal


def test_a_profile_without_acceleration_time_is_a_limit_of_the_rate() -> None:
    firmware = replace(PROFILED, acceleration_time=0.0)
    goals = np.repeat([0.01, -0.02], 40)
    exact = np.minimum(2e-3 * np.arange(40), 0.01)
    exact = np.concatenate([exact, np.maximum(0.01 - 2e-3 * np.arange(40), -0.02)])
    assert np.allclose(profiled(firmware, goals), exact, rtol=0.0, atol=1e-12)


@given(st.lists(st.tuples(st.floats(-1.0, 1.0), st.integers(1, 300)), min_size=1, max_size=5))
def test_a_profile_keeps_its_limits_whenever_the_goal_moves(
    steps: list[tuple[float, int]],
) -> None:
    last = steps[-1][0]
    goals = np.concatenate([*(np.full(n, goal) for goal, n in steps), np.full(2500, last)])
    found = profiled(PROFILED, goals)
    speed = np.diff(found, prepend=0.0) / TICK
    assert np.abs(speed).max() <= PROFILED.speed * (1.0 + 1e-9)
    # an end is met from a mean speed of 1.5 steps by one of a step, also the other way
    assert np.abs(np.diff(speed)).max() <= 2.5 * ACCELERATION * TICK * (1.0 + 1e-9)
    assert found[-1] == last


@pytest.mark.parametrize("engine", rigs.ENGINES)
@pytest.mark.parametrize("limit", rigs.LIMITS)
def test_the_product_with_the_true_limit_follows_a_rig_within_a_code(
    engine: str, limit: str
) -> None:
    if engine == "mujoco":
        pytest.importorskip("mujoco")
    rng = np.random.default_rng(7)
    rig = rigs.build("one", engine, (limit,), {"noise": 0.0}, rng)
    while not rigs.binds(rig, limit):
        rig = rigs.build("one", engine, (limit,), {"noise": 0.0}, rng)
    loop = {"gain": 100.0, "sample_hold.period": rig.firmware.tick, **rig.true}
    every = rig.ticks * rig.firmware.tick
    right, without = [], []
    for goals, codes in zip(rig.goals, rig.codes()):
        inputs = {"goal": goals, "supply": np.full(len(goals), rig.firmware.supply)}
        for errors, effects in ((right, rig.effects), (without, {})):
            model = sm.model("smart_servo", "xl330", {**loop, **effects})
            found = sm.simulate(model, every * np.arange(len(goals)), inputs)["angle_reading"]
            errors.append(found / CODE - codes)
    left = float(np.sqrt(np.mean(np.concatenate(right) ** 2)))
    assert left < 1.0
    assert float(np.sqrt(np.mean(np.concatenate(without) ** 2))) > 4.0 * left


def test_without_mujoco_the_cure_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(UserError, match="pip install"):
        engine()


def test_a_rig_is_the_same_in_every_run_and_lies_within_what_its_owner_states() -> None:
    for number in range(40):
        one, again = rigs.draw(3, number), rigs.draw(3, number)
        assert one.answer() == again.answer()
        for name, value in one.true.items():
            off = (value / one.nominal[name] - 1.0) / rigs.UNCERTAINTY[name]
            assert abs(off) <= rigs.FARTHEST * (1.0 + 1e-12)


def test_its_owner_describes_it_and_reads_its_codes(tmp_path: Path) -> None:
    rig = rigs.six()[0]
    rigs.write(tmp_path / "study", [rig], lambda text, done, every: None)
    told = read_description(tmp_path / "study" / "cases" / rig.name / "description.toml")
    assert {it.path.name for it in told.logs} == set(rigs.LOGS)
    assert told.model.values["coulomb_friction.level"] == pytest.approx(
        rig.nominal["coulomb_friction.level"], rel=1e-5
    )
    assert told.model.values["backlash.half_width"] == 0.0
    codes = told.logs[0].outputs["angle_reading"] / CODE
    assert np.allclose(codes, np.round(codes), atol=1e-9)
    assert codes.max() > 100


def test_every_drawn_cause_is_in_the_drive_or_the_firmware() -> None:
    """And the parameters of effects are those of the physics."""
    for number in range(60):
        rig = rigs.draw(4, number)
        drive, near = rig.drive, rig.effects
        assert ("delay" in rig.causes) == (rig.firmware.delay > 0)
        assert ("play" in rig.causes) == (drive.play > 0.0)
        assert ("gravity" in rig.causes) == (drive.gravity > 0.0)
        assert ("viscous" in rig.causes) == (drive.motor_drag > 0.0)
        added = drive.motor_inertia + drive.output_inertia - rig.true["inertia"]
        assert near.get("load_inertia.inertia", 0.0) == pytest.approx(added, abs=1e-12)
        rubbed = drive.motor_friction + drive.output_friction
        known = {**rig.true, **near}.get("coulomb_friction.level", 0.0)
        assert known == pytest.approx(rubbed, abs=1e-12)
        if drive.play:
            behind = drive.output_inertia / (drive.motor_inertia + drive.output_inertia)
            assert near["coasting_backlash.share"] == pytest.approx(behind)
            own = near["coasting_backlash.friction_share"] * rubbed
            assert own == pytest.approx(drive.output_friction, abs=1e-12)


def test_limits_are_drawn_within_what_the_motor_can_do_and_bind() -> None:
    low, high = 0.25, 0.6
    for number in range(12):
        rig = rigs.draw(8, number, ("two_mass",), "limits")
        drive, loop = rig.drive, rig.firmware
        stall = drive.torque_constant * loop.supply / drive.resistance
        for on, share in (
            ("torque_limit" in rig.causes, drive.torque_limit / stall),
            ("duty_limit" in rig.causes, loop.duty_limit),
            (
                bool({"profile_speed", "profile_trapezoid"} & {*rig.causes}),
                loop.speed * drive.torque_constant / loop.supply,
            ),
        ):
            assert low <= share <= high if on else share in (0.0, 1.0)
        assert ("profile_trapezoid" in rig.causes) == (loop.acceleration_time > 0.0)
        if "play" in rig.causes:
            behind = drive.output_inertia / (drive.motor_inertia + drive.output_inertia)
            assert min(abs(behind - share) for share in rigs.SHARES) < 1e-9


def test_a_folder_gives_its_first_rigs_and_no_others(tmp_path: Path) -> None:
    three = [rigs.draw(3, number, ("two_mass",)) for number in range(3)]
    folder = tmp_path / "study"
    rigs.write(folder, three, lambda text, done, every: None)
    (folder / "code.txt").write_text(command.own_code(), encoding="utf-8")
    assert list(command._answers(folder, three[:2])) == ["0000", "0001"]
    with pytest.raises(UserError, match="other rigs"):
        command._answers(folder, three[1:])


def test_two_causes_are_named_by_one_set_of_each() -> None:
    assert set(sets_of(("inertia", "delay"))) == {
        frozenset({"load_inertia", "transport_delay"}),
        frozenset({"transport_delay"}),
    }
    assert sets_of(()) == [frozenset()]


def case(
    causes: str, verdict: str, named: str, separated: bool = True, behind: float = 0.3
) -> figures.Case:
    kinds = ("nothing", "one", "two")
    wrong, effects = causes.split(), named.split()
    answer = {
        "case": "1",
        "kind": kinds[len(wrong)],
        "engine": "two_mass",
        "causes": wrong,
        "drive": {"motor_inertia": 2.0 - 2.0 * behind, "output_inertia": 2.0 * behind},
    }
    chances = {name: 0.9 - 0.1 * i for i, name in enumerate(effects)}
    said = Diagnosed("1", verdict, 2.0, named=effects, chances=chances)
    return figures.Case(answer, said, Observed("1", separated=separated))


CASES = [
    case("delay", "effect", "transport_delay"),
    case("delay", "effects", "transport_delay viscous_friction"),
    case("play", "effect", "drive_lag"),
    case("play", "outside-catalogue", "backlash drive_lag", behind=0.02),
    case("inertia", "parameters", ""),
    case("friction_stiff", "effects", "coulomb_friction stribeck_friction", separated=False),
    case("delay play", "effects", "backlash transport_delay"),
    case("delay play", "effect", "transport_delay"),
    case("", "parameters", ""),
    case("", "effect", "backlash"),
]


def test_figures_counted_by_hand() -> None:
    found = {define.__name__: define(CASES) for define in figures.FIGURES}
    counted = {name: (one.value, one.n) for name, one in found.items()}
    assert counted["first_place"] == (pytest.approx(4 / 5), 5)
    assert counted["false_second"] == (pytest.approx(2 / 6), 6)
    assert counted["false_beside_true"] == (pytest.approx(1 / 6), 6)
    assert counted["both_named"] == (pytest.approx(1 / 2), 2)
    assert counted["false_of_two"] == (0.0, 2)
    assert counted["suspected"] == (pytest.approx(1 / 2), 2)
    assert counted["abstained"] == (pytest.approx(1 / 8), 8)
    assert counted["play_named"] == (pytest.approx(1 / 4), 4)
    assert counted["play_first"] == (pytest.approx(2 / 4), 4)
    by_share = figures.play_by_share(CASES)
    assert [(behind, it.value, it.n) for behind, it in by_share.items()] == [
        (0.02, 0.0, 1),
        (0.3, pytest.approx(1 / 3), 3),
    ]
    assert counted["separated"] == (pytest.approx(7 / 8), 8)


def test_a_rig_went_wrong_where_another_answer_was_due() -> None:
    assert [case.wrong for case in CASES] == [
        False, True, True, True, False, False, False, True, False, True
    ]  # fmt: skip


def test_the_report_tells_what_each_cause_was_taken_for() -> None:
    told = text(figures.report("a study", CASES))
    assert "transport_delay + viscous_friction 1" in told
    assert "outside (backlash + drive_lag) 1" in told
