"""Blocks that speak for an effect: how often their errors fall, and how surely the sum does."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.stats import wilcoxon

from servo_models.core.types import Array
from servo_models.diagnosis.search.crossval import CrossValidation, consistency, signed_rank

BLOCKS, ROWS = 20, 50


def judged(sizes: Array, seed: int) -> CrossValidation:
    """Errors at random of a size in each block."""
    random = np.random.default_rng(seed)
    errors = np.repeat(sizes, ROWS) * random.standard_normal(BLOCKS * ROWS)
    return CrossValidation(np.empty(0), errors, errors, np.repeat(np.arange(BLOCKS), ROWS))


def chances(better: Array, worse: Array, count: int = 200) -> Array:
    pairs = [(judged(better, 2 * seed), judged(worse, 2 * seed + 1)) for seed in range(count)]
    return np.array([consistency(one, other) for one, other in pairs])


@pytest.mark.thorough
def test_two_that_are_alike_differ_by_chance_as_often_as_is_said() -> None:
    """Of 2000 pairs; more than 0.065 would be three standard errors above 0.05."""
    even = np.ones(BLOCKS)
    assert np.mean(chances(even, even, 2000) < 0.05) < 0.065


@pytest.mark.parametrize("loud", [1.0, 30.0])
def test_little_in_most_blocks_is_no_chance_whatever_one_of_them_does(loud: float) -> None:
    worse = np.full(BLOCKS, 1.3)
    worse[7] = loud
    better = worse / 1.3
    better[7] = loud
    assert np.mean(chances(better, worse) < 0.05) > 0.95


def test_much_in_six_blocks_is_no_chance_although_others_are_as_they_were() -> None:
    """Six signs alike are one in 64, twice that for two ways to ask."""
    worse = np.ones(BLOCKS)
    worse[[2, 3, 7, 11, 12, 17]] = 10.0
    assert np.all(chances(np.ones(BLOCKS), worse) < 0.05)


def test_much_in_one_block_may_be_chance() -> None:
    worse = np.ones(BLOCKS)
    worse[7] = 10.0
    assert np.mean(chances(np.ones(BLOCKS), worse) < 0.05) < 0.15


def test_rest_that_both_meet_exactly_has_no_say() -> None:
    """As on the codes of a reading, which a quantised simulation meets to the last bit."""
    worse, better = np.full(BLOCKS, 1.3), np.ones(BLOCKS)
    worse[:3] = better[:3] = 0.0
    assert np.mean(chances(better, worse) < 0.05) > 0.95
    worse[5] = 0.0
    assert np.all(np.isfinite(chances(better, worse, 20)))


def test_the_same_errors_say_nothing() -> None:
    same = judged(np.ones(BLOCKS), 0)
    assert consistency(same, same) == 1.0


@pytest.mark.parametrize("count", [1, 6, 20, 50])
def test_signed_ranks_are_those_of_wilcoxon(count: int) -> None:
    for seed in range(20):
        values = np.random.default_rng(seed).normal(0.3, 1.0, count)
        expected = wilcoxon(values, alternative="greater", method="exact").pvalue
        assert signed_rank(np.append(values, 0.0)) == pytest.approx(expected, rel=1e-9)


def test_equal_sizes_share_their_rank() -> None:
    """All signs are drawn, one by one."""
    values = np.array([2.0, -1.0, 2.0, 3.0, -2.0, 1.0, 5.0])
    ranks = np.array([4.0, 1.5, 4.0, 6.0, 4.0, 1.5, 7.0])
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(ranks))))
    expected = np.mean(signs @ ranks >= np.sign(values) @ ranks)
    assert signed_rank(values) == pytest.approx(expected, rel=1e-12)
