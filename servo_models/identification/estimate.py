"""How well a log determines what was estimated from it.

Standard errors, what cannot be told apart, what no log excites, and what to do about it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.identification.covariance import covariance
from servo_models.identification.problem import Free, Problem

Array = NDArray[np.float64]

ALIKE = 0.95
"""Correlation from which two estimates cannot be told apart."""
ILL_CONDITIONED = 1e3
"""Ratio of the largest to the smallest singular value of the slopes with unit columns."""
NOTHING = 1e-6
"""Share of the largest singular value below which the data say nothing of a combination."""
ROUNDING = 1e-12
"""Slope over the largest one, up to which it is what rounding makes of none."""
UNDETERMINED = 0.5
"""Standard error over the value from which a log does not determine a parameter."""
PRIOR_ONLY = 0.8
"""Standard error over the prior from which a log says nothing about a parameter."""
FAR = 3.0
"""Standard deviations of its way from the prior from which an estimate has gone too far."""

NARROW, WIDE = 0.01, 0.3
"""Least and largest step, in scales, over which the slopes behind a standard error are taken."""

ON_LOW, ON_HIGH = "on its low bound", "on its high bound"
FROM_PRIOR = "from its prior only"
PULLED = "pulled off its prior"
NOT_DETERMINED = "not determined"


@dataclass(frozen=True)
class Spread:
    """Uncertainty at the best point, in SI.

    Attributes:
        standard_errors: of each free parameter, NaN on a bound.
        correlations: of the estimates in white noise, shape (p, p), NaN where one is on a
            bound.
        condition: of the slopes with unit columns, over parameters off their bounds.
        on_bound: ``"low"``, ``"high"`` or ``""`` for each.
        slopes: effect of one scale of each parameter on the weighted errors, root of the
            sum of squares.
    """

    standard_errors: Array
    correlations: Array
    condition: float
    on_bound: tuple[str, ...]
    slopes: Array


def spread(problem: Problem, vector: Array, least: Array | None) -> Spread:
    """Return the uncertainty of an estimate; ``vector`` in scales, shape (p,).

    Slopes are taken over about the standard errors that they lead to, and over no less than
    ``least`` [scales], shape (p,), from ``slopes.steps``.
    """
    first = spread_of(problem, vector, problem.jacobian(vector, least))
    widths = np.nan_to_num(first.standard_errors / problem.scales)
    widths = np.where(widths < WIDE, np.maximum(widths, NARROW), NARROW)
    widths = np.where(first.slopes == 0.0, WIDE, widths)
    widths = widths if least is None else np.maximum(widths, least)
    return spread_of(problem, vector, problem.jacobian(vector, widths))


def spread_of(problem: Problem, vector: Array, jacobian: Array) -> Spread:
    """Return the uncertainty of an estimate from slopes that are known, shape (m, p)."""
    at = problem.sides(vector)
    residuals = problem.residuals(vector)
    inner = np.array([not side for side in at])
    p = len(vector)
    errors, correlations = np.full(p, np.nan), np.full((p, p), np.nan)
    slopes = np.sqrt(np.sum(jacobian[: problem.samples] ** 2, axis=0))
    slopes[slopes <= ROUNDING * np.max(slopes, initial=0.0)] = 0.0
    condition = 1.0
    moving = inner & (slopes > 0.0)
    if moving.any():
        units = jacobian[:, moving] / np.linalg.norm(jacobian[:, moving], axis=0)
        _, singular, axes = np.linalg.svd(units, full_matrices=False)
        condition = float(singular[0] / max(singular[-1], 1e-300))
        lost = np.any((axes**2)[singular < NOTHING * singular[0]] > 1e-3, axis=0)
        correlations[np.ix_(moving, moving)] = _correlations(axes, singular)
        variance = np.diag(covariance(problem, jacobian[:, moving], residuals))
        deviation = np.sqrt(np.maximum(variance, 0.0))
        errors[moving] = np.where(lost, np.inf, deviation * problem.scales[moving])
    errors[inner & ~moving] = np.inf
    return Spread(errors, correlations, condition, at, slopes)


def _correlations(axes: Array, singular: Array) -> Array:
    """Correlations of the estimates in white noise, which belong to the experiment alone."""
    floored = np.maximum(singular, 0.1 * NOTHING * singular[0])
    inverse = (axes.T / floored**2) @ axes
    deviation = np.sqrt(np.diag(inverse))
    return np.asarray(inverse / np.outer(deviation, deviation))


def doubt(free: Free, value: float, error: float) -> str:
    """Return in a few words why an estimate is doubtful, "" if it is not; figures in SI."""
    if np.isnan(error):
        return ON_LOW if value - free.low <= free.high - value else ON_HIGH
    if free.prior and error > PRIOR_ONLY * free.prior:
        moved = math.sqrt(max(free.prior**2 - error**2, 0.0))  # how far a fit to noise moves it
        pulled = abs(value - free.nominal) > max(FAR * moved, free.prior)
        return PULLED if pulled else FROM_PRIOR
    return NOT_DETERMINED if error > UNDETERMINED * abs(value) else ""


def is_believable(free: Sequence[Free], values: Array, found: Spread) -> bool:
    """Return whether no estimate [SI] is one that ``warnings`` says not to believe.

    One that is known from its prior only still is what was believed before, and an effect that
    ends at 0 is found not to be needed.
    """
    rows = zip(free, values.tolist(), found.standard_errors.tolist())
    doubts = [doubt(*row) for row in rows if row[1] != 0.0 or not np.isnan(row[2])]
    determined = all(text in ("", FROM_PRIOR) for text in doubts)
    apart = not _alike([one.name for one in free], found.correlations)
    return determined and apart and found.condition <= ILL_CONDITIONED


def warnings(problem: Problem, vector: Array, found: Spread) -> list[str]:
    """Return in words what makes an estimate doubtful, each with its cure."""
    said: list[str] = []
    unseen: list[str] = []
    names = [free.name for free in problem.free]
    for name, side in zip(names, found.on_bound):
        if side:
            said.append(
                f"'{name}' sits on its {side} bound: the data ask for something the model"
                " does not have, or the parameter is not needed"
            )
    for free, value, error, slope in zip(
        problem.free, vector * problem.scales, found.standard_errors, found.slopes
    ):
        reason = doubt(free, value, error)
        if slope == 0.0:
            said.append(
                f"'{free.name}' is not excited by these logs: nothing measured depends on it"
            )
        elif reason == FROM_PRIOR:
            unseen.append(f"'{free.name}'")
        elif reason == PULLED:
            prior = free.prior or 1.0
            said.append(
                f"'{free.name}' was pulled {abs(value - free.nominal) / prior:.2g} prior deviations"
                f" away, though its standard error is {error / prior:.2g} of them: do not believe"
                " it; the errors are hardly noise, so the model lacks something"
            )
        elif reason == NOT_DETERMINED:
            said.append(
                f"the data do not determine '{free.name}': its standard error is"
                f" {_share(error, value)}; fix it, give it a prior, or excite it more"
            )
    if unseen:
        verb, its = ("is", "its prior") if len(unseen) == 1 else ("are", "their priors")
        said.append(
            f"{', '.join(unseen)} {verb} known from {its} only: these logs say nothing about"
            f" {'it' if len(unseen) == 1 else 'them'}"
        )
    said += _alike(names, found.correlations)
    if found.condition > ILL_CONDITIONED:
        said.append(
            f"the fit is ill-conditioned ({found.condition:.0f}): some combination of"
            " parameters is free; fix one of them"
        )
    return said


def _share(error: float, value: float) -> str:
    """A standard error as part of a value, in words."""
    share = error / max(abs(value), 1e-300)
    if share < 10.0:
        return f"{100.0 * share:.0f} % of its value"
    return f"{share:.0f} times its value" if share < 1e6 else "without bounds"


def _alike(names: Sequence[str], correlations: Array) -> list[str]:
    pairs = [
        (i, j)
        for i in range(len(names))
        for j in range(i)
        if abs(correlations[i, j]) > ALIKE  # False for NaN
    ]
    return [
        f"'{names[j]}' and '{names[i]}' cannot be told apart by these logs"
        f" (correlation {correlations[i, j]:+.3f}): fix one of them or log an experiment"
        " that moves only one"
        for i, j in pairs
    ]
