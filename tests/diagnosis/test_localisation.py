"""Where a gap lies: errors that are put into one regime are found there."""

from __future__ import annotations

import gc
import itertools
import weakref
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import PLANTS, Model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.localisation import Bin, Breakdown, localise
from servo_models.diagnosis.localisation.breakdown import plain
from servo_models.diagnosis.localisation.open_loop import by_block, opened
from servo_models.diagnosis.localisation.regimes import _between, _digits
from servo_models.diagnosis.search.crossval import CrossValidation, blocks
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.selection import Selection
from servo_models.identification.problem import Problem, free_parameter
from tests.support import logs
from tests.support.logs import changed, log_of

STEP = 1e-3
TIMES = STEP * np.arange(2000.0)
FLOOR = {"angle": 1e-4, "current": 1e-5}
VOLTAGE = np.where(TIMES < 1.0, 20.0, 2.0) * np.sin(2.0 * np.pi * 2.0 * TIMES)
"""Two periods a second, large in the first half and small in the second."""
MODEL = model("torque_motor", "measured", {"end_stops.half_range": 0.0})


def clean() -> Mapping[str, Array]:
    return simulate(MODEL, TIMES, {"voltage": VOLTAGE}).outputs


def measured(outputs: Mapping[str, Array], held_out: NDArray[np.bool_] = TIMES < 0.0) -> Log:
    """A log of these readings of the motor."""
    return log_of(TIMES, {"voltage": VOLTAGE}, outputs, held_out=held_out)


def found(
    before: Array, after: Array, outputs: tuple[str, ...] = ("angle",)
) -> dict[str, Breakdown]:
    """Breakdowns of errors [noise floors] that are given, of shape (n,) for each output."""
    log = measured({name: clean()[name] for name in outputs})
    fitter = Fitter(MODEL, [log], (), {name: FLOOR[name] for name in outputs})
    fitted = fitter.fit((), ())
    parts = blocks(fitted.problem)
    empty = np.empty(0)
    taken = replace(fitted, evidence=CrossValidation(empty, after, after, parts))
    selection = Selection(CrossValidation(empty, before, before, parts), fitted, [], taken, {})
    return {one.dimension: one for one in localise(selection)}


