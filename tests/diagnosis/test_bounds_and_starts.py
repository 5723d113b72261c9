"""Fits at their bounds, starts where a look was, what cannot be simulated, sizes seen once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.diagnosis.search import grid_search as staircases
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.joint_fits import best_start, fit_with
from servo_models.diagnosis.search.priors import prior_parameters
from servo_models.diagnosis.search.screening import (
    Detectability,
    detectability,
    likeliest,
    screen,
    screening_results,
)
from servo_models.diagnosis.search.selection import select_effects
from servo_models.errors import UserError
from servo_models.identification.problem import REFUSED
from tests.support.delayed_motor import DESCRIPTION, describe
from tests.support.diagnoses import made


@pytest.mark.parametrize("effects", [{}, {"coulomb_friction.level": 2e-3}])
def test_a_bound_holds_without_a_block_as_it_does_with_it(effects: dict[str, float]) -> None:
    """Fits without each block in turn, of a constant that its prior keeps four times too near."""
    fitter, _ = made(effects)
    constant, friction = fitter.nominal
    near = replace(constant, prior=0.1, scale=0.1, low=constant.nominal - 0.4)
    fitter = replace(fitter, nominal=(near, friction))
    found = fitter.finish(fitter.fit((), ()))
    assert found.problem.sides(found.linearised.vector)[0] == "low"
    (log,), parts = fitter.logs, found.evidence.parts
    unseen = np.empty(len(parts))
    for block in range(parts.max() + 1):
        rest = replace(fitter, logs=[replace(log, held_out=parts == block)])
        without = rest.finish(rest.fit((), (), found.values))
        errors = fitter.problem().residuals(without.evidence.vector)[: len(parts)]
        unseen[parts == block] = errors[parts == block]
    assert np.sum(found.evidence.unseen**2) == pytest.approx(np.sum(unseen**2), rel=0.02)


@pytest.mark.parametrize(
    ("name", "size"), [("sensor_nonlinearity.bow", 0.02), ("flux_saturation.curvature", 20.0)]
)
def test_a_fit_begins_where_its_effect_was_seen(name: str, size: float) -> None:
    """An effect with two sizes has been looked at with one of them."""
    fitter, every = made({name: size})
    effect = name.partition(".")[0]
    results = screen([fitter.fit((), ()).linearised], [every[effect]])
    best = [it for it in results if name in it.settings][:1]
    assert best_start(best[0]).cost < 3.0 * best[0].left
    assert fit_with(fitter, fitter.fit((), ()), likeliest(results)).values[name] == pytest.approx(
        size, rel=0.05
    )


def refused() -> Array:
    """Errors by a delay that is longer than its line of samples."""
    fitter, _ = made({})
    (log,) = fitter.logs
    fast = replace(log, times=0.02 * log.times)
    problem = replace(fitter, logs=[fast], floors={"angle": 1e-9}).problem()
    late = {**problem.values(problem.nominal), "transport_delay.time": 0.05}
    with pytest.raises(UserError, match="delay"):
        problem.errors_with(late, strict=True)
    return problem.errors_with(late)


def test_what_cannot_be_simulated_is_worse_than_no_motion_at_all() -> None:
    """With a floor of a millionth of the range, a thousand floors would be a good fit."""
    errors = refused()
    fitter, _ = made({})
    (log,) = fitter.logs
    still = log.outputs["angle"] / 1e-9
    assert np.sqrt(np.mean(errors[: len(still)] ** 2)) > REFUSED * np.sqrt(np.mean(still**2))


def test_what_cannot_be_simulated_is_not_seen() -> None:
    fitter, every = made({})
    (log,) = fitter.logs
    fitter = replace(fitter, logs=[replace(log, times=0.02 * log.times)])
    one = replace(every["transport_delay"], trial_values=({"transport_delay.time": 0.05},))
    nominal = fitter.at_values((), (), {free.name: free.nominal for free in fitter.nominal})
    assert screen([nominal.linearised], [one]) == []
    assert detectability(screening_results([nominal.linearised], [one]), [one]) == {
        "transport_delay": Detectability()
    }


def test_an_uncertain_size_of_an_effect_is_free_once(tmp_path: Path) -> None:
    """It is a nominal parameter then; an uncertain shape of an effect that is off says nothing."""
    text = DESCRIPTION.format("").replace(
        "[uncertainty]",
        '[uncertainty]\n"backlash.half_width" = "0.01 deg"\n"stribeck_friction.speed" = "20 %"',
    )
    told = read_description(describe(tmp_path, text, seconds=0.1))
    names = [free.name for free in prior_parameters(told)]
    assert names.count("backlash.half_width") == 1
    assert "stribeck_friction.speed" not in names
    assert "stribeck_friction" in {one.name for one in candidates(told.model, told.logs)}


@pytest.mark.long
def test_an_uncertain_effect_is_no_candidate() -> None:
    fitter, every = made({})
    (size,) = (
        it for it in every["coulomb_friction"].free if it.name in every["coulomb_friction"].switches
    )
    fitter = replace(fitter, nominal=(*fitter.nominal, replace(size, prior=1e-4)))
    assert "coulomb_friction" not in select_effects(fitter).detectability


def test_every_size_of_a_staircase_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    fitter, every = made({"command_quantisation.step": 0.6})
    retuned = fitter.fit((), ())
    one = every["command_quantisation"]
    results = screen([retuned.linearised], [one])
    seen = []
    before = staircases._over_all

    def spied(*args: object) -> object:
        grid, found = before(*args)  # type: ignore[arg-type]
        seen.extend(tuple(it.settings.items()) for it in found)
        return grid, found

    monkeypatch.setattr(staircases, "_over_all", spied)
    staircases.shortlist(fitter, retuned, [one], results)
    assert len(seen) == len(set(seen)) > 100


@pytest.mark.parametrize("moved", [(0.0, 0.0), (2.0, 0.0), (-1.0, 3.0)])
def test_strained_parameters_count_as_their_priors_say(moved: tuple[float, float]) -> None:
    """Minus the logarithm of two normal densities, beyond that of the nominal values."""
    fitter, _ = made({})
    values = {
        free.name: free.nominal + by * (free.prior or np.nan)
        for free, by in zip(fitter.nominal, moved)
    }
    expected = -sum(norm.logpdf(by) - norm.logpdf(0.0) for by in moved)
    assert fitter.at_values((), (), values).chance == pytest.approx(expected, abs=1e-9)
