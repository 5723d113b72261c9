"""How large a gap is, in figures that are known: errors are put into a log by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.audit import audits, noise_floors
from servo_models.data.log import Log
from servo_models.data.sensor import REPEATS, RESIDUAL
from servo_models.diagnosis.gap import Gap, GapSummary, gaps, whole_gap
from servo_models.diagnosis.search.crossval import CrossValidation, closed
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.diagnosis.search.selection import Selection
from servo_models.identification.problem import free_parameter
from tests.support.logs import changed, log_of

STEP = 1e-3
COUNT = 1000
MODEL = model("torque_motor", "measured", {"end_stops.half_range": 0.0})


def voltage(count: int) -> Array:
    """A slow sine: two periods a second."""
    return np.asarray(20.0 * np.sin(2.0 * np.pi * 2.0 * STEP * np.arange(count)))


def simulated(count: int = COUNT) -> dict[str, Array]:
    outputs = simulate(MODEL, STEP * np.arange(count), {"voltage": voltage(count)}).outputs
    return {name: outputs[name] for name in ("angle", "current")}


def log(outputs: dict[str, Array], name: str = "one", kept: int = COUNT) -> Log:
    """A log of these readings; samples from ``kept`` on are held out."""
    rows = np.arange(COUNT)
    inputs = {"voltage": voltage(COUNT)}
    return log_of(STEP * rows, inputs, outputs, name=name, held_out=rows >= kept)


def found(*logs: Log) -> dict[str, Gap]:
    """Gaps of the nominal model, by output."""
    floors = {name: 1e-5 for log in logs for name in log.outputs}
    nominal = Fitter(MODEL, logs, (), floors).unfitted()
    selection = Selection(nominal.evidence, nominal, [], nominal, {})
    return {gap.output: gap for gap in gaps(selection, floors, dict.fromkeys(floors, ""), 0)}


@pytest.mark.parametrize("late", [5, 1, -1, -5])
def test_a_simulation_that_is_shifted_has_that_delay(late: int) -> None:
    """Samples by which the rig lags; one that leads has a negative delay."""
    angle = simulated(COUNT + 5)["angle"]
    shifted = np.concatenate([np.zeros(max(late, 0)), angle[max(-late, 0) :]])[:COUNT]
    gap = found(log({"angle": shifted}))["angle"]
    assert gap.delay == pytest.approx(late * STEP, rel=0.01)


@pytest.mark.parametrize("late", [10, 80, 120])
def test_a_delay_is_that_of_the_whole_shift_not_of_its_slope(late: int) -> None:
    """A quarter of the sine's period is 125 samples, where the slope of the error says nothing."""
    angle = simulated()["angle"]
    shifted = np.concatenate([np.zeros(late), angle[:-late]])
    gap = found(log({"angle": shifted}))["angle"]
    assert gap.delay == pytest.approx(late * STEP, rel=0.02)


def test_a_log_without_noise_has_a_floor_of_motion_alone() -> None:
    """A command that jumps every sample: the current follows, faster than samples can show."""
    jumps = 20.0 * np.random.default_rng(7).standard_normal(COUNT)
    times = STEP * np.arange(COUNT)
    angle = {"current": simulate(MODEL, times, {"voltage": jumps})["current"]}
    moved = replace(log(angle), inputs={"voltage": jumps})
    floors = noise_floors(audits([moved], MODEL.plant))
    nominal = Fitter(MODEL, (moved,), (), floors).unfitted()
    selection = Selection(nominal.evidence, nominal, [], nominal, {})
    (gap,) = gaps(selection, floors, {"current": RESIDUAL}, 0)
    assert gap.motion == pytest.approx(floors["current"], rel=1e-6)
    (gap,) = gaps(selection, floors, {"current": REPEATS}, 0)
    assert gap.motion == 0.0


