"""What a selection must not tell: an effect where noise is left, or where a fit is stuck."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from servo_models.core.simulate import model
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.diagnosis.search.residuals import Residuals, unmodelled
from servo_models.diagnosis.search.selection import select_effects
from servo_models.diagnosis.settings import Settings
from servo_models.identification.doubts import NOT_DETERMINED, doubt
from servo_models.identification.linear_inference import spread
from servo_models.identification.problem import Free, free_parameter
from tests.support.diagnoses import made
from tests.support.logs import changed, measured

NOMINAL = {
    "gain": 100.0,
    "sample_hold.period": 2e-3,
    "torque_constant": 1.67523,
    "resistance": 19.9453,
    "inertia": 0.0100622,
    "loop_factor": 0.0137795,
    "coulomb_friction.level": 0.090952,
}
PRIORS = {
    "torque_constant": 0.1,
    "resistance": 0.1,
    "inertia": 0.15,
    "loop_factor": 0.05,
    "coulomb_friction.level": 0.3,
}  # of the nominal value
SIDES = {
    "torque_constant": 1.0,
    "resistance": -1.0,
    "inertia": -1.0,
    "loop_factor": -1.0,
    "coulomb_friction.level": -1.0,
}
"""To which side of its nominal value each parameter of the rig is."""


def firmware_loop() -> Fitter:
    """A servo with a 12 bit encoder and a held command, parameters off by two deviations."""
    nominal = changed(model("smart_servo", "xl330"), NOMINAL)
    times: Array = 4e-3 * np.arange(1142.0)
    moments, goals = (
        [0.0, 0.3, 1.08, 1.7, 2.52, 3.3, 3.93],
        [0.0, 17.4, 29.1, -29.1, -14.5, 7.3, 2.9],
    )
    goal = np.radians(goals)[np.searchsorted(moments, times, side="right") - 1]
    true = {n: NOMINAL[n] * (1.0 + 2.0 * SIDES[n] * part) for n, part in PRIORS.items()}
    log = measured(changed(nominal, true), times, {"goal": goal}, {"angle_reading": 0.0})
    known = nominal.plant.parameters
    free = tuple(
        free_parameter(known[name], nominal.values[name], part * nominal.values[name])
        for name, part in PRIORS.items()
    )
    return Fitter(nominal, [log], free, {"angle_reading": 1e-4}).surveyed()


def test_a_fit_of_the_smooth_twin_leads_out_of_a_dent() -> None:
    """A quantiser and a hold in the loop give the response dents in which a search ends."""
    fitter = firmware_loop()
    assert set(fitter.smooth) == {"sensor_quantisation.step", "sample_hold.period"}
    assert not any(fitter.smooth.values())
    alone = replace(fitter, smooth={}).fit((), ())
    assert fitter.fit((), ()).cost < 0.2 * alone.cost


def test_standard_errors_do_not_depend_on_what_was_simulated_before() -> None:
    fitter = firmware_loop()
    fresh, used = fitter.problem(), fitter.problem()
    for share in (0.9, 1.0, 1.1):
        used.residuals(share * used.nominal)
    first, second = (spread(it, it.nominal).standard_errors for it in (fresh, used))
    np.testing.assert_array_equal(first, second)


def test_no_effect_is_named_where_parameters_leave_noise() -> None:
    """An offset of a third of the noise would earn its place in a long log."""
    fitter, _ = made({"sensor_offset.value": 3e-6})
    selected = select_effects(fitter)
    assert selected.taken.effects == ()
    assert 1.0 < selected.retuned.evidence.rms < 1.1
    assert len(select_effects(fitter, tolerance=0.9).taken.effects) == 1  # who asks for less
    fitter = replace(fitter, settings=Settings(enough_floors=0.0))
    assert len(select_effects(fitter).taken.effects) == 1


@pytest.mark.thorough
def test_no_effect_joins_a_model_that_leaves_noise() -> None:
    fitter, _ = made({"coulomb_friction.level": 1.5e-3, "sensor_offset.value": 3e-6})
    assert select_effects(fitter).taken.effects == ("coulomb_friction",)
    fitter = replace(fitter, settings=Settings(enough_floors=0.0))
    assert set(select_effects(fitter).taken.effects) == {"coulomb_friction", "sensor_offset"}


@pytest.mark.thorough
@pytest.mark.parametrize(("offset_in_floors", "effects"), [(1.75, 0), (3.5, 1)])
def test_a_first_effect_takes_a_tenth_of_what_parameters_leave(
    offset_in_floors: float, effects: int
) -> None:
    """Noise of five floors and an offset leave hypot(5, offset) floors, and without it five."""
    floor = 1e-5
    fitter, _ = made({"sensor_offset.value": offset_in_floors * floor}, 5.0 * floor)
    selected = select_effects(replace(fitter, floors={"angle": floor}))
    assert len(selected.taken.effects) == effects


@pytest.mark.parametrize("ticks", [-1.0, 1.0])
def test_a_delay_one_tick_off_before_a_hold_is_found(ticks: float) -> None:
    """Commands wait for the next tick, so that no slope leads from one tick to another."""
    period, delay, floor = 8e-3, 24.3e-3, 1e-4
    nominal = changed(model("smart_servo", "xl330"), {**NOMINAL, "sample_hold.period": period})
    times: Array = 2e-3 * np.arange(750.0)
    moments, goals = [0.0, 0.103, 0.511, 1.004], np.radians([0.0, 17.4, -29.1, 7.3])
    inputs = {"goal": goals[np.searchsorted(moments, times, side="right") - 1]}
    late = changed(nominal, {"transport_delay.time": delay})
    log = measured(late, times, inputs, {"angle_reading": floor})
    own = next(it for it in candidates(nominal, [log]) if it.name == "transport_delay")
    begun = [replace(it, start=delay + ticks * period) for it in own.free]
    fitter = Fitter(nominal, [log], (), {"angle_reading": floor}).surveyed()
    assert fitter.fit((own.name,), begun).evidence.rms < 1.1


@pytest.mark.parametrize(
    ("structured", "gap", "lacks"),
    [(4.0, 200.0, False), (6.0, 200.0, True), (2.0, 12.0, False), (3.0, 12.0, True)],
)
def test_a_fifth_of_the_gap_or_five_floors_are_lacking(
    structured: float, gap: float, lacks: bool
) -> None:
    left = Residuals(structured, 0.9 * structured, 1.0, math.hypot(structured, 1.0))
    assert unmodelled(left, gap) == lacks


@pytest.mark.parametrize(("low", "said"), [(-1.0, ""), (0.0, NOT_DETERMINED)])
def test_an_offset_near_zero_may_be_well_known(low: float, said: str) -> None:
    free = Free("offset", low, 1.0, start=0.05, scale=0.05, nominal=0.0)
    assert doubt(free, 1e-3, 2e-3) == said
