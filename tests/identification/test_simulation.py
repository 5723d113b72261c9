"""Outputs at the instants at which they were read; the internal step of a search, as long as the
noise allows."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuators, model
from servo_models.core.block import Param, block
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log
from servo_models.errors import UserError
from servo_models.identification.problem import Problem, free_parameter
from servo_models.identification.simulation import SHARE, VISIBLE, InternalSteps, prepared
from tests.support.bench import step_constant
from tests.support.logs import changed, log_of

INTERVAL, OWN, TAU = 0.2, 1e-3, 0.25
TIMES = INTERVAL * np.arange(101)
COMMAND = np.repeat([1.0, -0.5, 0.3, 0.8], 26)[: len(TIMES)]


@block("rate")
def lag(
    level: float, u: float, tau: Annotated[float, Param("s", "time constant", default=TAU)]
) -> float:
    """tau x' = u - x."""
    return (u - level) / tau


PLANT = Plant(
    inputs=(Wire("u", "1", "input", low=-10.0, high=10.0),),
    wires=(),
    chain=(lag,),
    states=(State(Wire("level", "1", "state"), "rate"),),
    outputs=("level",),
    constants=step_constant(OWN),
)
LAG = Actuator(
    *("lag", "lag", "lag", "a test", PLANT),
    (Variant("only", "as declared", {}, "a test"),),
    *(1.0, 0.01, ("u", 1.0)),
)


def exact(tau: float = TAU) -> Array:
    """The solution of the lag between two steps of its input is an exponential."""
    level, found = 0.0, []
    for u in COMMAND:
        found.append(level)
        level = u + (level - u) * np.exp(-INTERVAL / tau)
    return np.array(found)


def chosen_for(noise: float) -> tuple[float, Array]:
    """The step that a level of noise allows, and the response with it."""
    log = log_of(TIMES, {"u": COMMAND}, {"level": exact()})
    steps = InternalSteps(model(LAG), {"level": noise})
    run = prepared(steps.model, log, steps)
    return steps.longest(run, ()), run.outputs({})[:, 0]


@pytest.mark.parametrize("noise", [1.0, 1e-3, 1e-5, 1e-6, 1e-7])
def test_noise_hides_what_the_step_does_to_an_exact_solution(noise: float) -> None:
    step, response = chosen_for(noise)
    errors = (response - exact()) / noise
    # the model's own step, by which it is measured, errs by itself
    assert np.sqrt(np.mean(errors**2)) < 1.1 * SHARE
    assert np.sum(errors**2) < 1.1 * VISIBLE
    assert OWN <= step <= 1.001 * INTERVAL


def test_the_quieter_the_shorter() -> None:
    steps = [chosen_for(noise)[0] for noise in (1.0, 1e-5, 1e-7, 1e-14)]
    assert steps[0] == pytest.approx(INTERVAL)
    assert steps == sorted(steps, reverse=True)
    assert len(set(steps)) == len(steps)
    assert steps[-1] == OWN


def servo_log(count: int = 150, **more: object) -> Log:
    times = 0.02 * np.arange(float(count))
    goal = 0.5 * np.sign(np.sin(4.0 * times))
    return log_of(times, {"goal": goal}, {"angle_reading": 0.0 * times}, **more)


SERVO = model(
    "smart_servo", "sts3215", {"sample_hold.period": 0.0, "sensor_quantisation.step": 0.0}
)


def response(log: Log, step: float, effect: dict[str, float], chosen: Model = SERVO) -> Array:
    return prepared(chosen, log).outputs({**effect, "internal_step": step})


@pytest.mark.parametrize("effect", ["", "coulomb_friction.level", "sensor_lag.time_constant"])
def test_half_the_step_changes_less_than_noise_shows_and_a_longer_one_more(effect: str) -> None:
    log, noise = servo_log(), 1e-4
    steps = InternalSteps(SERVO, {"angle_reading": noise})
    names = (effect,) if effect else ()
    found = steps.longest(prepared(SERVO, log), names)
    typical = {effect: SERVO.plant.parameters[effect].param.typical} if effect else {}

    def apart(one: float, other: float) -> float:
        change = (response(log, one, typical) - response(log, other, typical)) / noise
        return float(np.sum(change**2))

    allowed = min(VISIBLE, SHARE**2 * len(log.times))
    assert apart(found, 0.5 * found) < allowed
    assert found <= 0.02001
    if found < 0.015:
        assert apart(2.0 * found, found) > 0.5 * allowed


