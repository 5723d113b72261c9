"""Logs that begin anywhere: against exact solutions and the stated start."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.data.log import Log, Start
from servo_models.diagnosis.diagnose import diagnose
from servo_models.errors import UserError
from servo_models.identification.check import check
from servo_models.identification.fit import fit
from servo_models.identification.simulation import prepared
from servo_models.identification.starts import (
    _first_part,
    _is_another,
    false_statements,
    with_starts,
)
from servo_models.identification.transfer.measurements import Record
from tests.conftest import Run
from tests.support.exact_motor import STEP, TRUE, bench_log, nominal, prbs, rig
from tests.support.logs import changed, log_of, measured

SILENT = np.zeros(400)  # a free decay: no voltage
BEGIN = (0.0, 0.03, -2.0)  # current [A], angle [rad] and rate [rad/s]


def decay(noise: float = 0.0) -> Log:
    angle = rig(TRUE, SILENT, begin=BEGIN)
    return bench_log(SILENT, angle + noise * np.random.default_rng(5).standard_normal(len(angle)))


def given_start(log: Log) -> Log:
    return replace(log, start=Start({"angle": BEGIN[1], "rate": BEGIN[2]}))


def assumed(log: Log) -> Log:
    return replace(log, assumed=True)


def ends(model_values: dict[str, float], log: Log) -> float:
    """Largest error of the simulation [rad]."""
    run = prepared(nominal(), log)
    return float(np.abs(run.outputs(model_values)[:, 0] - log.outputs["angle"]).max())


def test_a_given_start_is_the_exact_decay() -> None:
    assert ends(TRUE, given_start(decay())) < 1e-6


def test_a_start_is_fitted_to_the_exact_decay() -> None:
    (found,) = with_starts(nominal(**TRUE), [assumed(decay(1e-4))])
    beginning = prepared(nominal(**TRUE), found).beginning
    assert beginning
    values = beginning.values(nominal(**TRUE).vector)
    # readings of 1e-4 rad of noise; the rate swings the shaft by 1.6e-3 rad for about 20 of them
    assert values["angle"] == pytest.approx(BEGIN[1], abs=2e-4)
    assert values["rate"] == pytest.approx(BEGIN[2], rel=0.05)
    assert "angle 1.7" in found.notes[0]  # deg


def test_a_decay_without_any_command_is_identified() -> None:
    """The search knows nothing of the start, and still gives what a given start gives."""
    log = decay(1e-4)
    names = ("stiffness", "friction_coefficient")
    begun = nominal(**{**TRUE, "stiffness": 1.3, "friction_coefficient": 4e-4})
    found = fit(begun, [assumed(log)], names)
    stated = fit(begun, [given_start(log)], names)
    for fitted, free, error in zip(found.values, found.free, found.standard_errors):
        assert abs(fitted - TRUE[free.name]) < 4.0 * error
    assert np.all(found.standard_errors < 2.0 * stated.standard_errors)


def test_a_standstill_still_tells_nothing() -> None:
    still = assumed(bench_log(SILENT, np.zeros(400)))
    with pytest.raises(UserError, match="no input ever changes"):
        fit(nominal(), [still], ("stiffness",))


def test_an_arm_that_is_let_go_tells_its_load_without_a_command() -> None:
    """A pendulum under its own weight: no input changes, and still the log is worth a fit."""
    true = model("smart_servo", "xl330", {"gravity_load.torque": 0.1, "gravity_load.phase": 1.2})
    times = np.arange(0.0, 1.0, 5e-3)
    off = {"enabled": np.zeros(len(times)), "goal": np.zeros(len(times))}
    log = assumed(measured(true, times, off, {"angle_reading": 1e-3}))
    begun = changed(true, {"gravity_load.torque": 0.13})
    found = fit(begun, [log], ("gravity_load.torque",))
    assert abs(found.values[0] - 0.1) < 4.0 * found.standard_errors[0] < 0.02


@pytest.mark.parametrize(("name", "command"), [("dc_motor", 6.0), ("dc_motor_current", 0.3)])
def test_a_step_in_row_0_sets_a_motor_at_rest_in_motion(name: str, command: float) -> None:
    """Taken as settled, it would have turned at full speed before."""
    true = model(name, "direct")
    times = np.arange(0.0, 1.0, 2e-3)
    inputs = {true.actuator.step[0]: np.full(len(times), command)}
    log = measured(true, times, inputs, {"encoder_angle": 0.01}, settle=true.stop_time)
    (found,) = with_starts(true, [assumed(log)])
    errors = prepared(true, found).outputs({})[:, 0] - log.outputs["encoder_angle"]
    assert np.sqrt(np.mean(errors**2)) < 0.011
    assert found.notes


def test_a_step_in_row_0_is_that_of_the_command_held_before() -> None:
    """The rig had held another voltage: with a delay that is not to start at an angle."""
    voltage = prbs(800, 4, hold=100, size=15.0)
    held, late = -0.8 * voltage[0], 8
    steady = held / TRUE["resistance"] * TRUE["torque_constant"] / TRUE["stiffness"]
    delayed = np.concatenate([np.full(late, held), voltage[:-late]])
    angle = rig(TRUE, delayed, begin=(held / TRUE["resistance"], steady, 0.0))
    noise = 1e-5 * np.random.default_rng(6).standard_normal(len(angle))
    log = replace(bench_log(voltage, angle + noise), assumed=True, settle=0.2)
    (found,) = with_starts(nominal(**TRUE), [log])
    assert found.start
    assert found.start.before["voltage"] == pytest.approx(held, abs=0.5)
    assert "held before" in found.notes[0]
    result = fit(nominal(**TRUE), [log], ("transport_delay.time",))
    assert result.values[0] == pytest.approx(late * STEP, abs=2e-5)


@pytest.mark.parametrize("name", ["sg90", "smart_servo", "torque_motor", "linear_drive"])
def test_a_start_at_rest_is_rest(name: str) -> None:
    """Zero angle and rate change no bit of a run."""
    chosen = model(name)
    assert chosen.shaft
    times = np.linspace(0.0, chosen.stop_time, 60)
    command, size = chosen.actuator.step
    log = log_of(times, {command: np.full(60, size)}, {chosen.plant.outputs[0]: np.zeros(60)})
    zero = dict.fromkeys((chosen.shaft.angle, chosen.shaft.rate), 0.0)
    placed = replace(log, start=Start(zero))
    np.testing.assert_array_equal(
        prepared(chosen, placed).simulate({}), prepared(chosen, log).simulate({})
    )


@pytest.mark.parametrize("name", ["sg90", "smart_servo", "torque_motor", "linear_drive"])
@given(share=st.floats(-0.5, 0.5), turning=st.floats(-0.2, 0.2))
@settings(max_examples=20, deadline=None)
def test_the_first_row_of_a_given_start_is_that_start(
    name: str, share: float, turning: float
) -> None:
    chosen = model(name)
    assert chosen.shaft
    wires, shaft = chosen.plant.wire, chosen.shaft
    motion = {
        shaft.angle: share * wires[shaft.angle].scale,
        shaft.rate: turning * wires[shaft.rate].scale,
    }
    times = np.linspace(0.0, 1e-3, 16)
    command, _ = chosen.actuator.step
    rest = np.full(16, float(wires[command].rest))
    log = log_of(times, {command: rest}, {name: np.zeros(16) for name in motion})
    first = prepared(chosen, replace(log, start=Start(motion))).outputs({})[0]
    np.testing.assert_allclose(first, list(motion.values()), rtol=1e-12, atol=1e-300)


def test_a_motor_that_spins_as_its_log_begins_is_found_in_motion() -> None:
    """It settles nowhere: where its encoder stands says nothing of how long it has turned."""
    true = model("dc_motor", "geared")
    times = np.arange(0.0, 3.5, 5e-4)
    voltage = np.where(times < 2.0, 1.5, 9.0 * np.sign(np.sin(4.0 * np.pi * times)))
    turned = simulate(true, times, {"voltage": voltage})["angle"]
    late = times > 1.99
    angle = turned[late] - turned[late][0]  # the encoder counts from here
    noise = 2e-3 * np.ptp(angle) * np.random.default_rng(7).standard_normal(len(angle))
    log = log_of(
        times[late] - times[late][0],
        {"voltage": voltage[late]},
        {"angle": angle + noise},
        settle=true.stop_time,
    )
    (found,) = with_starts(true, [assumed(log)])
    assert found.start
    errors = prepared(true, found).outputs({})[:, 0] - angle
    assert np.sqrt(np.mean(errors**2)) < np.std(noise)


def test_what_agrees_is_left_alone() -> None:
    voltage = prbs(800, 7)
    log = assumed(bench_log(voltage, rig(TRUE, voltage)))
    (found,) = with_starts(nominal(**TRUE), [log])
    assert found is log
    stated = given_start(decay())
    assert with_starts(nominal(), [stated]) == (stated,)


@pytest.mark.parametrize("lag", [0.0, 30e-3])
def test_a_log_of_a_rate_alone_begins_at_rest_only_where_that_is_far_better(lag: float) -> None:
    """A step in row 0 shows as a rate; a lag that the model lacks does not make it one."""
    chosen = model("sg90", "measured")
    times = np.arange(0.0, 2.0, 5e-3)
    pulse = np.where(times < 1.0, 1.9e-3, 1.2e-3)
    held = np.full(len(times), 1.9e-3)
    true = model("sg90", "measured", {"gyro_lag.time_constant": lag})
    inputs = {"pulse_width": pulse}
    stepped = simulate(true, times, inputs)["rate_reading"]
    settled = simulate(
        true, np.concatenate([times, 2.0 + times]), {"pulse_width": np.concatenate([held, pulse])}
    )["rate_reading"][len(times) :]
    for reading, begins_at_rest in ((stepped, True), (settled, False)):
        log = assumed(log_of(times, inputs, {"rate_reading": reading}, settle=1.0))
        (found,) = with_starts(chosen, [log])
        assert (found.settle == 0.0) == begins_at_rest
        assert (found is log) == (not begins_at_rest)


def test_rest_that_is_hardly_better_is_not_taken() -> None:
    """Most of the rate is neither: what is left has 0.85 times the squares of a settled start."""
    chosen = model("sg90", "measured")
    times = np.arange(0.0, 1.0, 5e-3)
    pulse = np.where(times < 0.5, 1.52e-3, 1.9e-3)
    rest = log_of(times, {"pulse_width": pulse}, {"rate_reading": np.zeros(len(times))})
    settled = replace(rest, settle=1.0)
    responses = [prepared(chosen, it).outputs({})[:, 0] for it in (rest, settled)]
    apart = responses[0] - responses[1]
    other = np.sin(40.0 * times)
    other -= apart * (apart @ other) / (apart @ apart)
    other *= np.linalg.norm(apart) / np.linalg.norm(other)
    reading = 0.6 * responses[0] + 0.4 * responses[1] + other
    log = assumed(replace(settled, outputs={"rate_reading": reading}))
    assert with_starts(chosen, [log]) == (log,)


def test_an_input_without_bounds_may_have_been_held() -> None:
    """As one of an own plant: its value before a step is found all the same."""
    chosen = nominal(**TRUE)
    free = tuple(replace(wire, low=None, high=None) for wire in chosen.plant.inputs)
    own = replace(chosen.actuator, plant=replace(chosen.plant, inputs=free))
    own = replace(own, variants=tuple(replace(it, plant=None) for it in own.variants))
    unbounded = model(own, "measured", {"end_stops.half_range": 0.0, **TRUE})
    voltage = prbs(800, 4, hold=100, size=15.0)
    held = -0.8 * voltage[0]
    steady = held / TRUE["resistance"] * TRUE["torque_constant"] / TRUE["stiffness"]
    angle = rig(TRUE, voltage, begin=(held / TRUE["resistance"], steady, 0.0))
    (found,) = with_starts(unbounded, [replace(assumed(bench_log(voltage, angle)), settle=0.2)])
    assert found.start
    assert found.start.before["voltage"] == pytest.approx(held, rel=0.01)


@pytest.mark.parametrize("text", ['start = "fit"', 'start = { angle = "1 deg" }'])
def test_a_transfer_function_refuses_a_start_that_it_would_ignore(
    tmp_path: Path, text: str
) -> None:
    (log,) = read_description(write_decay(tmp_path, text)).logs
    with pytest.raises(UserError, match=r"log 'log': .* 'start' .* \"rest\" or \"settled\""):
        Record.of(log, "voltage", "angle")


DECAY = """
actuator = "torque_motor"
variant = "measured"

