"""The audit against logs whose flaws are known, and against real ones with known figures."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array
from servo_models.data.audit import NO_NOISE, Audit, audits, noise_floors, noise_origins
from servo_models.data.log import Log
from servo_models.data.readers import read_columns
from servo_models.data.sensor import (
    NO_STEP,
    clipped_share,
    difference_noise,
    reading_step,
    spread_of_repeats,
    stale_share,
)
from tests.support import logs

PLANT = Plant((Wire("u", "V", "", low=-10.0, high=10.0),), (Wire("y", "rad", ""),), (), (), ("y",))
ENCODER = 2.0 * math.pi / 4096.0
seeds = st.integers(0, 2**32 - 1)


def log_of(times: Array, u: Array, y: Array, rows: Array | None = None) -> Log:
    numbers = np.arange(2, len(times) + 2) if rows is None else rows.astype(np.int64)
    return logs.log_of(times - times[0], {"u": u}, {"y": y}, rows=numbers)


def audited(times: Array, u: Array, y: Array) -> Audit:
    return audits([log_of(times, u, y)], PLANT)[0]


def said(found: Audit, words: str) -> bool:
    return any(words in warning for warning in found.warnings)


def smooth(n: int) -> Array:
    return np.asarray(np.sin(2.0 * np.pi * np.arange(n) / 400.0))


@settings(max_examples=30, deadline=None)
@given(
    st.floats(1e-6, 1e3), st.floats(-50.0, 50.0), st.floats(0.05, 4.0), st.integers(30, 3000), seeds
)
def test_the_step_of_a_quantised_reading_is_found(
    step: float, offset: float, noise: float, codes: int, seed: int
) -> None:
    random = np.random.default_rng(seed)
    raw = np.round(codes * smooth(6000) + noise * random.standard_normal(6000))
    found = reading_step(step * (raw + offset))
    assert found.size == pytest.approx(step, rel=1e-6)
    assert found.between == 0.0


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-6, 0.1), seeds)
def test_a_reading_without_steps_has_none_and_its_noise_is_found(sigma: float, seed: int) -> None:
    noisy = smooth(4000) + sigma * np.random.default_rng(seed).standard_normal(4000)
    assert reading_step(noisy) == NO_STEP
    curve = (2.0 * np.pi / 400.0) ** 3 / math.sqrt(20.0)  # what the third difference leaves
    # six standard deviations of the estimate, of 2.2 % each: draws are looked for that fail
    assert 0.86 * sigma < difference_noise(noisy) < 1.13 * sigma + 1.5 * curve


def test_a_step_printed_in_few_digits_is_found() -> None:
    printed = np.round(ENCODER * np.round(100.0 * smooth(3000)), 6)
    assert reading_step(printed).size == pytest.approx(ENCODER, rel=1e-4)


def test_readings_resampled_between_their_steps_are_noticed() -> None:
    codes = ENCODER * np.round(20.0 * smooth(2000))
    fine = np.interp(np.arange(0.0, 1999.0, 0.37), np.arange(2000), codes)
    found = reading_step(fine)
    off = np.abs(fine / ENCODER - np.round(fine / ENCODER)) > 0.1
    assert found.size == pytest.approx(ENCODER)
    assert found.between == pytest.approx(off.mean(), abs=0.01)
    u = np.sign(smooth(len(fine)))
    assert said(audited(0.01 * np.arange(len(fine)), u, fine), "resampled")


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-4, 1.0), st.floats(0.0, 0.1), st.integers(10, 480), st.integers(2, 50), seeds)
def test_jitter_and_gap_are_measured(
    step: float, jitter: float, row: int, lost: int, seed: int
) -> None:
    steps = step * (1.0 + jitter * np.random.default_rng(seed).uniform(-1.0, 1.0, 499))
    usual = np.delete(steps, row)
    steps[row] += lost * step
    times = np.concatenate([[0.0], np.cumsum(steps)])
    found = audited(times, smooth(500), smooth(500))
    assert found.sampling.step == pytest.approx(usual.mean(), rel=1e-9)
    assert found.sampling.jitter == pytest.approx(usual.std(), rel=1e-6, abs=1e-9 * step)
    (gap,) = found.sampling.gaps
    assert (gap.row, gap.length) == (row + 2, pytest.approx(steps[row]))
    assert said(found, f"after row {row + 2}")


def test_jitter_below_the_digits_of_the_time_stamps_is_no_fault_of_the_sampling() -> None:
    found = audited(np.round(0.0134 * np.arange(900), 3), smooth(900), smooth(900))
    assert found.sampling.stamp == pytest.approx(1e-3)
    assert found.sampling.jitter == pytest.approx(1e-3 * math.sqrt(0.4 * 0.6), rel=0.02)
    assert not said(found, "jitter")


def test_an_uneven_clock_is_a_warning() -> None:
    steps = 0.01 * np.random.default_rng(1).uniform(0.6, 1.4, 800)
    assert said(audited(np.cumsum(steps), smooth(800), smooth(800)), "jitters by 23%")


def test_a_clipped_reading_is_told_from_a_shaft_at_rest() -> None:
    command = 2.0 * smooth(2000)
    reading = np.clip(command, -1.5, 1.5)
    share = np.mean(np.abs(command) >= 1.5)
    assert clipped_share(reading, command[:, None], 1e-4) == pytest.approx(share, abs=0.005)
    square = np.sign(smooth(2000))
    settled = np.round(square * (1.0 - np.exp(-np.arange(2000) % 200 / 10.0)), 3)
    assert clipped_share(settled, square[:, None], 3e-4) == 0.0
    assert said(audited(0.01 * np.arange(2000), command, reading), "clipped")


def stuck(command: Array, band: float, jump: float) -> Array:
    """A valve with stiction: it rests until the command is half a band away, then slips.

    Source: Choudhury, Thornhill, Shah, Control Engineering Practice 13 (2005): stickband plus
    deadband S, slip jump J; between slip and the next stop it follows at (S - J) / 2.
    """
    position, moving, found = 0.0, 0, np.zeros(len(command))
    change = np.sign(np.diff(command, prepend=command[0]))
    for k in range(len(command)):
        if moving and change[k] != moving:
            moving = 0
        if not moving and abs(command[k] - position) > band / 2.0:
            moving = int(np.sign(command[k] - position))
        if moving:
            position = command[k] - moving * (band - jump) / 2.0
        found[k] = position
    return found


def stick_slip(command: Array, slack: float) -> Array:
    """A shaft that leaves each rest at once to where its command is, and rests again."""
    position, found = 0.0, np.zeros(len(command))
    for k in range(len(command)):
        if abs(command[k] - position) > slack:
            position = command[k]
        found[k] = position
    return found


def triangle(n: int, period: int) -> Array:
    return np.asarray(2.0 * np.abs(2.0 * ((np.arange(n) / period + 0.25) % 1.0) - 1.0) - 1.0)


@pytest.mark.parametrize("command", [triangle(2000, 400), 1.4 * smooth(2000) * smooth(6000)[::3]])
@pytest.mark.parametrize("band", [0.1, 0.3])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_reading_that_sticks_is_not_called_clipped(
    command: Array, band: float, noise: float
) -> None:
    step = 1e-3 if noise else 0.0
    for reading in (stuck(command, band, 0.3 * band), stick_slip(command, band)):
        if step:
            reading = step * np.round(reading / step)  # noqa: PLW2901
        assert clipped_share(reading, command[:, None], 1e-6 + step / math.sqrt(12.0)) == 0.0
        assert not said(audited(0.01 * np.arange(2000), command, reading), "extreme")


@pytest.mark.parametrize("command", [triangle(2000, 400), smooth(2000), triangle(2000, 90)])
@pytest.mark.parametrize("level", [0.5031, 0.8017])
def test_a_clipped_reading_is_told_whatever_the_command_is(command: Array, level: float) -> None:
    reading = np.clip(command, -1.0, level)
    share = np.mean(command >= level)
    assert clipped_share(reading, command[:, None], 1e-6) == pytest.approx(share, abs=0.005)
    sticking = np.clip(stuck(command, 0.1, 0.03), -1.0, level)
    assert clipped_share(sticking, command[:, None], 1e-6) > 0.5 * share


def test_readings_that_are_refreshed_every_second_row_are_noticed() -> None:
    fresh = 100.0 * smooth(1000)
    held = np.repeat(fresh[::2], 2)
    assert stale_share(fresh, 1e-6) == 0.0
    assert stale_share(held, 1e-6) > 0.48
    assert said(audited(0.01 * np.arange(1000), fresh / 20.0, held), "read less often")


def test_a_coarse_sensor_that_repeats_its_reading_is_not_read_less_often() -> None:
    fresh = 100.0 * smooth(1000)
    coarse = 0.1 * np.ptp(fresh)
    noise = 0.01 * coarse * np.random.default_rng(1).standard_normal(len(fresh))
    steps = coarse * np.round(fresh / coarse) + 0.02 * coarse * np.round(noise / (0.02 * coarse))
    assert not said(audited(0.01 * np.arange(1000), fresh / 20.0, steps), "read less often")


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-4, 2e-3), seeds)
def test_the_spread_of_repeated_commands_is_the_noise(sigma: float, seed: int) -> None:
    command = np.where(np.arange(4000) // 100 % 2, 1.0, 0.0)
    response = np.zeros(4000)
    for k in range(1, 4000):
        response[k] = response[k - 1] + 0.2 * (command[k - 1] - response[k - 1])
    noisy = response + sigma * np.random.default_rng(seed).standard_normal(4000)
    assert spread_of_repeats(noisy, command[:, None]) == pytest.approx(sigma, rel=0.1)


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-4, 2e-3), seeds)
def test_repeats_after_another_history_are_none(sigma: float, seed: int) -> None:
    """Play of 0.1: where a reading rests depends on the side that it came from."""
    random = np.random.default_rng(seed)
    goals = np.concatenate([random.permutation([0.0, 2.0, 1.0]) for _ in range(40)])
    goals = goals[np.diff(goals, prepend=-1.0) != 0.0]
    from_below = np.sign(np.diff(goals, prepend=-1.0))
    command, settled = np.repeat(goals, 50), np.repeat(goals - 0.05 * from_below, 50)
    noisy = settled + sigma * random.standard_normal(len(command))
    assert spread_of_repeats(noisy, command[:, None]) == pytest.approx(sigma, rel=0.15)


def test_a_delayed_actuator_that_turns_as_the_command_jumps_is_not_at_rest() -> None:
    """It drifts from side to side without noise, and pauses at either end for a few samples."""
    command = np.where(np.arange(4000) // 80 % 2, 1.0, 0.0)
    travel = np.clip(np.roll(command, 76) - 0.5, -0.02, 0.02).cumsum()
    drifting = travel - 1e-3 * np.arange(4000.0)
    smooth = np.convolve(drifting, np.full(20, 0.05), mode="same")
    assert spread_of_repeats(smooth, command[:, None]) is None


def test_commands_that_never_repeat_have_no_spread() -> None:
    ladder = np.repeat(np.arange(20.0), 50)
    assert spread_of_repeats(ladder, ladder[:, None]) is None


def test_the_floor_is_the_largest_part_and_of_several_logs_the_largest() -> None:
    n = 3000
    quiet = audited(0.01 * np.arange(n), smooth(n), 0.01 * np.round(100.0 * smooth(n)))
    random = np.random.default_rng(3)
    loud = audited(0.01 * np.arange(n), smooth(n), smooth(n) + 0.05 * random.standard_normal(n))
    assert quiet.readings[0].floor.quantum == pytest.approx(0.01 / math.sqrt(12.0))
    assert loud.readings[0].floor.origin == "fast residual"
    assert noise_floors([quiet, loud])["y"] == pytest.approx(0.05, rel=0.1)


def channelled(y: Array) -> Log:
    return log_of(0.01 * np.arange(len(y)), smooth(len(y)), y)


def test_values_between_codes_reject_a_step() -> None:
    """Three places of an encoder, met twice each, almost evenly apart; all else is between."""
    rng = np.random.default_rng(4)
    travel = ENCODER * np.unique(rng.integers(0, 4000, 60))
    rests = ENCODER * np.repeat([100.0, 1451.0, 2803.0], 2)
    for seed in range(20):
        values = np.random.default_rng(seed).permutation(np.concatenate([travel, rests]))
        assert reading_step(values).size in (0.0, pytest.approx(ENCODER, rel=1e-6))


def test_a_short_log_has_the_step_of_the_others_of_its_sensor() -> None:
    long = ENCODER * np.round(200.0 * smooth(2000))
    short = ENCODER * np.array([0.3, 7.3, 7.3, 0.3, 19.3, 7.3])
    alone, rest = audits([channelled(short)], PLANT)[0], ENCODER * np.full(50, 0.7)
    assert alone.readings[0].step == 0.0
    for found in audits([channelled(y) for y in (long, short, rest)], PLANT):
        assert found.readings[0].step == pytest.approx(ENCODER, rel=1e-6)


def test_one_odd_log_does_not_lift_the_floor_of_the_others() -> None:
    rng = np.random.default_rng(6)
    ys = [smooth(600) + sigma * rng.standard_normal(600) for sigma in (*[0.01] * 5, 0.5)]
    found = [audited(0.01 * np.arange(600), smooth(600), y) for y in ys]
    assert noise_floors(found)["y"] == pytest.approx(0.01, rel=0.25)
    assert noise_origins(found)["y"] == "fast residual"


def test_floors_of_logs_without_noise_do_not_depend_on_their_order() -> None:
    def ramp(size: float) -> Audit:
        return audited(0.01 * np.arange(400), smooth(400), size * np.linspace(0.0, 1.0, 400))

    for order in permutations([ramp(1.0), ramp(1e-3), ramp(1000.0)]):
        assert noise_floors(order) == {"y": pytest.approx(1e-3)}
        assert noise_origins(order) == {"y": NO_NOISE}


@pytest.mark.parametrize("share", [0.0, 0.1, 0.2, 0.34, 0.6, 2.0])
@pytest.mark.parametrize("codes", [4.0, 300.0])
def test_the_floor_is_what_readings_are_off_by(share: float, codes: float) -> None:
    """Noise before a rounding of 1: both count, in slow and in fast motion."""
    rng = np.random.default_rng(8)
    motion = codes * np.sin(2.0 * np.pi * np.arange(6000) / 900.0)
    read = np.round(motion + share * rng.standard_normal(6000))
    off = math.sqrt(float(np.mean((read - motion) ** 2)))
    found = audited(0.01 * np.arange(6000), motion, 0.1 * read)
    assert found.readings[0].floor.value == pytest.approx(0.1 * off, rel=0.15)


def test_the_command_tells_its_levels_reversals_clock_and_band() -> None:
    n, step = 8192, 0.005
    random = np.random.default_rng(5)
    held = np.repeat(random.integers(-3, 4, n // 4), 4).astype(float)
    found = audited(step * np.arange(n), held, held + 0.01 * random.standard_normal(n))
    (command,) = found.commands
    assert (command.levels, command.low, command.high) == (7, -3.0, 3.0)
    assert command.clock == pytest.approx(4 * step)
    turns = held[::4][np.concatenate([[True], np.diff(held[::4]) != 0.0])]
    assert command.reversals == np.count_nonzero(np.diff(np.sign(np.diff(turns))))

    t = step * np.arange(n)
    chirp = np.sin(2.0 * np.pi * (0.5 * t + 0.5 * 9.5 * t**2 / t[-1]))
    found = audited(t, chirp, chirp + 0.01 * random.standard_normal(n))
    assert found.commands[0].band == pytest.approx((0.4, 10.5), abs=0.5)


def test_a_command_at_the_actuators_limit_and_one_that_never_moves_are_warnings() -> None:
    t, y = 0.01 * np.arange(500), smooth(500)
    assert said(audited(t, np.clip(20.0 * y, -10.0, 10.0), y), "actuator's limit")
    assert said(audited(t, np.zeros(500), y), "something moves though no input ever changes")
    noise = 1e-3 * np.random.default_rng(2).standard_normal(500)
    assert said(audited(t, np.zeros(500), noise), "no input ever changes, and nothing moves")
    noise[250] = 0.1
    assert said(audited(t, np.zeros(500), noise), "no input ever changes, and nothing moves")


def test_an_input_that_is_the_same_in_a_whole_run_is_no_fault_beside_other_runs() -> None:
    t, y = 0.01 * np.arange(500), smooth(500)
    still, moving, step = (log_of(t, u, y) for u in (0.0 * y, y, 0.0 * y + 2.0))
    held = [replace(log, settle=1.0) for log in (still, step)]
    for beside in ([still, moving], [still, step], held):
        assert not any(said(found, "ever changes") for found in audits(beside, PLANT))
    assert all(said(found, "ever changes") for found in audits([still, still], PLANT))
    assert said(audited(t, y, 0.5 * np.round(2.0 * y)), "only 4 reading steps")


def test_few_digits_are_no_resampling() -> None:
    """Four significant digits of a noisy reading: finer steps below 0.1 and below 1 than above.

    Most lie on the 1e-4 of those from 0.1 to 1; enough for the warning do not (1 %).
    """
    noisy = 3.0 * smooth(4000) + 1e-2 * np.random.default_rng(8).standard_normal(4000)
    short = np.array([float(f"{value:.4g}") for value in noisy])
    found = audited(0.001 * np.arange(4000), np.sign(noisy), short)
    assert found.readings[0].between > 0.01
    assert found.warnings == ()


def test_a_switch_is_at_no_limit() -> None:
    """An input of 0 or 1 is always at one of its bounds."""
    t, y = 0.01 * np.arange(500), smooth(500)
    switch = Wire("u", "1", "", low=0.0, high=1.0, flag=True)
    found = audits([log_of(t, 1.0 * (t > 1.0), y)], replace(PLANT, inputs=(switch,)))[0]
    assert found.commands[0].at_limit == 0.0
    assert not said(found, "limit")


def test_a_clean_log_has_no_warning_and_knows_its_rest() -> None:
    u = np.repeat([0.0, 1.0, 0.0, 2.0], 250)
    y = np.repeat([0.0, 1.0, 0.0, 2.0], 250)
    y += 1e-3 * np.random.default_rng(7).standard_normal(1000)
    found = audited(0.01 * np.arange(1000), u, y)
    assert found.warnings == ()
    assert found.at_rest == pytest.approx(1.0, abs=0.02)


def real(path: Path, time: str | int, scale: float, u: str | int, y: str | int) -> Audit:
    columns = read_columns(path)
    times = scale * columns.numbers(time)
    return audits([log_of(times, columns.numbers(u), columns.numbers(y))], PLANT)[0]


def test_real_sg90_steps(logs_folder: Path) -> None:
    found = real(logs_folder / "sg90_steps" / "log.csv", 1, 1e-3, 2, 3)
    assert found.sampling.step == pytest.approx(13.4e-3, rel=5e-3)
    assert found.sampling.stamp == pytest.approx(1e-3)
    assert found.readings[0].step == pytest.approx(1.0)
    assert found.commands[0].changes == 52


def test_real_sg90_video(logs_folder: Path) -> None:
    found = real(logs_folder / "sg90_video" / "sg90_square180.csv", "t_s", 1.0, "cmd_rad", 3)
    assert 1.0 / found.sampling.step == pytest.approx(29.9, abs=0.05)
    assert found.commands[0].clock == pytest.approx(1.0, abs=0.05)
    assert found.readings[0].step == 0.0


@pytest.mark.parametrize("motion", ["multisine", "step_response", "velocity_ramp"])
@pytest.mark.parametrize("joint", ["rotation", "wrist_roll"])
def test_real_so101(logs_folder: Path, joint: str, motion: str) -> None:
    path = logs_folder / "so101" / f"{joint}-{motion}.csv"
    found = real(path, "time_s", 1.0, "command_rad", "position_rad")
    assert found.sampling.step == pytest.approx(20.06e-3, abs=5e-5)
    assert found.readings[0].step == pytest.approx(ENCODER, rel=1e-4)
    assert not said(found, "resampled")


def test_real_xl330_was_resampled(logs_folder: Path) -> None:
    path = sorted((logs_folder / "bam_xl330").glob("*.json"))[0]
    found = real(path, "timestamp", 1.0, "goal_position", "position")
    assert 1.0 / found.sampling.step == pytest.approx(200.0)
    assert found.readings[0].step == pytest.approx(ENCODER, rel=1e-6)
    assert said(found, "resampled")


def test_real_emps(logs_folder: Path) -> None:
    found = real(logs_folder / "emps" / "DATA_EMPS.mat", "t", 1.0, "qg", "qm")
    assert (found.sampling.samples, found.sampling.gaps) == (24841, ())
    assert found.sampling.step == pytest.approx(1e-3)


# Rest

SPEED = Plant(
    (Wire("u", "V", "", low=-10.0, high=10.0),), (Wire("y", "rad/s", ""),), (), (), ("y",)
)
SWITCHED_ON = 400  # of 4000 samples


@pytest.mark.parametrize(("plant", "speed"), [(PLANT, 0.2), (PLANT, 20.0), (SPEED, 20.0)])
def test_a_motor_at_speed_is_not_at_rest(plant: Plant, speed: float) -> None:
    """Its rate does not change, and its angle by less than its noise from sample to sample."""
    times = 1e-3 * np.arange(4000)
    since = np.maximum(times - times[SWITCHED_ON], 0.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(4000)
    motion = speed * since if plant is PLANT else speed * -np.expm1(-since / 0.01)
    log = log_of(times, np.where(since > 0.0, 5.0, 0.0), motion + noise)
    assert audits([log], plant)[0].at_rest == pytest.approx(SWITCHED_ON / 4000, abs=0.02)


def test_short_rests_count_whole() -> None:
    """Each of 20 ramps is followed by a rest as long."""
    times = 1e-3 * np.arange(4000)
    ramp = np.cumsum(np.where(times // 0.1 % 2 == 0, 0.01, 0.0))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(4000)
    found = audited(times, np.zeros(4000), ramp + noise)
    assert found.at_rest == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    ("gain", "asked"), [(1.0, False), (0.2, False), (math.radians(1.0), True), (0.03, True)]
)
def test_a_command_far_beyond_all_readings_is_asked_for_its_unit(gain: float, asked: bool) -> None:
    """As degrees read as radians go, or a column of something else; a slow servo does not."""
    plant = Plant((Wire("goal", "rad", ""),), (Wire("y", "rad", ""),), (), (), ("y",))
    times, goal = 0.01 * np.arange(2000), 30.0 * smooth(2000)
    reading = gain * np.roll(goal, 5) + 1e-3 * np.random.default_rng(4).standard_normal(2000)
    (audit,) = audits([logs.log_of(times, {"goal": goal}, {"y": reading})], plant)
    assert said(audit, "is it in another unit") is asked
    assert audit.commands[0].reach == pytest.approx(1.0 / gain, rel=0.05)
