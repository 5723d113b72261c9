"""How well a log determines what was estimated from it.

Standard errors, what cannot be told apart, what no log excites, and what to do about it.
"""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.statistics import autocovariance, inflation, scatter
from servo_models.core.types import Array, Mask
from servo_models.identification.doubts import Doubt
from servo_models.identification.information import MEMBER, WIDE, Information, information, units
from servo_models.identification.problem import Free, Problem

ALIKE_CORRELATION = 0.95
"""Correlation from which two estimates cannot be told apart."""
ILL_CONDITIONED = 1e3
"""Ratio of the largest to the smallest singular value of the slopes with unit columns."""
NOTHING = 1e-6
"""Share of the largest singular value below which the data say nothing of a combination."""
LOST = 1e-11
"""The same where what the data leave open is 0 in the slopes, and priors are counted."""
ROUNDING = 1e-12
"""Slope over the largest one, up to which it is what rounding makes of none."""
UNDETERMINED = 0.5
"""Standard error over the value from which a log does not determine a parameter; over the usual
size of one that may be of either sign."""
PRIOR_ONLY = 0.8
"""Standard error over the prior from which a log says nothing about a parameter."""
FAR = 3.0
"""Standard deviations of its way from the prior from which an estimate has gone too far."""

STANDSTILL = 0.01
"""Change of the errors over what slopes promise, both squared, up to which one is on a tread."""
SMALLEST = 1e-9
"""Standard error in scales below which an estimate is exact: rounding of a simulation."""
TREAD = 4.0
"""Factor by which the end of a tread is sought."""
LONGEST = 12
"""Times that it is sought farther: from the smallest standard error to about 1 % of the scale."""
TREAD_SHARE = 1.0 / np.sqrt(12.0)
"""Standard deviation of a value that may lie anywhere on a tread of length 1."""
NEEDLE = 0.1
"""Distance in scales within which squared errors have to rise for a value that no slope tells."""
DENT = 4.0
"""Rise of the squared errors over the depth of a dent from which it is a needle's."""
REACHES = np.geomspace(1e-5, 0.3, 10)
"""Distances in scales at which that is looked at."""

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
        condition: of the slopes with unit columns, over parameters off their bounds and without
            a prior, beside those that have one.
        on_bound: ``"low"``, ``"high"`` or ``""`` for each.
        slopes: effect of one scale of each parameter on the weighted errors, root of the
            sum of squares, without what is roughness.
        groups: parameters, by position, that the data show only together.
    """

    standard_errors: Array
    correlations: Array
    condition: float
    on_bound: tuple[str, ...]
    slopes: Array
    groups: tuple[tuple[int, ...], ...] = ()


def spread(problem: Problem, vector: Array) -> Spread:
    """Return the uncertainty of an estimate; ``vector`` in scales, shape (p,)."""
    inner = [i for i, side in enumerate(problem.sides(vector)) if not side]
    told = information(problem, vector, inner)
    found = spread_of(problem, vector, told)
    errors = found.standard_errors / problem.scales
    grouped = {i for group in told.groups for i in group}
    for i in inner:
        if problem.free[i].prior is None and i not in grouped:
            along = Axis(problem, vector, i)
            known = np.isfinite(errors[i])
            errors[i] = (
                along.tread(errors[i], found.slopes[i])
                if known
                else along.needle(dent=_dent(told, i))
            )
    return replace(found, standard_errors=errors * problem.scales)


def spread_of(problem: Problem, vector: Array, told: Information) -> Spread:
    """Return the uncertainty of an estimate as slopes tell it, without steps of the response."""
    at = problem.sides(vector)
    inner = np.array([not side for side in at], dtype=bool)
    jacobian, residuals = told.slopes, problem.latest(vector)
    p = len(vector)
    errors, correlations = np.full(p, np.nan), np.full((p, p), np.nan)
    slopes = np.linalg.norm(jacobian[: problem.samples], axis=0)
    slopes[slopes <= ROUNDING * np.max(slopes, initial=0.0)] = 0.0
    condition = 1.0
    known = np.any(jacobian[problem.samples :], axis=0) | (slopes > 0.0)
    moving = inner & known
    if moving.any():
        norms = np.linalg.norm(jacobian[:, moving], axis=0)
        _, singular, axes = np.linalg.svd(jacobian[:, moving] / norms, full_matrices=False)
        condition = _condition(problem, jacobian[:, moving] / norms, moving)
        correlations[np.ix_(moving, moving)] = _correlations(axes, singular)
        free = (
            np.abs(axes[singular < LOST * singular[0]] / norms) / units(problem, vector)[moving]
        )
        lost = np.any(free > MEMBER * free.max(axis=1, keepdims=True), axis=0)
        more = _roughness(problem, told, residuals)
        variance = np.diag(covariance(problem, jacobian[:, moving], residuals, more))
        deviation = np.sqrt(np.maximum(variance, 0.0))
        # a rough surface stops a search where it has a dent, short of what slopes promise
        short = np.linalg.lstsq(jacobian[:, moving], residuals, rcond=NOTHING)[0]
        errors[moving] = np.where(lost, np.inf, np.maximum(deviation, np.abs(short)))
    errors[inner & ~moving] = np.inf
    moves = np.where(told.open, np.maximum(slopes, ROUNDING), slopes)
    return Spread(errors * problem.scales, correlations, condition, at, moves, told.groups)


def _condition(problem: Problem, slopes: Array, moving: Mask) -> float:
    """Condition of slopes with unit columns, of what no prior holds beside what one does."""
    held = np.array([free.prior is not None for free in problem.free])[moving]
    basis = np.linalg.qr(slopes[:, held])[0]
    rest = slopes[:, ~held] - basis @ (basis.T @ slopes[:, ~held])
    singular = np.linalg.svd(rest, compute_uv=False) if rest.size else np.ones(1)
    return float(min(singular[0] / max(singular[-1], 1e-300), 1.0 / ROUNDING))


def _roughness(problem: Problem, told: Information, residuals: Array) -> float:
    """Factor on the variance of errors that are less than the roughness of the response.

    Such a fit has met the very steps of the log, as it may where the model itself made it.
    """
    own = float(np.mean(residuals[: problem.samples] ** 2))
    return max(1.0, 2.0 * float(np.mean(told.jitter)) / max(own, 1e-300))


def _dent(told: Information, which: int) -> float:
    """Squared errors by which the response is rough in parameters other than ``which``."""
    others = np.delete(told.roughness, which)
    return float(np.median(others)) if others.size else 0.0


class Axis:
    """What happens along one parameter, where slopes do not tell it."""

    def __init__(self, problem: Problem, vector: Array, which: int) -> None:
        self.problem, self.vector, self.which = problem, vector, which
        self.errors = problem.latest(vector)[: problem.samples]

    def _sides(self, by: float) -> list[Array]:
        """Weighted errors on both sides, inside the bounds."""
        found = []
        for sign in (1.0, -1.0):
            point = self.vector.copy()
            point[self.which] += sign * by
            values = self.problem.values(np.clip(point, *self.problem.bounds))
            found.append(self.problem.errors_with(values)[: self.problem.samples])
        return found

    def tread(self, error: float, slope: float) -> float:
        """Return a standard error [scales], at least that of a value anywhere on a step's tread.

        A delay beside a hold is known to the tick, however many samples there are.

        Args:
            error: as slopes tell it.
            slope: root of the sum of squares, per scale.
        """
        if error > WIDE:
            return error
        half = error = max(error, SMALLEST)
        for _ in range(LONGEST):
            change = min(float(np.sum((one - self.errors) ** 2)) for one in self._sides(half))
            if change > STANDSTILL * (slope * error) ** 2:
                break
            half *= TREAD
        return error if half == error else max(error, TREAD_SHARE * half)

    def needle(self, right: bool = False, dent: float = 0.0) -> float:
        """Return how far a value may go before the errors tell it [scales], infinity for ever.

        The response to the period of a hold is another one from step to step: only at the right
        one the errors are small.

        Args:
            right: the model is taken for right, and its errors are white with a deviation of 1;
                else they are those of a fit.
            dent: squared errors by which the response differs from itself where other parameters
                are a little other ones: a fit to a rough surface lies in a dent of that depth.
        """
        base = float(self.errors @ self.errors)
        noise = 1.0 if right else base / len(self.errors) * inflation(self.errors)
        noise = max(noise, DENT * dent)
        inside = 0.0
        for by in REACHES:
            sides = self._sides(by)
            if right:
                rise = min(float(np.sum((one - self.errors) ** 2)) for one in sides)
            else:
                rise = min(float(one @ one) for one in sides) - base
            inside = by if rise <= noise else inside
        if inside > NEEDLE:
            return np.inf
        return max(float(inside), float(REACHES[0]))


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
    # an offset near 0 may be well known: what matters is its usual size, not its value
    size = max(abs(value), free.scale) if free.low < 0.0 < free.high else abs(value)
    return NOT_DETERMINED if error > UNDETERMINED * size else ""


def warnings(problem: Problem, vector: Array, found: Spread) -> list[str]:
    """Return in words what makes an estimate doubtful, each with its cure.

    One that is known from its prior only still is what was believed before, and an effect that
    ends at 0 is found not to be needed: neither is a ``Doubt``.
    """
    said: list[str] = []
    unseen: list[str] = []
    names = [free.name for free in problem.free]
    for free, value, error, slope, side in zip(
        problem.free,
        vector * problem.scales,
        found.standard_errors,
        found.slopes,
        found.on_bound,
    ):
        reason = doubt(free, value, error)
        if side:
            text = (
                f"'{free.name}' sits on its {side} bound: the data ask for something the model"
                " does not have, or the parameter is not needed"
            )
            said.append(text if free.switch and value == 0.0 else Doubt(text))
        elif slope == 0.0:
            text = (
                f"'{free.name}' is not excited by these logs: where the fit ended, nothing measured"
                " depends on it; begin with another value, or fix it"
            )
            said.append(text if reason == FROM_PRIOR else Doubt(text))
        elif reason == FROM_PRIOR:
            unseen.append(f"'{free.name}'")
        elif reason == PULLED:
            prior = free.prior or 1.0
            said.append(
                Doubt(
                    f"'{free.name}' was pulled {abs(value - free.nominal) / prior:.2g} prior"
                    f" deviations away, though its standard error is {error / prior:.2g} of them:"
                    " do not believe it; the errors are hardly noise, so the model lacks something"
                )
            )
        elif reason == NOT_DETERMINED:
            said.append(
                Doubt(
                    f"the data do not determine '{free.name}': its standard error is"
                    f" {_share(error, value)}; fix it, give it a prior, or excite it more"
                )
            )
    if unseen:
        verb, its = ("is", "its prior") if len(unseen) == 1 else ("are", "their priors")
        said.append(
            f"{', '.join(unseen)} {verb} known from {its} only: these logs say nothing about"
            f" {'it' if len(unseen) == 1 else 'them'}"
        )
    own = [free.name for free in problem.free if free.prior is None]
    said += [together([names[i] for i in group], own) for group in found.groups]
    said += _alike(names, own, found)
    if found.condition > ILL_CONDITIONED:
        said.append(
            Doubt(
                f"the fit is ill-conditioned ({_short(found.condition)}): some combination of"
                " parameters is free; fix one of them"
            )
        )
    return said


def _short(condition: float) -> str:
    return f"{condition:.0f}" if condition < 1.0 / NOTHING else f"more than {1.0 / NOTHING:.0e}"


def _share(error: float, value: float) -> str:
    """A standard error as part of a value, in words."""
    share = error / max(abs(value), 1e-300)
    if share < 10.0:
        return f"{100.0 * share:.0f} % of its value"
    return f"{share:.0f} times its value" if share < 1e6 else "without bounds"


def together(names: Sequence[str], without_prior: Container[str]) -> str:
    """Return in words that logs show parameters only together, and the cure where one is needed.

    Args:
        names: of the parameters.
        without_prior: those that nothing else is known of; up to one, the others say where it is.
    """
    *some, last = [f"'{name}'" for name in names]
    each = f"{', '.join(some)} and {last}"
    if sum(name in without_prior for name in names) < 2:
        return f"these logs show {each} only together: what each is alone, the priors say"
    return (
        f"{each} cannot be told apart by these logs: they can change together and leave every"
        " output as it is; fix one of them or log an experiment that moves only one"
    )


def _alike(names: Sequence[str], without_prior: Container[str], found: Spread) -> list[Doubt]:
    """Pairs whose estimates hang together, beside the groups of which each has been told, and
    those of which a prior tells one."""
    told = [set(group) for group in found.groups]
    pairs = [
        (i, j)
        for i in range(len(names))
        for j in range(i)
        if abs(found.correlations[i, j]) > ALIKE_CORRELATION  # False for NaN
        and names[i] in without_prior
        and names[j] in without_prior
        and not any({i, j} <= group for group in told)
    ]
    return [
        Doubt(
            f"'{names[j]}' and '{names[i]}' cannot be told apart by these logs"
            f" (correlation {found.correlations[i, j]:+.3f}): fix one of them or log an experiment"
            " that moves only one"
        )
        for i, j in pairs
    ]


def covariance(problem: Problem, jacobian: Array, residuals: Array, more: float = 1.0) -> Array:
    """Covariance of the estimates in scales, shape (p, p).

    The white-noise covariance would be far too small: here it is J+ R J+', with the covariance
    R of the errors from an autoregressive model of each record's residuals.
    Source: Ljung, System Identification, 2nd ed., sec. 9.3.


    Priors are scores of their own with the variance that they claim; that of the errors counts
    ``more`` times.
    """
    norms = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    _, singular, axes = np.linalg.svd(jacobian / norms, full_matrices=False)
    kept = singular > LOST * singular[0]
    half = axes[kept] / singular[kept, None] / norms
    inverse = half.T @ half
    count = problem.samples
    prior = jacobian[count:]
    middle = prior.T @ prior
    start = 0
    for log in problem.logs:
        kept = int(log.fitted.sum())
        if kept == 0:
            continue
        for _ in log.outputs:
            part = slice(start, start + kept)
            own = autocovariance(residuals[part])
            middle = middle + more * scatter(jacobian[part], own)
            start += kept
    freedom = count / max(count - jacobian.shape[1], 1)
    return np.asarray(freedom * inverse @ middle @ inverse)