def test_noise_hides_no_delay() -> None:
    """A fifth of the amplitude, white at 1 kHz: its rate is far above that of the motion."""
    angle = simulated(COUNT)["angle"]
    late = np.concatenate([np.zeros(10), angle[:-10]])
    noise = 0.2 * np.abs(angle).max() * np.random.default_rng(3).standard_normal(COUNT)
    rate = np.gradient(angle, STEP)
    error = np.std(noise) / np.sqrt(rate @ rate)
    gap = found(log({"angle": late + noise}))["angle"]
    assert abs(gap.delay - 10 * STEP) < 4.0 * error < 3.0 * STEP


def test_a_wrong_size_is_no_delay() -> None:
    """Whole periods of a sine and of its rate have nothing in common, but for the start."""
    (gap,) = found(log({"angle": 1.5 * simulated()["angle"]})).values()
    assert abs(gap.delay) < 0.1 * STEP


def test_nrmse_is_the_error_over_the_measured_range() -> None:
    """A triangle from -2 to 2 is measured: its range is 4, whatever the simulation does."""
    triangle = np.interp(np.arange(COUNT), [0, 200, 600, 999], [0.0, 2.0, -2.0, 0.0])
    gap = found(log({"angle": triangle}))["angle"]
    error = np.sqrt(np.mean((simulated()["angle"] - triangle) ** 2))
    assert gap.nrmse == pytest.approx(error / 4.0, rel=1e-9)


def test_nrmse_counts_what_is_not_held_out_of_all_logs() -> None:
    """Errors of 0.01 and 0.03 in half of the samples each have an RMS of sqrt(5) 0.01."""
    angle = simulated()["angle"]
    small, large = angle + 0.01, angle - 0.03
    small[-100:] = large[-100:] = 50.0
    gap = found(*(log({"angle": it}, kept=COUNT - 100) for it in (small, large)))["angle"]
    assert gap.full_scale == pytest.approx(np.ptp(angle[:-100]) + 0.04, rel=1e-9)
    assert gap.nrmse * gap.full_scale == pytest.approx(np.sqrt(5.0) * 0.01, rel=1e-9)


@pytest.mark.parametrize(("at", "height"), [(0, 0.5), (437, -0.5), (899, 0.5)])
def test_the_worst_moment_is_where_a_spike_is(at: int, height: float) -> None:
    """In the second log, which has no current; a higher one where samples are held out is not
    looked at."""
    plain, spiked = simulated(), simulated()
    spiked["angle"][at] += height
    spiked["angle"][950] += 3.0 * height
    plain["current"][123] += 1.0
    gap = found(log(plain, kept=900), log({"angle": spiked["angle"]}, "other", kept=900))
    assert gap["angle"].worst == ("other", STEP * at)
    assert gap["current"].worst == ("one", STEP * 123)


def test_the_worst_moment_counts_from_the_files_first_row() -> None:
    spiked = simulated()
    spiked["angle"][400] += 0.5
    gap = found(replace(log(spiked), begin=2.5))["angle"]
    assert gap.worst == ("one", pytest.approx(2.5 + 400 * STEP))


def test_an_output_that_only_a_later_log_has_has_intervals() -> None:
    plain, both = simulated(), simulated()
    both["current"] += 0.01 * np.random.default_rng(1).standard_normal(COUNT)
    gap = found(*(log({"angle": plain["angle"]}, f"log {k}") for k in range(9)), log(both, "last"))
    low, high = gap["current"].intervals["before"]
    assert 0.009 < low < gap["current"].rms["before"] < high < 0.011


def test_an_output_of_logs_that_are_held_out_whole_has_no_gap() -> None:
    assert list(found(log({"angle": simulated()["angle"]}), log(simulated(), "held", 0))) == [
        "angle"
    ]


