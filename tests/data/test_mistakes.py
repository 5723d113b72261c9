"""Mistakes of logging are named; a log as it should be is not accused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import butter, filtfilt, lfilter

from servo_models.catalogue import model
from servo_models.core.plant import Plant
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log
from servo_models.data.mistakes import mistakes
from tests.support.logs import log_of

ROWS, INTERVAL = 1200, 2e-3
NOISE = 2e-3  # of a range of 1 rad
PLANT: Plant = model("smart_servo", "sts3215").plant


def record(seed: int = 0, noise: float = NOISE) -> tuple[Array, Array, Array]:
    """Times, a goal that steps, and the angle of a second-order lag that follows it, with noise."""
    random = np.random.default_rng(seed)
    times = INTERVAL * np.arange(ROWS)
    goal = np.repeat(random.uniform(-0.5, 0.5, 6), ROWS // 6)
    angle, rate = np.empty(ROWS), 0.0
    angle[0] = place = goal[0]
    for k in range(1, ROWS):
        rate += INTERVAL * (900.0 * (goal[k - 1] - place) - 42.0 * rate)
        place += INTERVAL * rate
        angle[k] = place
    return times, goal, angle + noise * random.standard_normal(ROWS)


def said(times: Array, goal: Array, angle: Array) -> list[str]:
    log: Log = log_of(times, {"goal": goal}, {"angle": angle})
    return list(mistakes(log, PLANT, {}))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_a_log_as_it_should_be_is_not_accused(seed: int) -> None:
    assert said(*record(seed)) == []


@given(st.floats(0.1, 2.0), st.floats(0.0, 1.0))
def test_a_reading_of_few_counts_neither_leaps_nor_stands_for_none(
    counts: float, phase: float
) -> None:
    times, step = 0.02 * np.arange(ROWS), 0.0015
    angle = step * np.round(0.5 + counts * np.sin(2.0 * np.pi * (0.3 * times + phase)))
    log = log_of(times, {"goal": np.zeros(ROWS)}, {"angle": angle})
    words = " ".join(map(str, mistakes(log, PLANT, {"angle": step})))
    assert "leaps" not in words
    assert "stands for no reading" not in words


def clipped(angle: Array) -> Array:
    low, high = np.min(angle), np.max(angle)
    return np.clip(angle, low + 0.2 * (high - low), high - 0.2 * (high - low))


def dead(angle: Array) -> Array:
    return np.where(np.arange(ROWS) < ROWS // 3, angle, angle[ROWS // 3])


def with_placeholders(angle: Array) -> Array:
    found = angle.copy()
    found[[100, 350, 351, 900]] = -999.0
    return found


def overflowing(angle: Array) -> Array:
    half = 0.8 * np.max(np.abs(angle - np.mean(angle)))
    return (angle - np.mean(angle) + half) % (2.0 * half) - half


def resampled(angle: Array) -> Array:
    rows = np.arange(ROWS)
    return np.interp(rows, rows[::6], angle[::6])


def averaged(angle: Array) -> Array:
    return np.asarray(np.convolve(np.pad(angle, 10, "edge"), np.full(21, 1.0 / 21.0), "valid"))


def filtered(angle: Array) -> Array:
    return np.asarray(filtfilt(*butter(2, 8.0 * 2.0 * INTERVAL), angle))


def wrapped(angle: Array) -> Array:
    return (8.0 * angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (clipped, "'angle' is clipped"),
        (dead, "'angle' is stuck"),
        (with_placeholders, "it stands for no reading"),
        (overflowing, "overflows, or it wraps"),
        (resampled, "runs in straight lines"),
        (wrapped, "wraps"),
        (averaged, "averaged over 21 rows"),
        (filtered, "filtered forwards and backwards"),
    ],
)
def test_what_a_reading_cannot_do_is_named(
    spoil: Callable[[Array], Array], words: str, seed: int
) -> None:
    times, goal, angle = record(seed)
    (text,) = said(times, goal, spoil(angle))
    assert words in text


def test_a_copy_of_the_command_is_named() -> None:
    times, goal, _ = record()
    (text,) = said(times, goal, 0.3 + 2.0 * goal)
    assert "'angle' is a copy of 'goal'" in text


def test_columns_that_are_swapped_are_named() -> None:
    times, goal, angle = record()
    (text,) = said(times, angle, goal)
    assert "their columns are swapped" in text


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_clipped_columns_that_are_swapped_are_swapped_first(seed: int) -> None:
    """The reading stands in the column of the command; what is clipped there is told second."""
    times, goal, angle = record(seed)
    swapped, ends = said(times, clipped(angle), goal)
    assert "their columns are swapped" in swapped
    assert "'angle' is clipped" in ends


def test_rows_that_are_there_twice_are_named() -> None:
    _, goal, angle = record()
    twice = INTERVAL * np.arange(2 * ROWS)
    (text,) = said(twice, np.repeat(goal, 2), np.repeat(angle, 2))
    assert "every row is there twice: keep one of each" in text


def test_two_runs_in_one_file_are_named_where_the_second_begins() -> None:
    _, goal, angle = record()
    cut, count = 1_100, 1_100 + ROWS
    joined = [np.concatenate([it[:cut], it]) for it in (goal, angle)]
    (text,) = said(INTERVAL * np.arange(count), *joined)
    assert "two runs were joined" in text
    assert f"in row {cut}," in text


def test_a_run_that_begins_elsewhere_with_the_largest_jump_of_its_command_is_named() -> None:
    """No answer: at other jumps the angle does not follow within a row."""
    _, goal, angle = record(2)
    joined = [np.concatenate([it[:1_100], it + 0.8]) for it in (goal, angle)]
    (text,) = said(INTERVAL * np.arange(1_100 + ROWS), *joined)
    assert "two runs were joined" in text


@pytest.mark.parametrize("poles", [1, 2])
@given(st.integers(0, 2**31))
@example(1_000_000)
@settings(max_examples=20, deadline=None)
def test_a_sensor_that_filters_is_not_accused(poles: int, seed: int) -> None:
    """Up to second order, as they do before they are read."""
    times, goal, angle = record(seed)
    assert said(times, goal, np.asarray(lfilter(*butter(poles, 0.2), angle))) == []


def test_a_simulation_without_noise_is_not_accused() -> None:
    times, goal, angle = record(noise=0.0)
    assert said(times, goal, angle) == []


@pytest.mark.parametrize("rows", [20, 40])
def test_an_answer_before_its_command_is_named(rows: int) -> None:
    times, goal, angle = record(4)
    late = np.concatenate([np.full(rows, goal[0]), goal[:-rows]])
    (text,) = said(times, late, angle)
    assert "before 'goal' jumps" in text
    assert "the command was logged late" in text


def test_a_drive_that_was_switched_off_is_named() -> None:
    times, goal, angle = record(5)
    off = 2 * ROWS // 3
    noise = NOISE * np.random.default_rng(6).standard_normal(ROWS)
    stands = np.where(np.arange(ROWS) < off, angle, angle[off] + noise)
    goal[off:] = np.where(np.arange(ROWS - off) % 200 < 100, -0.6, 0.6)
    (text,) = said(times, goal, stands)
    assert "the drive was switched off" in text


def test_an_answer_within_one_row_is_no_second_run() -> None:
    times, goal, _ = record()
    noise = NOISE * np.random.default_rng(7).standard_normal(ROWS)
    assert said(times, goal, goal + noise) == []


def recorded(seed: int) -> Log:
    """A log as a file gives it: with a column for its command as well."""
    times, goal, angle = record(seed)
    log = log_of(times, {"goal": goal}, {"angle": angle})
    return replace(log, channels={**log.channels, "goal": Channel("goal", "goal", "rad")})


def wrapped(log: Log) -> Log:
    """Where a turn ends, twice in the log."""
    angle = np.mod(log.outputs["angle"] * 4.0 * np.pi, 2.0 * np.pi)
    return replace(log, outputs={"angle": angle})


def overflowing(log: Log) -> Log:
    """A counter of 16 bits, 5e-5 rad each, that begins anew."""
    turned = np.mod(9.0 * log.outputs["angle"] + 1.6, 3.2768)
    return replace(log, outputs={"angle": turned})


def exchanged(log: Log) -> Log:
    goal, angle = log.inputs["goal"], log.outputs["angle"]
    return replace(log, inputs={"goal": angle}, outputs={"angle": goal})


def late(log: Log) -> Log:
    goal = np.concatenate([np.full(40, log.inputs["goal"][0]), log.inputs["goal"][:-40]])
    return replace(log, inputs={"goal": goal})


@pytest.mark.parametrize(
    ("spoil", "times_as_far"),
    [(wrapped, 4.0 * np.pi), (overflowing, 9.0), (exchanged, 1.0), (late, 1.0)],
)
def test_a_log_that_is_mended_is_the_one_before_the_mistake(
    spoil: Callable[[Log], Log], times_as_far: float
) -> None:
    """But for where it begins; how late a command is, the log says to a third only."""
    right = recorded(seed=3)
    (mistake,) = mistakes(spoil(right), PLANT, {})
    assert mistake.mended is not None
    mended = mistake.mended(spoil(right))
    apart = mended.outputs["angle"] - times_as_far * right.outputs["angle"]
    assert np.ptp(apart) < 0.02 * np.ptp(right.outputs["angle"]) * times_as_far
    wrong = mended.inputs["goal"] != right.inputs["goal"]
    assert wrong.mean() < 0.12


def test_commands_between_the_readings_stay_where_a_reading_is_mended() -> None:
    """Every third row is one of the command alone."""
    whole = recorded(seed=3)
    between = np.arange(ROWS) % 3 == 1
    angle = np.where(np.isin(np.arange(ROWS), [99, 360, 363, 900]), -999.0, whole.outputs["angle"])
    log = replace(whole, outputs={"angle": angle}, between=between, skipped=between)
    (mistake,) = mistakes(log.readings, PLANT, {})
    assert mistake.mended is not None
    mended = mistake.mended(log)
    assert np.array_equal(mended.counted, ~between & (angle != -999.0))


def test_nothing_is_asked_of_columns_that_have_been_checked() -> None:
    log = late(recorded(seed=3))
    for name in ("angle", "goal"):
        channels = {**log.channels, name: replace(log.channels[name], checked=True)}
        asked = [*mistakes(replace(log, channels=channels), PLANT, {})]
        assert bool(asked) is (name != "goal")
