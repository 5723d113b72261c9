"""From what was tried to what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.core.types import Array
from servo_models.diagnosis import verdict as verdicts
from servo_models.diagnosis.residual_regression import LockedTest
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.selection import Selection, select_effects
from servo_models.diagnosis.verdict import (
    EFFECT,
    EFFECTS,
    NO_GAP,
    OUTSIDE,
    PARAMETERS,
    Verdict,
    decide,
    model_weights,
)
from tests.support.diagnoses import made


def test_of_two_causes_that_are_both_sure_the_larger_one_is_told_first() -> None:
    fitter, _ = made({"transport_delay.time": 1.1e-3, "drive_saturation.limit": 15.0})
    selection = select_effects(fitter)
    verdict = decide(selection)
    assert verdict.kind == EFFECTS
    assert set(selection.taken.effects) == {"transport_delay", "drive_saturation"}
    assert verdict.weights["transport_delay"] > 0.995
    assert selection.of_size(1)[0].effects == ("drive_saturation",)
    assert list(verdict.weights)[:2] == ["drive_saturation", "transport_delay"]


def test_a_verdict_is_printed_as_its_word() -> None:
    assert str(Verdict(EFFECTS, {"backlash": 1.0}, ("backlash",), ())) == "effects"


@pytest.fixture(scope="module")
def friction() -> Selection:
    return select_effects(made({"coulomb_friction.level": 1.5e-3})[0])


def test_what_is_surely_missing_makes_near_equals_equal_and_no_more(friction: Selection) -> None:
    rivals = friction.of_size(1)[:3]
    plain = model_weights(rivals)
    doubtful = [model_weights(rivals, 50.0 * rival.loss) for rival in rivals]
    for chances in doubtful:
        assert abs(chances.sum() - 1.0) < 1e-12
        assert np.all(np.argsort(-chances) == np.argsort([rival.loss for rival in rivals]))
        assert chances.max() <= plain.max()


def wrong_in(one: FittedModel, blocks: Array, random: np.random.Generator) -> FittedModel:
    """A fitted model that leaves white errors of 2 noise floors in some blocks, else of 1."""
    errors = np.repeat(1.0 + blocks, 200) * random.standard_normal(200 * len(blocks))
    parts = np.repeat(np.arange(len(blocks)), 200)
    evidence = replace(one.evidence, unseen=errors, errors=errors, parts=parts)
    return replace(one, evidence=evidence, chance=0.0)


def test_two_models_as_wrong_as_each_other_get_half_each_where_one_posterior_commits(
    friction: Selection,
) -> None:
    """One is wrong in ten blocks, the other in the other ten: which leaves less is chance."""
    half, surely = np.arange(20) % 2 == 0, 0
    for seed in range(20):
        random = np.random.default_rng(seed)
        two = [wrong_in(friction.retuned, blocks, random) for blocks in (half, ~half)]
        best, other = sorted(two, key=lambda one: one.loss)
        apart = (other.loss - best.loss) / (2.0 * best.settings.temper * best.evidence.dispersion)
        surely += apart > np.log(20.0)  # 0.95 and more for the better one
        assert 0.3 < model_weights(two)[0] < 0.7
    assert surely >= 10


def test_what_is_named_is_in_the_set_whatever_is_likelier(friction: Selection) -> None:
    """A likelier one may not have earned its place: both are told then."""
    last = friction.of_size(1)[-1]
    verdict = decide(replace(friction, taken=last))
    assert verdict.weights[last.effects[0]] < 0.01
    assert set(verdict.members) >= {*decide(friction).members, *last.effects}
    assert last in verdict.rivals


@pytest.mark.thorough
@given(st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7))
def test_no_effect_is_surer_than_sure(friction: Selection, parts: list[float]) -> None:
    """One that is in every explanation has all shares, whose sum is 1 but for its rounding."""
    one = friction.retuned
    every = [replace(one, effects=("backlash", f"other {k}")) for k in range(len(parts))]
    shares = np.array(parts) + 1e-9
    selection = Selection(one.evidence, one, every, every[0], {})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verdicts, "weights_of", lambda *_: shares / shares.sum())
        assert max(decide(selection, tolerance=0.0).weights.values()) <= 1.0


@pytest.mark.parametrize(("tolerance", "kind"), [(1.0, OUTSIDE), (2.0, PARAMETERS)])
def test_an_output_that_is_not_followed_counts_from_the_tolerance_that_was_asked_for(
    tolerance: float, kind: str
) -> None:
    """A fit leaves noise of 1.5 floors, which is all that the output moves by."""
    motion = float(np.std(made({})[0].logs[0].outputs["angle"]))
    fitter, _ = made({}, noise=motion / 1.5)
    one = fitter.unfitted()
    noise = 1.5 * np.random.default_rng(0).standard_normal(len(one.evidence.errors))
    left = replace(one, evidence=replace(one.evidence, errors=noise, unseen=noise))
    before = replace(one.evidence, unseen=10.0 * noise)
    verdict = decide(Selection(before, left, [], left, {}), tolerance)
    assert (verdict.kind, verdict.rest) == (kind, 0.0)


def test_unless_asked_the_search_and_the_verdict_allow_the_same_gap() -> None:
    """What a verdict calls no gap, no search explains before."""
    motion = float(np.std(made({})[0].logs[0].outputs["angle"]))
    fitter, _ = made({}, noise=motion)
    assert 0.0 < fitter.unfitted().evidence.rms < 2.0
    selection = select_effects(fitter)
    assert decide(selection).kind == NO_GAP
    assert not selection.fitted


@pytest.mark.parametrize(("p_value", "kind"), [(0.002, OUTSIDE), (1.0, EFFECT)])
def test_errors_that_follow_the_command_are_outside_the_catalogue(
    friction: Selection, p_value: float, kind: str
) -> None:
    """The true effect leaves noise: only the test that is locked to the command speaks here."""
    with pytest.MonkeyPatch.context() as patch:
        locked = LockedTest(p_value, 1e3, 0.5, "rate")
        patch.setattr(verdicts, "command_locked", lambda *_: locked)
        assert decide(friction).kind == kind


@pytest.mark.parametrize(("floors", "kind"), [(1.9, PARAMETERS), (2.1, OUTSIDE)])
def test_a_verdict_without_an_effect_leaves_two_noise_floors_at_most(
    friction: Selection, monkeypatch: pytest.MonkeyPatch, floors: float, kind: str
) -> None:
    """Whatever else calls what is left noise."""
    monkeypatch.setattr(verdicts, "lacks", lambda *_: False)
    monkeypatch.setattr(verdicts, "not_followed", lambda *_: ())
    monkeypatch.setattr(verdicts, "command_locked", lambda *_: LockedTest(1.0, 0.0, 0.0, ""))
    left = replace(friction.retuned.left, structured=floors, least=0.0)
    retuned = replace(friction.retuned)
    vars(retuned)["left"] = left
    assert decide(replace(friction, retuned=retuned, taken=retuned)).kind == kind