def test_what_a_log_states_is_not_free_in_it() -> None:
    """A winding of twice the resistance, known in the second log and uncertain in the first."""
    value = 2.0 * MODEL.values["resistance"]
    hot = changed(MODEL, {"resistance": value})
    times, volts = STEP * np.arange(COUNT), {"voltage": voltage(COUNT)}
    second = log({"angle": simulate(hot, times, volts)["angle"]}, "hot")
    second = replace(second, constants={"resistance": value})
    first = log({"angle": simulated()["angle"]})
    free = free_parameter(MODEL.plant.parameters["resistance"], MODEL.values["resistance"], 100.0)
    fitter = Fitter(MODEL, [first, second], (free,), {"angle": 1e-6})
    assert fitter.unfitted().evidence.rms < 1e-9
    (run,) = fitter.problem().runs[1:]
    assert run.with_constants({"resistance": 1.0, "stiffness": 2.0})["resistance"] == value
    assert run.with_constants({"resistance": 1.0, "stiffness": 2.0})["stiffness"] == 2.0


def test_what_stands_still_has_no_range() -> None:
    """Where it is fitted; it may move where it is held out."""
    angle = np.where(np.arange(COUNT) < 500, 0.01, 0.02)
    assert np.isnan(found(log({"angle": angle}, kept=500))["angle"].nrmse)


def reduced(before: float, after: float, seed: int) -> GapSummary:
    """The gap of independent errors, in 20 blocks of 50, over a noise floor of 1."""
    random, parts = np.random.default_rng(seed), np.repeat(np.arange(20), 50)

    def stage(size: float) -> Any:
        errors = size * random.standard_normal(len(parts))
        return CrossValidation(np.empty(0), errors, errors, parts)

    fitted = SimpleNamespace(evidence=stage(before))
    selection: Any = SimpleNamespace(
        before=stage(before), retuned=fitted, taken=SimpleNamespace(evidence=stage(after))
    )
    return whole_gap(selection, seed)


@pytest.mark.parametrize(
    ("before", "after", "share"),
    [(5.0, 1.0, 1.0), (5.0, 3.0, 0.5), (5.0, 6.0, -0.25), (9.0, 0.5, 1.0)],
)
def test_the_share_closed_is_that_of_what_is_above_the_floor(
    before: float, after: float, share: float
) -> None:
    assert closed(before, after, 1.0) == pytest.approx(share)
    assert closed(1.0, after, 1.0) is None


def test_what_is_hardly_above_the_floor_has_no_share() -> None:
    assert closed(1.05, 0.9, 1.0) is None
    assert reduced(1.03, 1.05, 1).closed is None


def test_a_gap_in_one_block_has_an_interval_that_says_something() -> None:
    """A third of all draws of 20 blocks miss it, and have nothing to close."""
    random, parts = np.random.default_rng(2), np.repeat(np.arange(20), 50)
    after = random.standard_normal(len(parts))
    before = after + np.where(parts == 7, 15.0, 0.0)
    first, last = (CrossValidation(np.empty(0), it, it, parts) for it in (before, after))
    selection: Any = SimpleNamespace(
        before=first, retuned=SimpleNamespace(evidence=first), taken=SimpleNamespace(evidence=last)
    )
    found = whole_gap(selection, 0).closed
    assert found is not None
    share, low, high = found
    assert 0.9 < share <= high == 1.0
    assert -2.0 < low < 0.5


def test_intervals_hold_the_true_value_in_95_of_100_draws() -> None:
    """Errors of 5 and 2 floors, of which 3/4 of what is above the floor is closed.

    A bootstrap of 20 blocks is a little narrow: 0.90 to 0.99 of 300 draws are asked for, which
    no interval of no width meets, and none of twice the width.
    """
    drawn = [reduced(5.0, 2.0, seed) for seed in range(300)]
    for stage, true in (("before", 5.0), ("after", 2.0)):
        held = [low < true < high for low, high in (it.intervals[stage] for it in drawn)]
        assert 0.90 < np.mean(held) < 0.99
    shares = [it.closed for it in drawn if it.closed]
    assert 0.90 < np.mean([low < 0.75 < high for _, low, high in shares]) < 0.99