def test_an_effect_is_given_what_it_needs_whatever_its_size() -> None:
    """A step that hung on whether an effect is on would make a slope at 0 of its own error."""
    log = servo_log()
    steps = InternalSteps(SERVO, {"angle_reading": 1e-4})
    run = prepared(SERVO, log, steps)
    plain, lagged = steps.longest(run, ()), steps.longest(run, ("sensor_lag.time_constant",))
    assert lagged < plain
    off = {"sensor_lag.time_constant": 0.0}
    np.testing.assert_array_equal(run.outputs(off), response(log, lagged, off))
    switched_on = {**SERVO.values, "sensor_lag.time_constant": 1e-3}
    on = prepared(replace(SERVO, values=switched_on), log, steps)
    assert steps.longest(on, ()) == lagged


def test_where_noise_hides_nothing_every_bit_is_that_of_the_model_itself() -> None:
    log = servo_log()
    free = [free_parameter(SERVO.plant.parameters["inertia"], SERVO.values["inertia"], None)]
    quiet = {"angle_reading": 1e-14}
    own = Problem(SERVO, [log], free, quiet)
    same = Problem(SERVO, [log], free, quiet, steps=InternalSteps(SERVO, quiet))
    np.testing.assert_array_equal(same.residuals(same.start), own.residuals(own.start))
    np.testing.assert_array_equal(same.jacobian(same.start), own.jacobian(own.start))


def test_a_step_that_a_log_states_stays() -> None:
    log = servo_log(constants={"internal_step": 5e-4})
    steps = InternalSteps(SERVO, {"angle_reading": 1.0})
    np.testing.assert_array_equal(
        prepared(SERVO, log, steps).outputs({}), response(servo_log(), 5e-4, {})
    )


def test_a_log_of_one_row_has_no_interval() -> None:
    run = prepared(SERVO, servo_log(count=1))
    found = InternalSteps(SERVO, {"angle_reading": 1.0}).longest(run, ())
    assert found == SERVO.values["internal_step"]


def test_a_search_stops_what_is_stiff_and_not_a_firmware_that_ticks_often() -> None:
    """The firmware of the servo ticks every millisecond, twenty times in a row of its log."""
    chosen, log = model("smart_servo", "sts3215"), servo_log()
    steps = InternalSteps(chosen, {"angle_reading": 0.05})
    run = prepared(chosen, log, steps)
    assert steps.longest(run, ()) > 2.0 * chosen.values["sample_hold.period"]
    assert np.all(np.isfinite(run.outputs({})))
    stiff = {"gear_compliance.compliance": 1e-3, "gear_compliance.inertia": 1e-6}
    assert np.all(np.isfinite(prepared(chosen, log).outputs(stiff)))
    with pytest.raises(UserError, match="too many sub-steps"):
        run.outputs(stiff)


def test_a_run_that_grows_without_bound_has_a_finite_cost() -> None:
    tau = -0.05  # s, which makes 1e173 of 1
    log = log_of(TIMES, {"u": COMMAND}, {"level": exact()})
    errors = Problem(model(LAG), [log], [], {"level": 1.0}).errors_with({"tau": tau})
    grown = exact(tau) - exact()
    near = np.abs(grown) < 1e100
    np.testing.assert_allclose(errors[near], grown[near], rtol=1e-3)
    assert np.ptp(grown) > 1e160
    assert np.isfinite(errors @ errors)


@pytest.mark.parametrize("name", ["sg90", "smart_servo", "second_order_servo"])
def test_a_filter_beside_a_delay_takes_no_further_steps(name: str) -> None:
    """A delay cuts steps where its signal changes: one that never rests would cut every step."""
    chosen = model(name)
    inputs = {"sg90": "pulse_width"}.get(name, "goal")
    rest = next(float(it.rest) for it in chosen.plant.inputs if it.name == inputs)
    times = 0.01 * np.arange(100)
    command = rest + (times > 0.1) * (5e-4 if name == "sg90" else 0.5)
    run = prepared(chosen, log_of(times, {inputs: command}, {}))
    steps = [
        chosen.substeps(
            run._vector({"transport_delay.time": 0.00498, "command_lag.time_constant": lag}),
            run.times,
            run.inputs,
        )
        for lag in (0.0, 0.045)
    ]
    assert steps[1] <= 1.1 * steps[0]


