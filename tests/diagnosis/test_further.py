"""More than two effects, starts of fits, and what an explanation cannot repeat itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.joint_fits import best_start
from servo_models.diagnosis.search.limit_cycle import unrepeatable
from servo_models.diagnosis.search.residuals import Residuals
from servo_models.diagnosis.search.screening import screen
from servo_models.diagnosis.search.selection import select_effects
from servo_models.diagnosis.stretches import held_out_scores
from servo_models.diagnosis.verdict import EFFECTS, decide
from servo_models.identification.problem import free_parameter
from tests.support.diagnoses import made
from tests.support.logs import changed, measured

THREE = {
    "coulomb_friction.level": 1.5e-3,
    "drive_saturation.limit": 15.0,
    "transport_delay.time": 1.1e-3,
}


@pytest.mark.long
def test_three_causes_are_named_and_no_fourth() -> None:
    fitter, _ = made(THREE)
    selection = select_effects(fitter)
    assert set(selection.taken.effects) == {name.partition(".")[0] for name in THREE}
    assert set(selection.alike[0].effects) == set(selection.taken.effects)
    assert all(len(one.effects) == 3 for one in selection.alike)
    assert decide(selection).kind == EFFECTS
    for name, value in THREE.items():
        assert selection.taken.values[name] == pytest.approx(value, rel=0.05)


def test_two_causes_are_not_joined_by_a_third() -> None:
    fitter, _ = made(dict(list(THREE.items())[:2]))
    selection = select_effects(fitter)
    assert set(selection.taken.effects) == {"coulomb_friction", "drive_saturation"}
    assert not selection.of_size(3)


@pytest.mark.parametrize("name", ["drive_saturation", "coulomb_friction", "gear_compliance"])
def test_a_fit_begins_where_no_more_is_left_than_with_the_effect_as_screened(name: str) -> None:
    fitter, every = made({"coulomb_friction.level": 1.5e-3, "drive_saturation.limit": 15.0})
    linear = fitter.fit((), ()).linearised
    for result in screen((linear,), [every[name]])[:5]:
        begin = best_start(result)
        as_screened = {**result.settings, **result.linearised.start(result.whole)}
        assert begin.cost <= linear.cost(as_screened)
        assert begin.cost <= linear.cost(result.settings)  # the others as they are
        own = {free.name: free.start for free in begin.free}
        assert begin.cost == linear.cost({**begin.values, **own})


@pytest.mark.thorough
def test_a_motion_that_the_effects_make_worse_is_named() -> None:
    """One held-out log is of the rig with its friction, the other of one without it, for which
    parameters alone are right."""
    fitter, _ = made({"coulomb_friction.level": 1.5e-3})
    (log,) = fitter.logs
    plain = replace(
        fitter.model, values={**fitter.model.values, **fitter.finish(fitter.fit((), ())).values}
    )
    noise = 1e-5 * np.random.default_rng(4).standard_normal(len(log.times))
    angle = simulate(plain, log.times, log.inputs)["angle"] + noise
    held = replace(log, name="as fitted", held_out=np.ones(len(log.times), dtype=bool))
    other = replace(held, name="without friction", outputs={"angle": angle})
    selection = select_effects(replace(fitter, logs=[log, held, other]))
    assert selection.taken.effects == ("coulomb_friction",)
    same, plain_one = held_out_scores(selection)
    assert (same.log, plain_one.log) == ("as fitted", "without friction")
    assert not same.worse
    assert same.after == pytest.approx(1.0, abs=0.1)
    assert same.retuned > 10.0
    assert plain_one.worse
    assert plain_one.retuned == pytest.approx(1.0, abs=0.1)
    assert plain_one.after > 10.0


def limit_cycle(effect: str, step: float) -> FittedModel:
    """The servo with a quantiser, its gain half a per cent off as after a fit."""
    nominal = model("sg90", "measured")
    rig = changed(nominal, {f"{effect}.step": step})
    times: Array = 1e-3 * np.arange(1500.0)
    pulse = 1.5e-3 + 1e-4 * np.repeat([0.0, 2.0, -1.0, 3.0, 0.5], 300)
    log = measured(rig, times, {"pulse_width": pulse}, {"angle": 1e-4}, 5)
    name = "amplifier_gain"
    free = free_parameter(
        nominal.plant.parameters[name], nominal.values[name], 0.05 * nominal.values[name]
    )
    fitter = Fitter(nominal, [log], (free,), {"angle": 1e-4})
    every = {one.name: one for one in candidates(nominal, [log])}
    extra = every[effect].at({f"{effect}.step": step})
    values = {name: 1.005 * nominal.values[name], f"{effect}.step": step}
    return fitter.at_values((effect,), extra, values)


def test_a_quantiser_in_the_loop_makes_it_hunt() -> None:
    """The effect's equation in a loop of such a gain has no equilibrium between two codes."""
    assert unrepeatable(limit_cycle("sensor_quantisation", 0.35)) > 1.0


@pytest.mark.parametrize("effect", ["command_quantisation", "reading_quantisation"])
def test_a_quantiser_outside_the_loop_repeats_itself(effect: str) -> None:
    assert unrepeatable(limit_cycle(effect, 0.02)) == 0.0


def test_a_smooth_response_repeats_itself() -> None:
    fitter, _ = made({"drive_saturation.limit": 15.0})
    assert unrepeatable(fitter.fit((), ())) == 0.0


def test_what_cannot_be_repeated_is_taken_off_what_is_left() -> None:
    left = Residuals(structured=5.0, least=4.0, noise=1.0, total=5.1)
    assert left.without(0.0) == left
    assert left.without(3.0) == replace(left, structured=4.0, least=np.sqrt(7.0))
    assert left.without(6.0).structured == left.without(6.0).least == 0.0


@pytest.mark.parametrize("times_as_wrong", [1.0, 1e5])
def test_a_smooth_response_far_from_its_log_repeats_itself(times_as_wrong: float) -> None:
    """Standard errors of a model that is wrong are wide, and its moves end on bounds."""
    fitter, _ = made({"drive_saturation.limit": 15.0})
    fitted = fitter.fit((), ())
    evidence = replace(fitted.evidence, errors=times_as_wrong * fitted.evidence.errors)
    widths = np.full(len(fitted.problem.free), 1e-3)
    assert unrepeatable(replace(fitted, evidence=evidence, widths=widths)) == 0.0
