"""Values of a parameter over units and episodes: their mean, how they vary, and which stand out."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t as student_t

from servo_models.core.types import Array
from servo_models.errors import extra
from servo_models.report.document import Document, Magnitude
from servo_models.survey.job import Estimate

TOLD_PRIORS = 0.5  # standard error over the prior's, above which it is no value of the logs
OUTLIER_CHANCE = 0.01  # probability that noise alone makes any unit of a parameter an outlier
FAR_DEVIATIONS = 5.2  # distance from the median over the median distance; Iglewicz, Hoaglin (1993)
FAR_ERRORS = 3.0  # the same over the value's own standard error, where many values are equal
VAGUE_ERRORS = 5.0  # standard error over the median one, above which an episode tells too little
MOST_UNITS = 60  # units of a mixed model, evenly picked: each costs milliseconds


def told(estimate: Estimate) -> tuple[float, float] | None:
    """Return what logs alone say, value and standard error [SI]; None where they tell no value.

    A mean of estimates would count the prior once for each.  Of one parameter this is exact: the
    precision of the prior is taken off, and its share of the value.
    """
    error, prior = estimate.standard_error, estimate.prior
    share = (error / prior) ** 2 if error and prior else 0.0
    if not error or not math.isfinite(error) or share > TOLD_PRIORS**2:
        return None
    pulled = (estimate.value - estimate.nominal) * share / (1.0 - share)
    return estimate.value + pulled, error / math.sqrt(1.0 - share)


class Pooled(Document, frozen=True):
    """The mean of ``count`` values, its standard error, and the standard deviation between them
    beside their own errors [SI]."""

    mean: float
    error: Magnitude
    between: Magnitude
    count: int

    @property
    def spread(self) -> float:
        """Standard error of the mean as that of one more: how it varies, and the error."""
        return math.hypot(self.between, self.error)


def pooled(values: Array, errors: Array) -> Pooled:
    """Return the mean weighted by the inverse of both variances, between values and their own.

    Args:
        values: shape (n,), at least one.
        errors: their standard errors, above 0, shape (n,).

    Source: Paule, Mandel, J. Res. Natl. Bur. Stand. 87 (1982) 377.

    Example:
        >>> import numpy as np
        >>> pooled(np.array([1.0, 3.0]), np.array([1.0, 1.0])).between
        1.0
    """

    def excess(variance: float) -> float:
        weights = 1.0 / (errors**2 + variance)
        distances = values - weights @ values / weights.sum()
        return float(weights @ distances**2) - (len(values) - 1)

    variance = 0.0
    # one value may round to an excess; at the plain variance of several, there is none
    if len(values) > 1 and excess(0.0) > 0.0:
        variance = brentq(excess, 0.0, float(np.var(values, ddof=1)))
    weights = 1.0 / (errors**2 + variance)
    mean = float(weights @ values / weights.sum())
    return Pooled(mean, float(weights.sum() ** -0.5), math.sqrt(variance), len(values))


def outlying(values: Array, errors: Array) -> tuple[Pooled, list[int]]:
    """Return the mean of the values that do not stand out, and the places of those that do.

    One does where it is further from the mean of the others than their variation, the error of that
    mean and its own allow.  Few values allow much: the distance is that of Student's t.
    """
    distances = np.abs(values - np.median(values))
    near = distances <= FAR_DEVIATIONS * np.median(distances) + FAR_ERRORS * errors
    others = pooled(values[near], errors[near])
    limit = student_t.ppf(1.0 - OUTLIER_CHANCE / 2.0 / len(values), max(others.count - 1, 1))
    far = ~near & (np.abs(values - others.mean) > limit * np.hypot(others.spread, errors))
    return pooled(values[~far], errors[~far]), np.flatnonzero(far).tolist()


class Split(Document, frozen=True):
    """Variances [SI squared] of a parameter over single episodes: between units, between the
    episodes of one, and the rest, which their standard errors explain."""

    unit: Magnitude
    episode: Magnitude
    rest: Magnitude

    @property
    def shares(self) -> list[float]:
        """Of unit, episode and rest in their sum."""
        parts = (self.unit, self.episode, self.rest)
        return [part / (sum(parts) or 1.0) for part in parts]


def split(units: Sequence[str], values: Array, errors: Array) -> Split | None:
    """Return where the variance of episodes' values is from; None where no unit has two.

    A mixed model with a random effect of the unit, fitted by restricted maximum likelihood.  What
    it leaves within a unit is the rest, as far as the standard errors go, else the episode's.

    Args:
        units: of each value.
        values, errors: with their standard errors [SI], shape (n,).

    Source: Pinheiro, Bates, Mixed-Effects Models in S and S-PLUS (2000), sec. 2.2.
    """
    mixed = extra("survey", "statsmodels.regression.mixed_linear_model")
    names, group = np.unique(units, return_inverse=True)
    picked = np.linspace(0, len(names) - 1, MOST_UNITS).round()
    chosen = np.isin(group, picked) & (errors <= VAGUE_ERRORS * np.median(errors))
    values, errors = values[chosen], errors[chosen]
    names, group = np.unique(group[chosen], return_inverse=True)
    if not 1 < len(names) < len(values):
        return None
    scale = float(np.std(values)) or 1.0
    means = np.bincount(group, values) / np.bincount(group)
    if np.ptp(values - means[group]) < 1e-9 * scale:  # of which there is no likelihood
        return Split(float(np.var(means, ddof=1)), 0.0, 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a variance of 0 is on the boundary, and an answer
        model = mixed.MixedLM(values / scale, np.ones((len(values), 1)), groups=group)
        fitted = model.fit(reml=True, method="powell")  # slopes are singular at 0
    within = scale**2 * float(fitted.scale)
    rest = min(float(np.mean(errors**2)), within)
    return Split(scale**2 * float(fitted.cov_re[0, 0]), within - rest, rest)