# When in its row an output was read


def read_at(rig: Model, times: Array, inputs: dict[str, Array], after: dict[str, float]) -> Array:
    """Outputs in rows that were read so long after the command of their row [s]."""
    names = rig.plant.outputs
    channels = {it: Channel(it, it, "", after_command=after.get(it)) for it in names}
    log = log_of(times, inputs, {it: np.zeros(len(times)) for it in names}, channels=channels)
    return prepared(rig, log).outputs({})


def uneven(step: float, seed: int = 0) -> Array:
    rows = step * np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, 200))
    return np.asarray(rows - rows[0])


@pytest.mark.parametrize("times", [5e-3 * np.arange(200), uneven(5e-3)], ids=["even", "uneven"])
def test_what_is_read_after_its_command_obeys_the_law_of_the_motor(times: Array) -> None:
    """Without an inductance V = R i + k w; just before it the command of the row before is V."""
    rig = changed(model("dc_motor", "direct"), {"winding_lag.time_constant": 0.0})
    voltage = np.repeat(np.random.default_rng(1).uniform(-6.0, 6.0, 40), 5)
    ohm, k = rig.values["resistance"], rig.values["torque_constant"]
    for after, acting in ({}, np.append(0.0, voltage)[:-1]), ({"current": 0.0}, voltage):
        found = dict(zip(rig.plant.outputs, read_at(rig, times, {"voltage": voltage}, after).T))
        law = (acting - k * found["rate"]) / ohm
        np.testing.assert_allclose(found["current"][1:], law[1:], rtol=0, atol=1e-9)


def test_outputs_are_read_at_instants_of_their_own() -> None:
    """As of a simulation that has rows there; an instant may lie beyond the next row."""
    rig, times = model("dc_motor_speed", "direct"), uneven(5e-3)
    speed = np.repeat(np.random.default_rng(2).uniform(-9.0, 9.0, 50), 4)
    after = {"current": 1.3e-3, "encoder_angle": 7.1e-3}
    found = dict(zip(rig.plant.outputs, read_at(rig, times, {"speed_command": speed}, after).T))
    for name in rig.plant.outputs:
        instants = times + after.get(name, 0.0)
        grid = np.union1d(times, instants)
        held = speed[np.searchsorted(times, grid, side="right") - 1]
        there = simulate(rig, grid, {"speed_command": held})[name]
        expected = there[np.searchsorted(grid, instants)]
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=1e-6 * np.ptp(expected))


@pytest.mark.thorough
@pytest.mark.parametrize("name", actuators())
@pytest.mark.parametrize("times", [0.01 * np.arange(200), uneven(7e-3)], ids=["even", "uneven"])
def test_a_reading_with_its_command_changes_no_other_bit(name: str, times: Array) -> None:
    """Nor does it move memories and clocks, whichever effect is on; plain Python does the same."""
    chosen = model(name)
    main, size = chosen.step
    rest = float(chosen.plant.wire[main].rest)
    shape = np.repeat(np.random.default_rng(3).uniform(-0.5, 1.0, 40), 5)
    inputs = {main: rest + np.abs(shape) * (size - rest)}
    last = chosen.plant.outputs[-1]
    columns = [
        inputs.get(wire.name, np.full(len(times), float(wire.rest))) for wire in chosen.plant.inputs
    ]
    for effect in sorted({it.owner for it in chosen.plant.parameters.values()}):
        switches = {
            it: parameter.param.typical or parameter.param.high
            for it, parameter in chosen.plant.parameters.items()
            if effect and parameter.owner == effect and parameter.param.switch
        }
        rig = changed(chosen, switches)
        usual, read = read_at(rig, times, inputs, {}), read_at(rig, times, inputs, {last: 0.0})
        assert np.array_equal(usual[:, :-1], read[:, :-1]), effect
        start, step = rig.stepper()
        x, plain, rows = start(), [], np.column_stack(columns).tolist()
        for k, time in enumerate(times):
            if k:
                step(x, rows[k - 1], times[k - 1], time - times[k - 1])
            plain.append(step(x, rows[k], time, 0.0)[1][-1])
        np.testing.assert_allclose(read[:, -1], plain, rtol=1e-12, atol=1e-12, err_msg=effect)
