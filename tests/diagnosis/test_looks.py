"""What a look promises of parameters that have bounds, and delays that no slope leads to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.crossval import advantage
from servo_models.diagnosis.search.fitting import Fitter, shifted
from servo_models.diagnosis.search.grid_search import shortlist
from servo_models.diagnosis.search.joint_fits import fit_with
from servo_models.diagnosis.search.screening import screen
from servo_models.diagnosis.search.selection import passes_entry_test
from servo_models.diagnosis.settings import DEFAULT
from servo_models.identification.linear_inference import solve_box_qp, value_at
from servo_models.identification.problem import free_parameter
from tests.support.diagnoses import made
from tests.support.logs import changed, log_of


@given(seed=st.integers(0, 10_000), twins=st.booleans(), shut=st.booleans())
def test_the_least_in_a_box_is_that_of_a_library(seed: int, twins: bool, shut: bool) -> None:
    """Several at once, of columns of any size, two all but the same, a variable that is fixed."""
    random = np.random.default_rng(seed)
    slopes = random.standard_normal((3, 30, 6)) * 10.0 ** random.uniform(-2.0, 2.0, 6)
    if twins:
        slopes[:, :, 1] = 1.01 * slopes[:, :, 0] + 1e-4 * random.standard_normal((3, 30))
    errors = 10.0 * random.standard_normal((3, 30))
    low, high = -np.abs(random.standard_normal((3, 6))), np.abs(random.standard_normal((3, 6)))
    if shut:
        low[:, 2] = high[:, 2]
    gram, towards = np.swapaxes(slopes, 1, 2) @ slopes, np.einsum("kmi,km->ki", slopes, errors)
    found = solve_box_qp(gram, towards, low, high)
    assert np.all(found >= low - 1e-12 * np.abs(low))
    assert np.all(found <= high + 1e-12 * np.abs(high))
    remains = np.sum(errors**2, axis=1) + value_at(gram, towards, found)
    for a, b, below, above, own in zip(slopes, errors, low, high, remains):
        free = above > below
        rest = b + a[:, ~free] @ above[~free]
        best = lsq_linear(a[:, free], -rest, (below[free], above[free]), method="bvls")
        assert own == pytest.approx(2.0 * best.cost, rel=1e-3)


def test_beyond_its_bounds_a_parameter_promises_nothing() -> None:
    """A fit that its bounds have stopped leaves what it leaves, alone or beside an effect."""
    fitter, every = made({"sensor_offset.value": 2e-3, "torque_constant": 3.0})
    held = [replace(it, low=0.98 * it.nominal, high=1.02 * it.nominal) for it in fitter.nominal]
    fitter = replace(fitter, nominal=tuple(held))
    retuned = fitter.finish(fitter.fit((), ()))
    assert "low" in retuned.problem.sides(retuned.evidence.vector)
    assert retuned.linearised.left == pytest.approx(retuned.cost, rel=1e-3)
    results = screen((retuned.linearised,), [every["sensor_offset"], every["sensor_nonlinearity"]])
    result = next(it for it in results if it.candidate.name == "sensor_offset")
    found = fit_with(fitter, retuned, [result])
    assert found.cost == pytest.approx(result.left, rel=0.02)


def test_a_delay_is_found_though_the_voltage_jumps_with_the_command() -> None:
    """Each edge of the logged voltage is a sample early or late: the cost is a stair of samples."""
    nominal = model("sg90", "linear")
    step, late = 1.2e-3, 4.3
    times: Array = step * np.arange(900.0)
    pulse = 1e-3 * np.repeat([1.5, 1.8, 1.3, 1.6, 1.9, 1.5], 150)
    delay = nominal.values["transport_delay.time"] + late * step
    rig = changed(nominal, {"transport_delay.time": delay})
    names = {"angle_reading": 1e-4, "motor_voltage": 1e-2}
    random = np.random.default_rng(5)
    told = simulate(rig, times, {"pulse_width": pulse})
    read = {it: told[it] + noise * random.standard_normal(900) for it, noise in names.items()}
    log = log_of(times, {"pulse_width": pulse}, read)
    free = free_parameter(
        nominal.plant.parameters["transport_delay.time"],
        nominal.values["transport_delay.time"],
        0.01,
    )
    fitter = Fitter(nominal, [log], (free,), names)
    found = fitter.fit((), ())
    assert found.values["transport_delay.time"] == pytest.approx(delay, abs=0.1 * step)
    assert found.evidence.rms < 1.2


@pytest.mark.thorough
def test_no_search_ends_on_the_edge_of_a_stair() -> None:
    """There the delay can only fall off, while the other parameters still make up for it."""
    nominal, step, count = model("sg90", "measured"), 1.2e-3, 700
    times: Array = step * np.arange(float(count))
    names = {"angle_reading": 3e-4, "motor_voltage": 3e-3}
    shares = {
        "motor_time_constant": 0.25,
        "motor_gain": 0.2,
        "amplifier_gain": 0.25,
        "transport_delay.time": 0.3,
    }
    known, parameters = nominal.values, nominal.plant.parameters
    free = tuple(
        free_parameter(parameters[name], known[name], share * known[name])
        for name, share in shares.items()
    )
    left = []
    for seed in range(160):
        random = np.random.default_rng(seed)
        pulse = np.repeat(1e-3 * (1.5 + random.uniform(-0.1, 0.1, 7)), 100)
        rig = {
            name: known[name] * (1.0 + share * random.standard_normal())
            for name, share in shares.items()
        }
        inputs = {"pulse_width": pulse}
        told = simulate(replace(nominal, values={**known, **rig}), times, inputs)
        read = {it: told[it] + noise * random.standard_normal(count) for it, noise in names.items()}
        fitter = Fitter(nominal, [log_of(times, inputs, read)], free, names)
        left.append(fitter.fit((), ()).evidence.rms)
    assert max(left) < 1.2


def test_where_nothing_jumps_no_delay_is_moved() -> None:
    fitter, every = made({"transport_delay.time": 2e-3})
    problem = fitter.problem(every["transport_delay"].at({"transport_delay.time": 1e-3}))
    before = problem.memory.evaluations
    assert shifted(problem, problem.start) is None
    assert problem.memory.evaluations == before


def test_the_best_of_many_sizes_has_to_do_more_than_one() -> None:
    fitter, every = made({"sensor_offset.value": 1e-5})
    retuned = fitter.finish(fitter.fit((), ()))
    results = screen((retuned.linearised,), [every["sensor_offset"]])
    found = fit_with(fitter, retuned, results[:1])
    worth = advantage(found.evidence, retuned.evidence)
    beyond = worth - DEFAULT.entry_advantage
    assert beyond > 0.0
    assert passes_entry_test(replace(found, chance=0.0), retuned)
    assert not passes_entry_test(replace(found, chance=0.6 * beyond), retuned)


def test_a_hold_is_seen_though_the_delay_has_made_up_for_it() -> None:
    """A hold is late by half its period, so the delay of a fit without it is too long."""
    nominal = model("sg90", "linear", {"transport_delay.time": 0.02})
    random = np.random.default_rng(12)
    times: Array = 1.6e-3 * np.arange(1200.0)
    pulse = 1e-3 * np.repeat(random.uniform(1.3, 1.7, 40), random.integers(20, 60, 40))[:1200]
    period, noise = 0.0155, 1e-4
    told = simulate(
        changed(nominal, {"sample_hold.period": period}),
        times,
        {"pulse_width": pulse},
    )
    read = {"angle_reading": told["angle_reading"] + noise * random.standard_normal(len(times))}
    log = log_of(times, {"pulse_width": pulse}, read)
    delay = nominal.plant.parameters["transport_delay.time"]
    free = (free_parameter(delay, nominal.values[delay.name], 0.01),)
    fitter = Fitter(nominal, [log], free, {"angle_reading": noise})
    retuned = fitter.fit((), ())
    assert retuned.values[delay.name] > nominal.values[delay.name] + 0.3 * period
    (hold,) = [it for it in candidates(nominal, [log]) if it.name == "sample_hold"]
    result = screen((retuned.linearised,), shortlist(fitter, retuned, [hold]))[0]
    assert result.settings["sample_hold.period"] == pytest.approx(period, rel=3e-3)


def test_half_of_what_a_limit_on_a_rate_does_is_twice_the_rate() -> None:
    """And no small part of a tight one counts: it imitates a lag, and no fit leads away."""
    fitter, every = made({"rate_limit.rate": 5000.0, "null_shift.angle": 2e-3})
    seen = screen((fitter.fit((), ()).linearised,), [every["rate_limit"]])
    assert 2500.0 < seen[0].settings["rate_limit.rate"] < 10000.0
    assert seen[0].at(0.5)["rate_limit.rate"] == 2.0 * seen[0].settings["rate_limit.rate"]
    assert min(it.share for it in seen) > 0.49
