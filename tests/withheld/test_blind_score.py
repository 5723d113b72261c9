"""Figures of a withheld check, on cases made by hand: each is what its definition says."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest
from msgspec import structs

from servo_models.withheld.score import FIGURES, calibration, confusion, mean, share
from servo_models.withheld.sections import BARS, met
from tests.support.withheld_cases import MADE, case

# R. G. Newcombe, Statistics in Medicine 17 (1998) 857, table I, method 3
NEWCOMBE = [
    (81, 263, 0.2553, 0.3662),
    (15, 148, 0.0624, 0.1605),
    (0, 20, 0.0000, 0.1611),
    (1, 29, 0.0061, 0.1718),
]


@pytest.mark.parametrize(("true", "n", "low", "high"), NEWCOMBE)
def test_intervals_of_shares_are_published_ones(true: int, n: int, low: float, high: float) -> None:
    found = share([True] * true + [False] * (n - true))
    assert found.value == pytest.approx(true / n)
    assert found.n == n
    assert found.low == pytest.approx(low, abs=6e-5)
    assert found.high == pytest.approx(high, abs=6e-5)


def test_the_interval_of_a_mean_is_that_of_a_normal_one() -> None:
    values = [math.sin(k) for k in range(400)]
    found = mean(values)
    middle = sum(values) / 400
    error = math.sqrt(sum((v - middle) ** 2 for v in values)) / 400
    assert found.value == pytest.approx(middle)
    assert found.low == pytest.approx(middle - 1.96 * error, abs=0.1 * error)
    assert found.high == pytest.approx(middle + 1.96 * error, abs=0.1 * error)


def test_no_case_is_no_figure() -> None:
    none = {"value": None, "low": None, "high": None, "n": 0}
    assert structs.asdict(share([])) == none
    assert structs.asdict(mean([])) == none


EXPECTED = {
    "separated": (12, 18),
    "first_place": (3, 7),
    "only_true_ones": (2, 7),
    "set_holds": (4, 11),
    "set_coverage": (8, 11),
    "mean_set_size": (1 + 1 + 2 + 2 + 1 + 4, 6),
    "both_named": (1, 2),
    "false_causes": (2, 4),
    "foreign_recall": (1, 3),
    "left_out_recall": (2, 3),
    "wrong_abstention": (3, 14),
    "not_identifiable": (2, 11),
    "owns_up": (1, 7),
    "imitated_told": (1, 2),
    "imitated_listed": (2 + 1, 2),
    "closed_vs_oracle": (11 * 1.0 + 0.5 + 0.0 + 0.0, 14),
    "quantisation_found": (0, 2),
    "calibration_error": (4.0 - 3.9 + 1.25 - 1.0 + 1.0 - 0.6, 8),
    "sure_ones_right": (2, 2),
    "log_loss": (-math.log(0.95 * 0.95 * 0.6 * 0.35 * 0.3 * 0.7), 8),
    "told_surely": (4, 19),
    "seconds_per_case": (2 * 22, 22),
}


@pytest.mark.parametrize("define", FIGURES, ids=lambda it: it.__name__)
def test_a_figure_is_what_its_definition_says(define: Any) -> None:
    part, n = EXPECTED[define.__name__]
    found = define(MADE)
    assert found.n == n
    assert found.value == pytest.approx(part / n)
    assert found.low <= found.value <= found.high


def test_confusions_count_every_case_once() -> None:
    found = confusion(MADE)
    assert found["a"] == {
        "a": 1,
        "a + b": 1,
        "a + c": 1,
        "b": 1,
        "outside-catalogue": 1,
        "failed": 1,
        "parameters": 2,
    }
    assert found["a + b"] == {"a + b": 1, "a": 1, "outside-catalogue": 1}
    assert found["nothing"] == {"parameters": 1, "no-gap": 1, "a": 1, "outside-catalogue": 1}
    assert sum(sum(row.values()) for row in found.values()) == len(MADE)


def test_calibration_sets_what_happened_against_what_was_said() -> None:
    """Cases with an effect in the catalogue and probabilities: 0.3 wrong and right; 0.6 right,
    0.65 wrong; 0.95 twice right; 1 twice right."""
    found = calibration(MADE)
    assert [it.low for it in found] == [0.05, 0.5, 0.9, 0.99]
    assert [it.probability for it in found] == pytest.approx([0.3, 0.625, 0.95, 1.0])
    assert [it.right.value for it in found] == [0.5, 0.5, 1.0, 1.0]
    assert [it.right.n for it in found] == [2, 2, 2, 2]


def test_a_set_that_holds_the_truth_covers_it_whatever_else_may_be_right() -> None:
    """Where parameters imitate the truth, a set with the hidden effect is right as well."""
    for members, covered in (("a b", True), ("b", False)):
        words = ("one", "a", "outside-catalogue", "b", members)
        assert case(*words, hidden="b", absorbed=True).covered is covered
    assert case("one", "a", "effect", "b", "b", hidden="b", absorbed=True).covered


def test_calibration_counts_every_effect_with_a_probability() -> None:
    """Also those beside the most probable one, which is right more often than the others."""
    one = case("one", "a", "effect", "a")
    said = structs.replace(one.said, probabilities={"a": 0.6, "b": 0.65, "c": 0.0})
    found = calibration([replace(one, said=said)])
    assert [(it.low, it.right.n, it.right.value) for it in found] == [(0.0, 1, 0.0), (0.5, 2, 0.5)]


def test_bars_are_met_on_their_side() -> None:
    half = share([True, False])
    assert met(half, (">=", 0.5)) is met(half, ("<=", 0.5)) is True
    assert met(half, (">=", 0.6)) is met(half, ("<=", 0.4)) is False
    assert met(share([]), (">=", 0.5)) is None
    names = {define.__name__ for define in FIGURES}
    assert all(set(bars) <= names for bars in BARS.values())