def noise(seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal(len(TIMES))


def only(chosen: NDArray[np.bool_]) -> Array:
    """An error of 10 floors where ``chosen``, else noise of one."""
    return np.where(chosen, 10.0, 1.0) * noise(1)


def in_bins(one: Breakdown, holds: Callable[[float, float], bool]) -> float:
    return sum(b.share_before for b in one.bins if holds(b.low, b.high))


def test_shares_make_one_and_samples_are_all_there() -> None:
    for one in found(only(TIMES < 0.3), noise(2)).values():
        assert sum(b.share_before for b in one.bins) == pytest.approx(1.0)
        assert sum(b.share_after for b in one.bins) == pytest.approx(1.0)
        if one.dimension != "frequency":
            assert sum(b.count for b in one.bins) == len(TIMES)


def test_by_time() -> None:
    late = TIMES >= 1.5
    before = only(late)
    one = found(before, noise(2))["time"]
    share = float(np.sum(before[late] ** 2) / np.sum(before**2))
    assert in_bins(one, lambda low, high: low >= 1.5 - 1e-2) == pytest.approx(share, rel=0.02)
    assert "even" not in one.sentence


def test_by_direction_of_speed() -> None:
    up = np.gradient(clean()["angle"]) > 0.0
    one = found(only(up), noise(2))["speed"]
    assert in_bins(one, lambda low, high: low >= 0.0 and high > 0.0) > 0.95
    assert "up" in one.sentence
    assert one.unit == "deg/s"


def test_by_position() -> None:
    high_end = np.degrees(clean()["angle"]) > 1.0
    one = found(only(high_end), noise(2))["position"]
    assert in_bins(one, lambda low, high: high > 1.0) > 0.9


def test_around_reversals() -> None:
    angle = clean()["angle"]
    speed = np.gradient(angle)
    turns = np.flatnonzero(np.diff(np.sign(speed)))[1:]  # the first one is the start
    since = np.array([min([i - t for t in turns if t <= i], default=999) for i in range(2000)])
    one = found(only(since < 20), noise(2))["time since a reversal"]
    assert one.bins[1].label == "within 20 ms after a reversal"  # a tenth of half a period
    assert one.bins[1].share_before > 0.8
    assert "after a reversal" in one.sentence


def test_by_frequency() -> None:
    """A sine of 100 Hz lies in the band that holds it, by its share of the power."""
    sine = 3.0 * np.sin(2.0 * np.pi * 100.0 * TIMES)
    one = found(sine + 0.1 * noise(1), noise(2))["frequency"]
    (band,) = [b for b in one.bins if b.low < 100.0 <= b.high]
    assert band.share_before > 0.99
    assert band.rms_before == pytest.approx(3.0 / np.sqrt(2.0), rel=0.01)


@pytest.mark.thorough
def test_by_signal() -> None:
    errors = np.concatenate([3.0 * noise(1), 4.0 * noise(3)])
    one = found(errors, errors, ("angle", "current"))["signal"]
    assert [b.label for b in one.bins] == ["angle", "current"]
    assert one.bins[0].share_before == pytest.approx(9.0 / 25.0, abs=0.03)


def test_small_signals_are_seen_beside_large_ones() -> None:
    """The same error everywhere is ten times as bad where the motion is a tenth."""
    one = found(20.0 * noise(1), noise(2))["command amplitude"]
    small, large = one.bins[0], one.bins[-1]
    assert small.relative_before / large.relative_before == pytest.approx(10.0, rel=0.2)
    assert "Over the local amplitude" in one.sentence


def test_a_regime_that_gets_worse_is_flagged_and_only_that() -> None:
    """Closing the gap of large moves at the cost of small ones."""
    small = TIMES >= 1.0
    before = np.where(small, 2.0, 20.0) * noise(1)
    after = np.where(small, 6.0, 2.0) * noise(2)
    every = found(before, after)
    assert [b.high <= 3.0 for b in every["command amplitude"].worse] == [True]
    assert all(b.low >= 1.0 - 1e-2 for b in every["time"].worse)
    assert len(every["time"].worse) == 6
    assert "It grows" in every["time"].sentence


def test_noise_gets_nowhere_worse() -> None:
    for seed in range(10):
        every = found(noise(seed), noise(100 + seed))
        assert not any(one.worse for one in every.values())


def test_an_even_error_is_called_even() -> None:
    one = found(5.0 * noise(1), noise(2))
    assert "evenly" in one["position"].sentence


LOGGED = {
    "voltage": ("angle", "current"),
    "reference": ("position", "drive"),
    "pulse_width": ("angle", "feedback_voltage", "motor_voltage"),
}
"""Outputs that are logged beside a command."""


def alone(chosen: Model, changes: Mapping[str, float], command: str, values: Array) -> Breakdown:
    """Blocks of a model that differs from the rig by ``changes``, without noise."""
    outputs = LOGGED[command]
    rig = changed(chosen, changes)
    log = logs.measured(rig, TIMES, {command: values}, dict.fromkeys(outputs, 0.0))
    fitted = Fitter(chosen, [log], (), dict.fromkeys(outputs, 1e-5)).fit((), ())
    found = by_block(Selection(fitted.evidence, fitted, [], fitted, {}))
    assert found is not None
    return found


@pytest.mark.thorough
def test_a_block_is_judged_from_its_measured_input() -> None:
    """A wrong winding does not make the mechanics wrong, a wrong spring does."""
    winding = alone(MODEL, {"resistance": 4500.0}, "voltage", VOLTAGE)
    (angle,) = winding.bins
    assert angle.label == "angle from measured current"
    assert angle.relative_before < 0.01
    spring = alone(MODEL, {"stiffness": 1.2 * 1.1}, "voltage", VOLTAGE)
    assert spring.bins[0].relative_before == pytest.approx(0.2, rel=0.1)


@pytest.mark.thorough
def test_each_model_is_judged_at_the_moment_that_suits_it_best() -> None:
    """Before is the rig itself; a lag that the rig has not closes nothing."""
    outputs = {name: clean()[name] for name in FLOOR}
    fitter = Fitter(MODEL, [measured(outputs)], (), FLOOR)
    nominal = fitter.fit((), ())
    lag = "sensor_lag.time_constant"
    free = [free_parameter(MODEL.plant.parameters[lag], 0.0, None)]
    late = fitter.at_values(("sensor_lag",), free, {lag: 5e-4})

    def block(taken: FittedModel) -> Bin:
        found = by_block(Selection(nominal.evidence, nominal, [], taken, {}))
        assert found is not None
        return found.bins[0]

    assert block(late).rms_before == block(nominal).rms_after
    assert block(late).rms_before < 0.1


def test_the_command_is_the_actuators_main_input() -> None:
    """A load that moves more for its scale is none, nor is a switch."""
    load = np.where(TIMES < 1.0, 0.0, 0.05)
    servo = model("sg90", "measured")
    pulses = 1.5e-3 + 1e-4 * np.sign(np.sin(2.0 * np.pi * TIMES))
    wire, low, high = command_of(servo, {"pulse_width": pulses, "load_torque": load})
    assert wire == "pulse_width"
    assert (low, high) == (pytest.approx(1.4e-3), pytest.approx(1.6e-3))
    still = np.full(len(TIMES), 1.5e-3)
    wire, _, _ = command_of(servo, {"pulse_width": still, "load_torque": load})
    assert wire == "load_torque"
    switched = {"goal": 0.01 * np.sin(TIMES), "enabled": 1.0 * (TIMES > 0.5)}
    wire, _, _ = command_of(model("smart_servo"), switched)
    assert wire == "goal"


def command_of(chosen: Model, inputs: Mapping[str, Array]) -> tuple[str, float, float]:
    log = replace(measured({"angle": clean()["angle"]}), inputs=inputs)
    column, low, high = Problem(chosen, [log], []).moving_input
    return chosen.plant.inputs[column].name, low, high


def test_windows_of_time_count_from_the_files_first_row() -> None:
    noisy = clean()["angle"] + 10.0 * FLOOR["angle"] * noise(3)
    log = replace(measured({"angle": noisy}), begin=7.0)
    fitted = Fitter(MODEL, [log], (), {"angle": FLOOR["angle"]}).fit((), ())
    places = localise(Selection(fitted.evidence, fitted, [], fitted, {}))
    (time,) = [one for one in places if one.dimension == "time"]
    assert (time.bins[0].low, time.bins[-1].high) == (7.0, 7.0 + TIMES[-1])
    assert sum(one.count for one in time.bins) == len(TIMES)


def test_plants_whose_wires_were_replaced_are_not_kept_for_ever() -> None:
    """A person's own come and go."""
    plant = replace(model("torque_motor").plant)
    gone = weakref.ref(plant)
    assert opened(plant, ("angle",)) is opened(plant, ("angle",))
    for _ in range(PLANTS):
        plant = replace(plant)
        opened(plant, ("angle",))
    gc.collect()
    assert gone() is None


@pytest.mark.thorough
def test_the_blocks_of_a_loop_are_told_apart() -> None:
    """A mass too light shows in the mechanics, a gain too low in the controller, and only there."""
    drive = model("linear_drive", "identified")
    reference = 0.02 * np.sin(2.0 * np.pi * TIMES)
    heavy = {one.label: one for one in alone(drive, {"mass": 120.0}, "reference", reference).bins}
    gain = {"speed_gain": 200.0}
    weak = {one.label: one for one in alone(drive, gain, "reference", reference).bins}
    controller, mechanics = "drive from measured position", "position from measured drive"
    assert heavy[controller].relative_before < 0.01
    assert weak[mechanics].relative_before < 0.01
    assert weak[controller].relative_before > 0.1
    assert heavy[mechanics].relative_before > 5.0 * weak[mechanics].relative_before


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({"potentiometer_gain": 1.1}, "feedback_voltage from measured angle and motor_voltage"),
        ({"amplifier_gain": 0.8}, "motor_voltage from measured angle and feedback_voltage"),
        ({"motor_gain": 1.2}, "angle from measured feedback_voltage and motor_voltage"),
    ],
)
def test_a_servos_sensor_amplifier_and_motor_are_told_apart(
    changes: dict[str, float], wrong: str
) -> None:
    servo = model("sg90", "measured")
    pulses = 1.5e-3 + 2e-4 * np.sign(np.sin(2.0 * np.pi * 1.3 * TIMES))
    scaled = {name: factor * servo.values[name] for name, factor in changes.items()}
    found = {
        one.label: one.relative_before for one in alone(servo, scaled, "pulse_width", pulses).bins
    }
    # of the angle, which integrates, only what is no straight line in a block of time counts
    others = max(error for label, error in found.items() if label != wrong)
    assert found[wrong] > 0.01
    assert found[wrong] > 20.0 * others


@given(st.floats(1e-4, 1e4), st.floats(1e-5, 10.0))
def test_edges_about_an_offset_differ(offset: float, width: float) -> None:
    cuts = offset + width * np.arange(7.0)
    digits = _digits(float(np.abs(cuts).max()), width)
    labels = [_between(low, high, "deg", digits) for low, high in itertools.pairwise(cuts)]
    assert len(set(labels)) == 6
    assert all(label.split(" to ")[0] != label.split(" to ")[1][:-4] for label in labels)


def test_a_single_sample_has_no_spectrum() -> None:
    log = measured({"angle": clean()["angle"] + 1e-3}, np.arange(len(TIMES)) != 700)
    fitted = Fitter(MODEL, [log], (), {"angle": 1e-4}).fit((), ())
    places = localise(Selection(fitted.evidence, fitted, [], fitted, {}))
    assert "frequency" not in {one.dimension for one in places}
    assert next(one for one in places if one.dimension == "signal").bins[0].count == 1


@given(st.floats(1e-3, 1e9))
def test_numbers_of_a_breakdown_have_no_powers_of_ten(value: float) -> None:
    assert "e" not in plain(value)
    assert float(plain(value)) == pytest.approx(value, rel=0.0051)
