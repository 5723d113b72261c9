"""Probabilities that are told: monotone, within bounds, and as often right as they say."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from servo_models.core.types import Array
from servo_models.diagnosis.calibration import (
    DATA,
    LEAST_PROBABILITY,
    MOST_PROBABILITY,
    calibrated,
    doubtful,
    maps,
    probability,
)
from servo_models.diagnosis.verdict import (
    EFFECT,
    EFFECTS,
    NO_GAP,
    NOT_IDENTIFIABLE,
    OUTSIDE,
    PARAMETERS,
)
from servo_models.withheld.score import Case, calibration_error, log_loss
from studies.calibrate import Run, cross_validated, learn, learnt, with_probabilities
from tests.support.withheld_cases import case

SHARES = st.lists(st.floats(0.0, 1.0), min_size=2, max_size=20)
NAMING = (EFFECT, EFFECTS, NOT_IDENTIFIABLE)


def drawn(seed: int, truth: Array, weights: Array, tier: str = "easy") -> list[Case]:
    """Cases of one effect each, which is there with probability ``truth`` and has a weight."""
    there = np.random.default_rng(seed).random(len(truth)) < truth
    made = [case("one", "a", EFFECT, "a" if one else "b") for one in there]
    return [
        replace(
            one,
            tier=tier,
            said=structs.replace(one.said, chances={one.said.named[0]: w}, probabilities={}),
        )
        for one, w in zip(made, weights.tolist())
    ]


def as_told(cases: list[Case]) -> list[Case]:
    """Weights told as probabilities."""
    return [
        replace(one, said=structs.replace(one.said, probabilities=one.said.chances))
        for one in cases
    ]


@given(SHARES, st.sampled_from(NAMING))
def test_what_ships_is_monotone_and_neither_certain_nor_impossible(
    weights: list[float], kind: str
) -> None:
    told = list(calibrated({str(k): w for k, w in enumerate(sorted(weights))}, kind).values())
    assert told == sorted(told)
    assert all(LEAST_PROBABILITY <= one <= MOST_PROBABILITY for one in told)


@given(SHARES, st.data())
def test_a_map_that_is_learnt_is_monotone_whatever_happened(
    weights: list[float], data: st.DataObject
) -> None:
    size = {"min_size": len(weights), "max_size": len(weights)}
    there = np.array(data.draw(st.lists(st.booleans(), **size)), dtype=float)
    counts = np.array(data.draw(st.lists(st.floats(0.1, 10.0), **size)))
    by = learn(np.array(weights), there, counts)
    told = probability(np.linspace(0.0, 1.0, 101), by)
    assert np.all(np.diff(told) >= 0.0)
    assert np.all((told >= LEAST_PROBABILITY) & (told <= MOST_PROBABILITY))


@given(SHARES)
def test_an_effect_that_is_doubted_keeps_its_place_and_is_never_surer(told: list[float]) -> None:
    doubted = [doubtful(one) for one in sorted(told)]
    assert doubted == sorted(doubted)
    assert all(LEAST_PROBABILITY <= one <= MOST_PROBABILITY for one in doubted)


def test_verdicts_that_name_effects_have_a_map_and_others_tell_no_probability() -> None:
    assert set(maps()) == set(NAMING)
    for kind in (OUTSIDE, PARAMETERS, NO_GAP):
        assert calibrated({"backlash": 0.99}, kind) == {}


def test_the_maps_say_where_they_are_from() -> None:
    known = json.loads(DATA.read_text(encoding="utf-8"))
    assert known["seeds"]
    assert known["commits"]
    assert min(known["cases"][tier] for tier in ("easy", "hard", "poor")) >= 300


def test_the_calibration_error_of_what_is_as_often_right_as_it_says_is_small() -> None:
    """Chance alone leaves about sqrt(2 / pi p (1 - p) / n) a bin: 0.01 with 400 in each of ten."""
    truth = np.random.default_rng(0).random(4000)
    error = calibration_error(as_told(drawn(1, truth, truth)))
    assert error.value is not None
    assert error.value < 0.02


def test_the_calibration_error_is_the_mean_distance_over_bins() -> None:
    """Of 0.92 three in four there, of 0.35 none: (4 x 0.17 + 2 x 0.35) / 6."""
    there, gone = case("one", "a", EFFECT, "a"), case("one", "a", EFFECT, "b")
    cases = [
        *(
            replace(it, said=structs.replace(it.said, probabilities={"a": 0.92}))
            for it in 3 * [there]
        ),
        replace(gone, said=structs.replace(gone.said, probabilities={"b": 0.92})),
        *(
            replace(it, said=structs.replace(it.said, probabilities={"b": 0.35}))
            for it in 2 * [gone]
        ),
    ]
    assert calibration_error(cases).value == pytest.approx((4 * 0.17 + 2 * 0.35) / 6)


@pytest.mark.thorough
def test_over_confident_weights_are_mended_on_cases_that_the_map_has_not_seen() -> None:
    """Weights are the truth with its log odds tripled."""
    truth = 0.95 * np.random.default_rng(0).random(6000)
    odds = (truth / (1.0 - truth)) ** 3
    cases = drawn(1, truth, odds / (1.0 + odds))
    fresh, by = cases[3000:], learnt(cases[:3000])
    mended = [with_probabilities(one, by) for one in fresh]
    before, after = calibration_error(as_told(fresh)), calibration_error(mended)
    assert before.value is not None
    assert after.value is not None
    assert before.value > 0.1
    assert after.value < 0.03
    assert (log_loss(mended).value or 0.0) < (log_loss(as_told(fresh)).value or 0.0)


def test_a_tier_counts_as_much_as_another_however_few_its_cases_are() -> None:
    """Of one weight, 900 easy ones are all there and 100 poor ones never: half of both."""
    weights = np.full(900, 0.8)
    cases = [
        *drawn(0, np.ones(900), weights),
        *drawn(0, np.zeros(100), weights[:100], tier="poor"),
    ]
    told = probability(np.array([0.8]), learnt(cases)[EFFECT])
    assert told[0] == pytest.approx(0.5)


def test_a_seed_is_judged_by_maps_that_have_not_seen_it() -> None:
    """Three seeds; in the third the effect is never there, which its own map would know."""
    weights = np.full(200, 0.8)
    truths = (np.ones(200), np.ones(200), np.zeros(200))
    runs = [Run(k, "", drawn(k, truth, weights)) for k, truth in enumerate(truths)]
    told = cross_validated(runs)
    last = [one for run in told[400:] for one in run.said.probabilities.values()]
    assert last == pytest.approx(200 * [MOST_PROBABILITY])
