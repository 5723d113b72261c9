"""What is left is learnt as a shape, on rigs of the withheld simulator, which knows no map."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from servo_models.catalogue import model
from servo_models.core.block import Block
from servo_models.core.plant import Placement
from servo_models.core.types import Array
from servo_models.core.workers import Workers
from servo_models.data.audit import audits, noise_floors
from servo_models.data.description import Description, read_description
from servo_models.data.parameters import read_parameters, write_parameters
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.residual_map import Curve, ResidualMap, form, learn
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.effects.residual_map import CURVES, residual_drive, residual_torque
from servo_models.errors import UserError
from servo_models.identification.problem import prior_parameters
from servo_models.withheld.generator.cases import EASY, Case, draw_case
from servo_models.withheld.generator.files import write_case
from tests.support.document import ROOT
from tests.support.schemas import check_schema

SEED = 77


def case_of(kind: str, cause: str = "") -> Case:
    """The first case of a seed that is of a kind, and has a cause."""
    for number in range(400):
        case = draw_case(SEED, number, EASY)
        if case.kind == kind and cause in ("", *(one.name for one in case.acting)):
            return case
    raise AssertionError(f"no {kind} with {cause}")


def description_of(case: Case, folder: Path) -> Description:
    write_case(folder, "rig", case)
    return read_description(folder / "cases" / "rig" / "description.toml")


def retuned(told: Description) -> FittedModel:
    """Nominal parameters fitted, without any effect."""
    floors = noise_floors(audits(told.logs, told.model.plant))
    fitter = Fitter(told.model, told.logs, prior_parameters(told), floors, Workers(1))
    return fitter.finish(fitter.fit((), ()))


def beside_line(curve: Curve, values: Array) -> Array:
    """Values at the knots without a straight line, which damping of the model may hold."""
    weights = np.sqrt(curve.samples)
    line = np.column_stack([np.ones(len(values)), curve.knots])
    found = np.linalg.lstsq(line * weights[:, None], values * weights, rcond=None)[0]
    return np.asarray((values - line @ found) * weights)


@pytest.fixture(scope="module")
def dragged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Case, FittedModel, ResidualMap]:
    case = case_of("foreign", "quadratic_drag")
    fitted = retuned(description_of(case, tmp_path_factory.mktemp("dragged")))
    found = learn(fitted)
    assert found is not None
    return case, fitted, found


Dragged = tuple[Case, FittedModel, ResidualMap]


@pytest.mark.long
def test_a_quadratic_drag_is_learnt_as_such(dragged: Dragged) -> None:
    case, fitted, found = dragged
    assert found.size == "torque"
    assert found.curves[0].regressor == "rate"
    (acting,) = case.acting
    drag = acting.settings(case.experiment)["load.quadratic_drag"]
    curve = found.curves[0]
    truth = beside_line(curve, drag * curve.knots * np.abs(curve.knots))
    learnt = beside_line(curve, curve.values)
    assert np.sqrt(np.mean((learnt - truth) ** 2)) < 0.2 * np.ptp(truth)
    left, noise = found.after**2, fitted.left.noise**2
    assert (found.before**2 - left) / (found.before**2 - noise) > 0.8


@pytest.mark.thorough
@pytest.mark.parametrize("acts", [residual_torque, residual_drive, None])
def test_a_plant_that_has_a_part_of_the_map_learns_that_part(
    dragged: Dragged, tmp_path: Path, acts: Block | None
) -> None:
    """As one of one's own may: a curve of the rate, on one wire or on none."""
    case, *_ = dragged
    told = description_of(case, tmp_path)
    kept = (CURVES["rate"], acts)
    chain = [
        link
        for link in told.model.plant.chain
        if not isinstance(link, Placement) or link.name != "residual_map" or link.effect in kept
    ]
    plant = replace(told.model.plant, chain=tuple(chain))
    variant = replace(told.model.actuator.variant(told.model.variant), plant=None)
    own = replace(told.model.actuator, plant=plant, variants=(variant,))
    chosen = model(own, told.model.variant)
    assert "residual_map" not in {it.name for it in candidates(chosen, told.logs)}
    found = learn(retuned(replace(told, model=chosen)))
    if acts is not residual_torque:  # a drag is no drive: the amplifier saturates
        assert found is None
        return
    assert found is not None
    assert [curve.regressor for curve in found.curves] == ["rate"]
    assert found.size == "torque"
    assert {it for it in found.values if it.startswith("residual_map.")} == {
        it for it in chosen.values if it.startswith("residual_map.")
    }


