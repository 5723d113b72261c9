"""How well a fitted model predicts what is held out of its fit.

Blocks of time are left out in turn.  The parameters without a block follow from the fit to
all by one Gauss-Newton step, which is exact for a linear model, so nothing is fitted again.
Errors of a model that is not quite right are coloured: a difference between two models is
judged block by block, not sample by sample.
Sources: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd ed., sec.
7.10 (cross-validation); Allen, Technometrics 16 (1974) (leave-out by one step).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.statistics import inflation, rms
from servo_models.core.types import Array
from servo_models.identification.linear_inference import Linearisation
from servo_models.identification.problem import Problem

BLOCKS = 20  # blocks of time, over all logs
LARGEST_CHANGE_OVER_ERRORS = 1.0  # change of a block's errors up to which slopes are trusted
LEAST_LOSS_OVER_LARGEST = 1e-12  # squared errors of a block below which they are none
SIGN_DRAWS = 999  # draws of random signs that a sum over blocks is compared with
CLEAR = 0.1  # error beyond the floor, over the floor, from which a share of the rest means anything


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """A fitted model judged on blocks that are held out, errors in noise floors.

    Attributes:
        vector: the fit, in scales.
        unseen: errors of each block by the fit without it, shape (m,).
        errors: errors of the fit to everything, shape (m,).
        parts: block of each error, shape (m,).
    """

    vector: Array
    unseen: Array
    errors: Array
    parts: NDArray[np.int64]

    @cached_property
    def losses(self) -> Array:
        """Sum of squared unseen errors of each block, shape (blocks,)."""
        return np.bincount(self.parts, self.unseen**2).astype(float)

    @cached_property
    def dispersion(self) -> float:
        """Mean square of the errors, times the samples of which one is independent."""
        return dispersion(self.errors)

    @property
    def independent(self) -> float:
        """How many of the errors are independent, at least 1."""
        return max(float(self.errors @ self.errors) / self.dispersion, 1.0)

    @property
    def rms(self) -> float:
        """Held-out error in noise floors."""
        return rms(self.unseen)


def blocks(problem: Problem) -> NDArray[np.int64]:
    """Return the block of every weighted error of a problem, shape (m,).

    All outputs of one stretch of time are in one block; each log has its own, in proportion to
    its length.
    """
    lengths = [int(log.fitted.sum()) for log in problem.logs]
    total = sum(lengths)
    made, first = [], 0
    for log, length in zip(problem.logs, lengths):
        count = min(max(2, round(BLOCKS * length / total)), length)  # none of a log held out whole
        within = first + np.arange(length) * count // max(length, 1)
        made += [within] * len(log.outputs)
        first += count
    return np.concatenate(made)


def cross_validate(
    problem: Problem, linear: Linearisation, parts: NDArray[np.int64], held: Sequence[int] = ()
) -> CrossValidation:
    """Return the errors of a fit on each block, with the block left out of the fit.

    Args:
        problem: with the fit's free parameters and weights.
        linear: errors and slopes at the fit.
        parts: block of each error, see ``blocks``.
        held: parameters that stay, since the response jumps with them, or a bound holds
            them.
    """
    n = problem.samples
    slopes = linear.slopes.copy()
    slopes[:, list(held)] = 0.0
    errors = linear.errors[:n]
    gram = slopes.T @ slopes
    gram += 1e-12 * np.trace(gram) * np.eye(len(linear.vector))
    unseen = errors.copy()
    for k in range(int(parts.max()) + 1):
        rows = np.flatnonzero(parts == k)
        block, error = slopes[rows], errors[rows]
        step = np.linalg.lstsq(gram - block.T @ block, block.T @ error, rcond=None)[0]
        change = block @ step
        size, most = np.linalg.norm(change), LARGEST_CHANGE_OVER_ERRORS * np.linalg.norm(error)
        unseen[rows] += change * (most / size if size > most else 1.0)
    return CrossValidation(linear.vector, unseen, errors, parts)


def dispersion(errors: Array) -> float:
    """Mean square of errors, times the samples of which one is independent."""
    return max(float(np.mean(errors**2)), 1e-30) * inflation(errors)


class Judged(Protocol):
    """Anything judged on blocks that are held out."""

    @property
    def losses(self) -> Array:
        """Sum of squared unseen errors of each block, shape (blocks,)."""


def advantage(better: CrossValidation, worse: CrossValidation, by_chance: bool = False) -> float:
    """Return twice the log likelihood ratio on unseen blocks, in independent samples.

    Errors of the better model say how many samples are independent.  If it may be better only
    ``by_chance``, since the worse one may be right, those of the worse one say so as well.
    """
    scale = better.dispersion
    if by_chance:
        scale = float(np.sqrt(scale * worse.dispersion))
    return float((worse.losses - better.losses).sum()) / scale


def consistency(better: Judged, worse: Judged) -> float:
    """Return the probability of so many blocks in favour by chance.

    They speak in two ways, and either will do: how often the errors fall, whatever their size
    (Wilcoxon signed rank), and how surely their sum does, since an effect such as a limit may show
    in a part of the log only (signs at random; Bonferroni's bound for the two).
    """
    # a block that neither can improve, such as rest on the codes of a reading, has no say
    told = (worse.losses > 0.0) | (better.losses > 0.0)
    more, less = worse.losses[told], better.losses[told]
    saved = more - less
    if not np.any(saved):
        return 1.0
    least = LEAST_LOSS_OVER_LARGEST * max(more.max(), less.max())
    ratios = np.maximum(more, least) / np.maximum(less, least)
    often = signed_rank(np.log(ratios))
    signs = np.random.default_rng(0).choice((-1.0, 1.0), (SIGN_DRAWS, len(saved)))
    surely = (1.0 + np.count_nonzero(signs @ saved >= saved.sum())) / (1.0 + SIGN_DRAWS)
    return float(min(1.0, 2.0 * min(often, surely)))


def signed_rank(values: Array) -> float:
    """Return the probability of so large a sum of signed ranks if either sign is as likely.

    Ranks are those of sizes, without zeros; equal sizes share theirs.  All ways to draw signs are
    counted, rank by rank.
    Source: Wilcoxon, Biometrics Bulletin 1 (1945).
    """
    values = values[values != 0.0]
    _, place, count = np.unique(np.abs(values), return_inverse=True, return_counts=True)
    doubled = (2 * np.cumsum(count) - count + 1)[place]  # whole numbers, where ranks are shared too
    chances = np.ones(1)  # of each sum of the doubled ranks with a positive sign
    for rank in doubled:
        without = np.zeros(rank)
        chances = 0.5 * (np.append(chances, without) + np.append(without, chances))
    return float(chances[doubled[values > 0.0].sum() :].sum())


def closed(before: float, after: float, floor: float) -> float | None:
    """Return the share of the reducible gap [RMS] that is closed, at most 1; None for nothing to
    reduce."""
    beyond = before - floor
    return min((before - after) / beyond, 1.0) if beyond > CLEAR * floor else None
