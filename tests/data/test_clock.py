"""Rounded time stamps against the clock that they were rounded from; lost rows stay lost."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array
from servo_models.data.arrays import describe as describe_arrays
from servo_models.data.audit import audits
from servo_models.data.clock import dithered, regular, stamped_late
from servo_models.data.description import Description
from servo_models.data.readers.columns import Columns, column_of
from servo_models.data.signals import Clock, read_clock
from servo_models.diagnosis.diagnose import diagnose
from servo_models.errors import UserError
from servo_models.identification.check import check
from tests.support import logs
from tests.support.descriptions import LOG, complaint, describe, text_of

MS = 1e-3
GAPPY = Plant((Wire("u", "V", ""),), (Wire("y", "rad", ""),), (), (), ("y",))
RATES = st.floats(0.3, 40.0)  # periods [ms]: several rows for a stamp up to many stamps for a row


def spread(times: Array, truth: Array) -> float:
    """Largest distance of two records of one clock, whatever their origin."""
    return float(np.ptp(times - truth)) / 2.0


@settings(max_examples=60, deadline=None)
@given(
    RATES,
    st.integers(100, 3000),
    st.floats(0.0, 1.0),
    st.sampled_from([np.round, np.floor]),
    st.sampled_from([0.0, 1.7e12]),
)
def test_rounded_stamps_of_an_even_clock_are_put_back(
    period: float, n: int, phase: float, rounding: np.ufunc, origin: float
) -> None:
    """Whatever the rounding, no time is off by more than the quantum, and none is a gap."""
    truth = period * np.arange(n) + phase
    stamps = rounding(truth)
    counts = np.unique(np.diff(stamps), return_counts=True)
    assume(len(counts[0]) > 1 and math.gcd(*map(int, counts[0])) == 1)
    assume(n - 1 - counts[1].max() >= 3)  # two odd steps may be lost rows
    assume(period < 0.7 or 0.9 < period < 0.98 or period > 1.05)
    grid = dithered(stamps + origin, MS)
    assert grid is not None
    assert grid.quantum == pytest.approx(MS)
    assert grid.period == pytest.approx(period * MS, abs=2.0 * MS / n)
    assert spread(grid.times, truth * MS) <= MS
    assert grid.correction <= 0.5 * MS * (1.0 + 1e-6)
    assert np.ptp(np.diff(grid.times)) < 1e-9


@settings(max_examples=40, deadline=None)
@given(st.floats(1.5, 30.0), st.integers(400, 3000), st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_lost_rows_stay_lost(period: float, n: int, gaps: int, seed: int) -> None:
    """With a period below 1.5 quanta a step of two is a usual one, or that of a lost row."""
    random = np.random.default_rng(seed)
    truth = period * np.arange(n) + random.uniform()
    kept = np.ones(n, dtype=bool)
    kept[np.linspace(60, n - 60, gaps).astype(int) + random.integers(-20, 20, gaps)] = False
    stamps = np.round(truth[kept])
    usual = np.diff(np.round(truth))
    assume(np.mean(usual != np.median(usual)) > 0.03)
    grid = dithered(stamps, MS)
    assert grid is not None
    long = np.flatnonzero(np.diff(grid.times) > 1.5 * grid.period)
    assert list(long) == list(np.flatnonzero(np.diff(truth[kept]) > 1.5 * period))
    assert spread(grid.times, truth[kept] * MS) <= MS


@pytest.mark.thorough
@settings(max_examples=30, deadline=None)
@given(st.floats(0.05, 0.5), st.integers(0, 2**32 - 1))
def test_a_clock_that_wanders_is_not_put_on_a_grid(jitter: float, seed: int) -> None:
    """Steps that are random add up to more than a quantum."""
    steps = 3.3 * (1.0 + jitter * np.random.default_rng(seed).uniform(-1.0, 1.0, 4000))
    assert dithered(np.round(np.cumsum(steps)), MS) is None


@settings(max_examples=30, deadline=None)
@given(st.floats(2.2, 20.0), st.floats(0.05, 0.45), st.integers(0, 2**32 - 1))
def test_rows_that_are_a_little_late_are_still_on_the_grid(
    period: float, late: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    truth = period * np.arange(2000)
    assume(abs(period - round(period)) > 0.01)
    grid = dithered(np.round(truth + late * random.uniform(-1.0, 1.0, 2000)), MS)
    assert grid is not None
    assert spread(grid.times, truth * MS) <= MS
    assert grid.correction <= (0.5 + late) * MS * 1.01


def test_a_clock_that_ticks_where_the_rounding_turns() -> None:
    random = np.random.default_rng(1)
    stamps = np.round(np.arange(5000) + 0.5 + 0.01 * random.standard_normal(5000))
    stamps = np.maximum.accumulate(stamps)
    assert np.count_nonzero(np.diff(stamps) == 0.0) > 100
    grid = dithered(stamps, MS)
    assert grid is not None
    assert grid.period == pytest.approx(MS)


def test_even_stamps_and_numbers_that_are_no_clock_are_left_alone() -> None:
    for stamps in (
        3.0 * np.arange(100.0),
        np.zeros(100),
        np.arange(10.0) // 2.0,
        np.cumsum(np.full(100, 1e300)),
        np.concatenate([np.arange(50.0), 1e12 + np.arange(50.0)]),
        1e-320 * np.arange(100),
    ):
        assert dithered(stamps, MS) is None


# in a description

PERIOD = 1.3  # [ms]; steps of 1 and 2 ms look like gaps
ROWS = 1500


def record(period: float = PERIOD, lost: int = 0) -> tuple[str, Array]:
    """Rows of a rig as a logger with stamps of 1 ms writes them, and their true times [s]."""
    rig, times = model("torque_motor", "measured"), period * MS * np.arange(ROWS)
    voltage = np.where(times < 0.1, 0.0, np.where(np.sin(20.0 * times) > 0.0, 20.0, -20.0))
    angle = simulate(rig, times, {"voltage": voltage})["angle"]
    angle = np.rad2deg(angle) + 0.02 * np.random.default_rng(2).standard_normal(ROWS)
    rows = list(zip(np.round(1e3 * times).astype(int), voltage, angle))
    kept = [k for k in range(ROWS) if not 700 <= k < 700 + lost]
    return text_of([rows[k] for k in kept]), times[kept]


def told(folder: Path, period: float = PERIOD, lost: int = 0) -> tuple[Description, Array]:
    data, times = record(period, lost)
    return describe(folder, data=data), times


@pytest.mark.parametrize("period", [PERIOD, 0.7, 3.003])
def test_a_log_with_rounded_stamps_has_its_own_clock_and_says_so(
    tmp_path: Path, period: float
) -> None:
    described, times = told(tmp_path, period)
    (log,) = described.logs
    assert spread(log.times, times) <= 0.5 * MS
    assert np.ptp(np.diff(log.times)) < 1e-9
    (note,) = log.notes
    assert f"every {period:g} ms" in note
    assert "largest correction is 0." in note
    (found,) = audits(described.logs, described.model.plant)
    assert not found.sampling.gaps
    assert not any("jitter" in text for text in found.warnings)


def test_a_gap_is_found_among_rounded_stamps(tmp_path: Path) -> None:
    described, _ = told(tmp_path, lost=40)
    (found,) = audits(described.logs, described.model.plant)
    (gap,) = found.sampling.gaps
    assert gap.row == 700 + 1
    assert gap.length == pytest.approx(41 * PERIOD * MS, abs=1e-5)
    assert described.logs[0].notes


def wandering(first: float, last: float, lost: int = 0, jitter: float = 0.0) -> str:
    """Rows in stamps of 1 ms of a clock whose period [ms] goes from ``first`` to ``last``."""
    steps = np.linspace(first, last, ROWS)
    steps += jitter * np.random.default_rng(3).uniform(-1.0, 1.0, ROWS)
    rows = [
        (stamp, float(k // 50 % 3), 0.1 * k)
        for k, stamp in enumerate(np.round(np.cumsum(steps)))
        if not 700 <= k < 700 + lost
    ]
    return text_of(rows)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("first", "last", "jitter"),
    [
        *((1.9, 2.1, 0.0), (2.0, 2.0, 0.1), (2.4, 2.6, 0.0), (2.6, 2.4, 0.0), (1.2, 1.4, 0.0)),
        *((2.45, 3.2, 0.0), (3.2, 2.45, 0.0), (2.0, 3.2, 0.0), (2.8, 2.8, 0.5)),
    ],
)
@pytest.mark.parametrize("lost", [0, 5])
def test_stamps_that_are_coarser_than_a_wandering_clock_are_no_gaps(
    tmp_path: Path, first: float, last: float, jitter: float, lost: int
) -> None:
    described = describe(tmp_path, data=wandering(first, last, lost, jitter))
    (found,) = audits(described.logs, described.model.plant)
    gaps = found.sampling.gaps
    assert len(gaps) == (lost > 0)
    if lost:
        assert gaps[0].row == 700 + 1
    assert found.sampling.step == pytest.approx(0.5e-3 * (first + last), rel=0.01)
    (said,) = [text for text in found.warnings if "coarser" in text]
    assert "time stamps in steps of 1 ms are coarser than the clock" in said
    assert "log with finer stamps" in said


@pytest.mark.parametrize(("before", "after"), [(2.0, 2.45), (2.0, 3.2), (2.2, 2.8), (2.45, 3.2)])
@pytest.mark.parametrize("rows", [150, 250, 400, 1000])
def test_a_clock_that_changes_its_pace_has_lost_nothing(
    before: float, after: float, rows: int
) -> None:
    """A grid of the one pace takes every second step of the other one for a lost row."""
    stamps = np.round(np.cumsum(np.repeat([before, after], rows // 2)))
    assert dithered(stamps, MS) is None
    times = MS * (stamps - stamps[0])
    found = audits([logs.log_of(times, {"u": times % 0.1}, {"y": times})], GAPPY)[0]
    assert found.sampling.gaps == ()
    assert found.sampling.step == pytest.approx(times[-1] / (rows - 1))


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([1.0, 2.0, 5.0]), st.floats(0.1, 0.25), st.integers(0, 2**32 - 1))
def test_many_lost_rows_of_an_even_clock_are_gaps_and_no_rounding(
    period: float, share: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    kept = random.uniform(size=1500) > share
    kept[[0, -1]] = True
    times = MS * period * np.flatnonzero(kept)
    found = audits([logs.log_of(times, {"u": times % 0.1}, {"y": times})], GAPPY)[0]
    lost = int(np.count_nonzero(np.diff(np.flatnonzero(kept)) > 1))
    assert len(found.sampling.gaps) == lost
    assert not found.sampling.rounded
    assert found.sampling.step == pytest.approx(MS * period)


@pytest.mark.parametrize(("first", "last"), [(1.9, 2.1), (2.1, 1.9), (2.4, 2.6), (1.4, 1.6)])
def test_single_lost_rows_are_found_among_rounded_stamps(first: float, last: float) -> None:
    """A step of two periods is longer than any step of one, whose rounding adds less than 1."""
    truth = np.cumsum(np.linspace(first, last, ROWS))
    lost = [700, 760, 790]
    stamps = np.round(np.delete(truth, lost))
    seen = [k - i - 1 for i, k in enumerate(lost)]  # of the row before, among those that are left
    steps = np.diff(stamps)
    assert np.delete(steps, seen).max() < min(steps[seen])  # so that they can be seen at all
    times = MS * (stamps - stamps[0])
    found = audits([logs.log_of(times, {"u": times % 0.1}, {"y": times})], GAPPY)[0]
    assert found.sampling.rounded
    assert [round(gap.time / MS) for gap in found.sampling.gaps] == list(times[seen] / MS)


@pytest.mark.thorough
def test_check_and_diagnosis_tell_what_was_done(tmp_path: Path) -> None:
    described, _ = told(tmp_path)
    (note,) = described.logs[0].notes
    checked = check(described)
    assert note in str(checked).replace("\n", " ")
    assert checked.document()["notes"] == {"log": [note]}
    found = diagnose(described)
    assert note in " ".join(str(found).split())
    assert found.document()["logs"][0]["notes"] == [note]


def test_windows_of_a_file_have_its_clock(tmp_path: Path) -> None:
    """A short window alone may lie on many grids: the whole file knows its own."""
    data, times = record()
    windows = ", ".join(f'{{ window = ["{k} ms", "{k + 60} ms"] }}' for k in (0, 500, 1500))
    described = describe(tmp_path, f"{LOG}repeat = [{windows}]", data=data)
    for log in described.logs:
        own = times[log.rows[0] - 2 : log.rows[-1] - 1]
        assert spread(log.times, own) <= 1e-6
        assert "every 1.3 ms" in log.notes[0]


def test_a_window_may_lie_on_a_grid_where_the_file_does_not(tmp_path: Path) -> None:
    head, *rows = record()[0].splitlines()
    cells = [row.partition(",")[2] for row in rows]
    times = [int(0.7 * k) for k in range(800)]
    times += [times[-1] + 977 * k for k in range(1, 40)]
    data = "\n".join([head, *(f"{time},{cell}" for time, cell in zip(times, cells))])
    log = describe(tmp_path, LOG + 'window = ["0 s", "559 ms"]\n', data=data).logs[0]
    assert log.times == pytest.approx(0.7e-3 * np.arange(800), abs=1e-3)
    assert "every 0.7 ms" in log.notes[0]


def in_seconds(period: float = 0.01, n: int = 250, lost: int = 0) -> str:
    """Rows of an even clock of this period [s], stamped in whole seconds as ISO texts."""
    rows = [
        (f"2024-05-01T12:00:{int(0.3 + period * k):02d}Z", float(k // 50 % 3), 0.1 * k)
        for k in range(n)
        if not 50 <= k < 50 + lost
    ]
    return text_of(rows)


ISO = LOG.replace(', unit = "ms"', "")


def with_period(period: str) -> str:
    return ISO.replace('"time_ms"', f'"time_ms", period = {period}')


def test_rows_of_which_most_repeat_their_time_are_not_told_to_be_dropped(tmp_path: Path) -> None:
    message = complaint(tmp_path, log=ISO, data=in_seconds())
    assert "row 3, column 'time_ms': time '2024-05-01T12:00:00Z' repeats" in message
    assert "as 99% of the stamps do" in message
    assert 'time.period = "10 ms"' in message
    assert "finer stamps" in message
    assert "drop" not in message
    jittery = np.cumsum(0.7 + 0.5 * np.random.default_rng(4).uniform(-1.0, 1.0, 400))
    rows = [(time, float(k % 3), 0.1 * k) for k, time in enumerate(np.round(jittery))]
    message = complaint(tmp_path, data=text_of(rows))
    assert "coarser than the clock" in message
    assert 'if rows stand twice, set time.repeats = "drop"' in message


def stated(stamps: Array, period: float) -> Clock:
    """The clock of stamps [s] of which the period [s] is told."""
    columns = Columns(Path("log.csv"), (column_of("t", stamps.tolist()),))
    return read_clock(columns, "t", "s", drop=False, period=period)


@settings(max_examples=25, deadline=None)
@given(st.floats(2e-3, 3.0), st.floats(0.0, 1.0), st.sampled_from([1e-3, 1.0]))
@example(period=0.9999, phase=0.0, quantum=1.0)
@example(period=1.0001, phase=0.9999, quantum=1.0)
def test_a_period_that_is_stated_is_that_of_the_rows(
    period: float, phase: float, quantum: float
) -> None:
    truth = period * np.arange(300) + phase
    stamps = quantum * np.floor(truth / quantum)
    assume(np.ptp(stamps) > 0.0)
    clock = stated(stamps, period)
    np.testing.assert_allclose(clock.since, truth - phase, atol=1e-9)


def test_a_period_in_a_description(tmp_path: Path) -> None:
    window = with_period('"10 ms"') + 'window = ["0.5 s", "1.5 s"]\n'
    (log,) = describe(tmp_path, window, data=in_seconds()).logs
    assert log.times == pytest.approx(0.01 * np.arange(101), abs=1e-6)
    assert log.rows[0] == 2 + 50


@pytest.mark.parametrize(
    ("log", "lost", "said"),
    [
        (with_period('"100 ms"'), 0, "last 4 s and 449 periods of 0.1 s 44.9 s"),
        (with_period('"3 s"'), 0, "last 4 s and 449 periods of 3 s 1347 s"),
        (with_period('"1 ms"'), 0, "last 4 s and 449 periods of 0.001 s 0.449 s"),
        (with_period('"10 ms"'), 150, "no row may be missing"),
        (with_period("0"), 0, "logs[1].time.period: 0 s; give a time above 0"),
        (with_period('"soon"'), 0, "logs[1].time.period"),
        (with_period('"10 ms", repeats = "drop"'), 0, "logs[1].time.period: every row counts"),
    ],
)
def test_a_period_that_cannot_be(tmp_path: Path, log: str, lost: int, said: str) -> None:
    assert said in complaint(tmp_path, log=log, data=in_seconds(n=450, lost=lost))


@settings(max_examples=25, deadline=None)
@given(
    st.floats(2e-3, 3.0),
    st.floats(0.0, 1.0),
    st.sampled_from([1e-3, 1.0]),
    st.one_of(st.floats(1.05, 100.0), st.floats(0.01, 0.95)),
)
def test_a_period_that_the_length_contradicts_is_refused(
    period: float, phase: float, quantum: float, wrong: float
) -> None:
    """Whatever the rounding, stamps and rows last as long but for one quantum."""
    stamps = quantum * np.floor((period * np.arange(300) + phase) / quantum)
    steps = np.diff(stamps)
    assume(np.ptp(stamps) > 0.0)
    assume(abs(np.ptp(stamps) - 299 * wrong * period) > 1.05 * steps[steps > 1e-6].min())
    with pytest.raises(UserError, match=r"correct time\.period"):
        stated(stamps, wrong * period)


@pytest.mark.parametrize("origin", [0.0, 1.7e9])
def test_one_row_that_is_missing_among_exact_stamps_is_seen(origin: float) -> None:
    times = origin + 0.01 * np.arange(1000)
    assert stated(times, 0.01).since == pytest.approx(0.01 * np.arange(1000), abs=1e-6)
    with pytest.raises(UserError, match="no row may be missing"):
        stated(np.delete(times, 400), 0.01)


def test_stamps_that_are_all_the_same_show_no_period() -> None:
    with pytest.raises(UserError, match=r"all stamps are the same .* give finer stamps"):
        stated(np.full(100, 7.0), 3600.0)


@settings(max_examples=60)
@given(
    st.integers(20, 3000),
    st.sampled_from([1e-3, 1.0 / 30.0, 2e-2, 0.0134]),
    st.floats(0.0, 1.0),
    st.integers(0, 99),
)
def test_rounded_times_go_back_to_their_grid(
    count: int, step: float, share: float, seed: int
) -> None:
    exact = step * np.arange(count)
    noise = np.random.default_rng(seed).uniform(-1.0, 1.0, count)
    noise[0] = 0.0
    found = regular(exact + 2e-4 * share * step * noise)
    np.testing.assert_allclose(found, exact, atol=1e-3 * step, rtol=0.0)
    assert np.ptp(np.diff(found)) <= 1e-9 * step or share == 0.0


def test_jittered_times_stay_as_they_are() -> None:
    times = np.cumsum(np.tile([0.013, 0.014, 0.013], 30))
    assert np.array_equal(regular(times), times)


READ_EVERY = 0.01  # [s] from one tick to the next
SEEDS = st.integers(0, 10_000)


def ticks(random: np.random.Generator, rows: str) -> Array:
    """Numbers of 1200 rows: all of them, some lost, or one to three apart."""
    steps = {
        "all": np.ones(1199),
        "lost": 1.0 + 4.0 * (random.random(1199) < 0.02),
        "uneven": random.choice([1.0, 2.0, 3.0], 1199),
    }
    return np.concatenate([[0.0], np.cumsum(steps[rows])])


def arrivals(random: np.random.Generator, rows: Array, mean: float) -> Array:
    """Times [s] at which messages of these ticks arrive, in order."""
    late = rows + random.exponential(mean, len(rows))
    return READ_EVERY * (np.maximum.accumulate(late - 0.02 * rows) + 0.02 * rows)


def motion(times: Array) -> Array:
    """An angle [rad] that never rests."""
    return np.asarray(np.sin(5.0 * times) + 0.4 * np.sin(17.0 * times + 1.0))


def readings(random: np.random.Generator, times: Array) -> Array:
    return motion(times) + 2e-3 * random.standard_normal(len(times))


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from(["all", "lost", "uneven"]), st.floats(0.15, 0.4))
def test_rows_that_arrive_late_are_put_back_on_the_clock_that_was_read(
    seed: int, rows: str, mean: float
) -> None:
    """All but a few: one that is later than the next tick may be taken for that one's."""
    random = np.random.default_rng(seed)
    truth = ticks(random, rows)
    stamps = arrivals(random, truth, mean)
    late = stamped_late(stamps - stamps[0], [readings(random, READ_EVERY * truth)])
    assert late is not None
    assert late.period == pytest.approx(READ_EVERY, rel=1e-4)
    off = late.times - READ_EVERY * truth
    off -= np.median(off)
    assert np.mean(np.abs(off) < 0.1 * READ_EVERY) > (0.98 if rows == "all" else 0.9)
    before = stamps - READ_EVERY * truth
    assert np.mean(np.abs(off)) < 0.6 * np.mean(np.abs(before - np.median(before)))


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.sampled_from(["all", "lost", "uneven"]), st.floats(0.1, 0.4))
def test_a_host_that_wakes_late_and_reads_late_keeps_its_stamps(
    seed: int, rows: str, mean: float
) -> None:
    random = np.random.default_rng(seed)
    stamps = arrivals(random, ticks(random, rows), mean)
    assert stamped_late(stamps - stamps[0], [readings(random, stamps)]) is None


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.floats(0.05, 0.5))
def test_a_clock_that_wanders_keeps_its_stamps(seed: int, jitter: float) -> None:
    """Each row is a step after the one before, not after a tick."""
    random = np.random.default_rng(seed)
    stamps = READ_EVERY * np.cumsum(1.0 + jitter * random.random(1200))
    assert stamped_late(stamps - stamps[0], [readings(random, stamps)]) is None


def test_readings_that_say_nothing_leave_stamps_as_they_are() -> None:
    random = np.random.default_rng(0)
    stamps = arrivals(random, np.arange(1200.0), 0.3)
    assert stamped_late(stamps - stamps[0], [random.standard_normal(1200)]) is None
    assert stamped_late(READ_EVERY * np.arange(1200.0), [random.standard_normal(1200)]) is None
    assert stamped_late(stamps[:12] - stamps[0], [random.standard_normal(12)]) is None


def test_check_tells_that_rows_are_stamped_late() -> None:
    random = np.random.default_rng(3)
    stamps = arrivals(random, np.arange(1200.0), 0.3)
    angle = readings(random, READ_EVERY * np.arange(1200.0))
    log = {"time": stamps, "goal": np.sin(3.0 * stamps), "angle": angle}
    found = describe_arrays(model("smart_servo"), {"arm": log}, {name: name for name in log})
    (read,) = found.logs
    assert np.ptp(np.diff(read.times)) < 1e-9
    told = str(check(found).document()["notes"])
    assert "an even clock of 10 ms and not over the stamps" in told