[parameters]
end_stops.half_range = 0
stiffness = 1.1

[uncertainty]
friction_coefficient = "30 %"

[[logs]]
file = "log.csv"
time = { column = "t", unit = "s" }
inputs.voltage = "u"
outputs.angle = { column = "angle", unit = "rad" }
"""


def write_decay(folder: Path, more: str = "") -> Path:
    log = decay(1e-4)
    rows = zip(log.times, log.inputs["voltage"], log.outputs["angle"])
    text = "\n".join(f"{t:.6f},{u:.3f},{a:.9f}" for t, u, a in rows)
    (folder / "log.csv").write_text(f"t,u,angle\n{text}\n")
    (folder / "mine.toml").write_text(DECAY + more)
    return folder / "mine.toml"


@pytest.mark.thorough
def test_it_is_told_by_check_and_diagnose(tmp_path: Path) -> None:
    file = write_decay(tmp_path)
    (log,) = check(file).description.logs
    assert "every fit estimates" in log.notes[0]
    found = diagnose(file, jobs=1)
    assert found.verdict.kind in ("no-gap", "parameters")
    assert found.logs[0].notes == log.notes


@pytest.mark.thorough
def test_a_start_that_is_to_be_fitted_is(tmp_path: Path) -> None:
    """Asked for, it is fitted although nothing is known of it before."""
    found = diagnose(write_decay(tmp_path, 'start = "fit"'), jobs=1)
    (log,) = found.logs
    assert log.start is not None
    assert log.start.shaft["angle"] == pytest.approx(BEGIN[1], abs=2e-3)


@pytest.mark.parametrize(
    ("text", "settle", "start"),
    [
        ('start = "rest"', 0.0, None),
        ('start = "settled"', 0.1995, None),
        ('start = "settled"\nsettle = "50 ms"', 0.05, None),
        ('start = "fit"', 0.1995, Start(fitted=True)),
        (
            'start = { angle = "1 deg" }\nsettle = 0',
            0.0,
            Start({"angle": np.radians(1.0), "rate": 0.0}),
        ),
    ],
)
def test_a_description_says_how_a_log_begins(
    tmp_path: Path, text: str, settle: float, start: Start | None
) -> None:
    (log,) = read_description(write_decay(tmp_path, text)).logs
    assert log.settle == pytest.approx(settle)
    assert log.start == start
    assert not log.assumed
    (plain,) = read_description(write_decay(tmp_path)).logs
    assert plain.assumed


def stated(log: Log, start: Start | None, settle: float = 0.0) -> dict[str, str]:
    found = false_statements(nominal(**TRUE), [replace(log, start=start, settle=settle)])
    return {name: text for name, (text, _) in found.items()}


def at(angle: float, rate: float) -> Start:
    return Start({"angle": angle, "rate": rate})


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_stated_start_is_judged_by_the_first_readings(noise: float) -> None:
    log = decay(noise)
    assert stated(log, at(*BEGIN[1:])) == {}
    assert stated(log, Start(fitted=True)) == {}
    for wrong, words in (
        (None, "begins at rest"),
        (at(np.radians(1e9), 0.0), "by its 'start'"),
        (at(0.03, 60.0), "is at angle 1.72 deg and rate"),  # 0.03 rad at 1200 rad/s makes 37 rad/s
        (at(-0.03, -2.0), "is at angle"),
    ):
        text = stated(log, wrong)["rig"]
        assert "'rig' begins in another state than the model" in text
        assert words in text
        assert "angle 1.7" in text.partition("show")[2]


@pytest.mark.parametrize(("rate", "another"), [(36.0, False), (-36.0, True)])
def test_the_way_it_turns_is_part_of_a_start(rate: float, another: bool) -> None:
    begun = bench_log(SILENT, rig(TRUE, SILENT, begin=(0.0, 0.0, 36.0)))
    (shown,) = with_starts(nominal(**TRUE), [assumed(begun)])
    first, likely = (
        _first_part(nominal(**TRUE), log) for log in (replace(begun, start=at(0.0, rate)), shown)
    )
    assert _is_another(nominal(**TRUE), first[0], shown, likely) == another


@pytest.mark.parametrize("poor", [0.7, 1.0, 1.4])
def test_a_poor_model_makes_no_stated_start_wrong(poor: float) -> None:
    """A rig that rests, and one that settled at its first row, beside other stiffnesses."""
    voltage = np.repeat([0.0, 15.0, -5.0], 200)
    chosen = nominal(**{**TRUE, "stiffness": poor * TRUE["stiffness"]})
    at_rest = bench_log(voltage, rig(TRUE, voltage))
    held = np.repeat([12.0, -8.0, 5.0], 200)
    steady = held[0] / TRUE["resistance"] * TRUE["torque_constant"] / TRUE["stiffness"]
    angle = rig(TRUE, held, begin=(held[0] / TRUE["resistance"], steady, 0.0))
    settled = replace(bench_log(held, angle), settle=0.2)
    assert false_statements(chosen, [at_rest]) == {}
    assert false_statements(chosen, [settled]) == {}


def test_a_settled_log_that_is_stated_to_begin_at_rest_is_told() -> None:
    held = np.repeat([0.2, -0.1, 0.1], 100)
    chosen = model("second_order_servo", "bus", {"natural_frequency": 20.0})
    times = 0.005 * np.arange(300)
    run = simulate(chosen, np.r_[0.0, 2.0 + times], {"goal": np.r_[held[0], held]})
    angle = np.asarray(run["angle"])[1:]
    log = log_of(times, {"goal": held}, {"angle": angle})
    poor = model("second_order_servo", "bus", {"natural_frequency": 25.0})
    ((text, shown),) = false_statements(poor, [log]).values()
    assert "begins at rest" in text
    assert shown.settle > 0.0
    assert false_statements(poor, [replace(log, settle=1.0)]) == {}


def test_check_tells_a_false_start_and_no_unit(run: Run, tmp_path: Path) -> None:
    log = decay(1e-4)
    rows = np.column_stack([log.times, log.inputs["voltage"], log.outputs["angle"]])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,y", comments="")
    described = (
        'actuator = "torque_motor"\n[[logs]]\nfile = "log.csv"\ntime = "t"\n'
        'inputs.voltage = "u"\noutputs.angle = "y"\nstart = { rate = "0.05 rad/s" }\n'
        f"[parameters]\n{''.join(f'{name} = {value}' + chr(10) for name, value in TRUE.items())}"
    )
    (tmp_path / "log.toml").write_text(described)
    code, out, _ = run("check", tmp_path / "log.toml")
    assert code == 1
    assert "begins in another state" in out
    assert "would make sense" not in out
    assert "not scaled" not in out