def test_its_parameters_are_the_fit_that_is_told(dragged: Dragged) -> None:
    """Normalised to the largest knot, they give the errors of the fit."""
    _, fitted, found = dragged
    again = replace(fitted.problem, free=[])
    ours = again.errors_with(found.values)
    own = found.fitted.linearised.errors[: fitted.problem.samples]
    assert ours == pytest.approx(own, abs=1e-6 * np.abs(own).max())


@pytest.mark.thorough
def test_where_nothing_is_missing_it_is_silent(tmp_path: Path) -> None:
    assert learn(retuned(description_of(case_of("nothing"), tmp_path))) is None


def test_a_model_that_has_a_map_on_is_given_no_other(dragged: Dragged, tmp_path: Path) -> None:
    case, _, found = dragged
    told = description_of(case, tmp_path)
    model = replace(told.model, values={**told.model.values, **found.values})
    assert learn(retuned(replace(told, model=model))) is None


@pytest.mark.long
def test_it_goes_from_the_log_into_a_parameter_file(dragged: Dragged, tmp_path: Path) -> None:
    case, *_ = dragged
    found = diagnose(description_of(case, tmp_path), jobs=1)
    document = json.loads(found.to_json())
    check_schema(document)
    assert document["verdict"] == "outside-catalogue"
    assert "the square of the rate" in document["sentence"]
    before, after = (document["residual_map"][key] for key in ("before", "after"))
    assert before**2 - after**2 > 0.8 * (before**2 - 1.0)  # of what is above the noise
    assert found.residual_map is not None
    write_parameters(found.map_parameter_set(), tmp_path / "MAP.toml")
    read = read_parameters(tmp_path / "MAP.toml").settings()
    assert read["residual_map.torque"] == found.residual_map.values["residual_map.torque"]


def test_without_a_map_there_is_no_file_of_it(tmp_path: Path) -> None:
    found = diagnose(ROOT / "examples" / "gimbal" / "gimbal.toml", jobs=1)
    with pytest.raises(UserError, match="no residual map"):
        found.map_parameter_set()


X = np.linspace(-4.0, 3.0, 9)
FORMS = {
    "grows in proportion to the rate": 2.0 * X + 1.0,
    "grows with the square of the rate": 0.3 * X * np.abs(X),
    "grows with the square of the rate, the same way whichever its sign": X * X,
    "grows in proportion to the rate, where that is positive only": np.maximum(X, 0.0),
    "grows with the square of the rate, 3 times as much where that is negative": np.where(
        X > 0.0, X * X, -3.0 * X * X
    ),
    "depends on the rate in no simple way": np.sin(2.5 * X),
}


@pytest.mark.parametrize("words", FORMS)
def test_simple_forms_are_told_in_words(words: str) -> None:
    samples = np.full(len(X), 100)
    assert form(Curve("rate", "shaft_speed", X, FORMS[words], 0.0 * X, samples)) == words


@given(slope=st.floats(-3.0, 3.0), power=st.sampled_from([2.0, 3.0]))
def test_a_power_is_told_whatever_line_stands_beside_it(slope: float, power: float) -> None:
    curve = np.sign(X) * np.abs(X) ** power + slope * X
    found = form(Curve("load", "load_torque", X, curve, 0.0 * X, np.full(len(X), 100)))
    assert found == f"grows with the {'square' if power == 2.0 else 'cube'} of the load"


@pytest.mark.parametrize("seen", [5, 6, 7, 9])
def test_noise_makes_no_power_of_a_proportion(seen: int) -> None:
    """Each with a probability of 2 % at the most."""
    random = np.random.default_rng(seen)
    x = np.linspace(-1.0, 1.0, seen)
    noisy = [x + 0.01 * random.standard_normal(seen) for _ in range(300)]
    curves = [Curve("rate", "speed", x, y, 0.0 * x, np.full(seen, 100)) for y in noisy]
    bent = sum("proportion" not in form(curve) for curve in curves)
    assert binomtest(bent, len(curves), 0.02, alternative="greater").pvalue > 1e-3


def test_a_bend_that_nobody_sees_is_no_power() -> None:
    curve = Curve("rate", "speed", X, X + 0.02 * X * np.abs(X), 0.0 * X, np.full(len(X), 100))
    assert form(curve).startswith("grows in proportion to the rate")


def test_a_kink_is_told_as_one() -> None:
    curve = np.maximum(X - X[5], 0.0) - 0.5 * X
    found = form(Curve("command", "goal", X + 10.0, curve, 0.0 * X, np.full(len(X), 100)))
    assert found == "has a kink in the command"


def test_outside_of_its_range_a_curve_is_held() -> None:
    curve = Curve("rate", "shaft_speed", X, X**2, 0.0 * X, np.full(len(X), 1))
    assert curve.at(np.array([-9.0, 9.0])) == pytest.approx([16.0, 9.0])
