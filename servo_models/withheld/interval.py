"""Figures with 95 % intervals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

CONFIDENCE = 0.95
DRAWS, SEED = 2000, 0
"""Of the bootstrap of a mean."""


@dataclass(frozen=True)
class Figure:
    """A figure, its 95 % interval, and the number of cases behind it; None for no cases."""

    value: float | None
    low: float | None
    high: float | None
    n: int


NONE = Figure(None, None, None, 0)


def share(flags: Iterable[bool]) -> Figure:
    """Return the share that is true, with its Wilson interval.

    Source: E. B. Wilson, J. American Statistical Association 22 (1927) 209.
    """
    from scipy.stats import binomtest

    found = list(flags)
    if not found:
        return NONE
    test = binomtest(sum(found), len(found))
    interval = test.proportion_ci(CONFIDENCE, method="wilson")
    return Figure(float(test.statistic), float(interval.low), float(interval.high), len(found))


def mean(values: Iterable[float]) -> Figure:
    """Return the mean, with its bootstrap interval (percentiles).

    Source: Efron, Tibshirani, An Introduction to the Bootstrap (1993), ch. 13.
    """
    found = np.array(list(values), dtype=float)
    if not len(found):
        return NONE
    drawn = np.random.default_rng(SEED).choice(found, (DRAWS, len(found))).mean(axis=1)
    low, high = np.quantile(drawn, [0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0])
    return Figure(float(found.mean()), float(low), float(high), len(found))
