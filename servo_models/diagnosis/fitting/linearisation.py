"""Where one looks from: a fit, and what its parameters would do about a change of the response."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.fitting.box import least_in_box, value_at
from servo_models.identification.problem import Problem


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Where one looks from: a fitted problem, linear about its estimates.

    Attributes:
        problem, vector: the fit.
        errors, slopes: there, priors included, shapes (m,) and (m, p).
    """

    problem: Problem
    vector: Array
    errors: Array
    slopes: Array

    @cached_property
    def basis(self) -> Array:
        """Orthonormal, of what parameters can do."""
        return _orthonormal(self.slopes)

    @cached_property
    def gram(self) -> Array:
        """Products of the slopes with each other, shape (p, p)."""
        return np.asarray(self.slopes.T @ self.slopes)

    @cached_property
    def room(self) -> tuple[Array, Array]:
        """How far the parameters may move down and up, each of shape (p,)."""
        low, high = self.problem.bounds
        return np.minimum(low - self.vector, 0.0), np.maximum(high - self.vector, 0.0)

    @cached_property
    def left(self) -> float:
        """Squared errors that nominal parameters cannot take away."""
        towards = self.slopes.T @ self.errors
        step = self._step(towards)
        change = value_at(self.gram[None], towards[None], step[None])[0]
        return float(self.errors @ self.errors + change)

    def without(self, values: Array) -> Array:
        """Return weighted errors, shape (m,) or (m, k), without what the parameters imitate."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))

    def start(self, whole: Array) -> dict[str, float]:
        """Return the estimates [SI] of the fit's parameters beside an effect's difference."""
        step = self._step(self.slopes.T @ (self.errors + whole))
        return self.problem.values(self.vector + step)

    def near_start(self, whole: Array) -> dict[str, float]:
        """Return the same where it costs an error of its own to move a parameter by its scale.

        Slopes that nearly cancel lead far away, and are no longer those of where they lead to.
        """
        own = np.mean(self.errors**2) * np.eye(len(self.vector))
        towards = self.slopes.T @ (self.errors + whole)
        step = least_in_box((self.gram + own)[None], towards[None], *self.room)[0]
        return self.problem.values(self.vector + step)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.pinv(self.gram, rcond=1e-12, hermitian=True))

    def _step(self, towards: Array) -> Array:
        """The step inside the bounds that leaves least, for slopes times errors."""
        step, (low, high) = -self._inverse @ towards, self.room
        if np.all((low <= step) & (step <= high)):
            return np.asarray(step)
        return np.asarray(least_in_box(self.gram[None], towards[None], low, high)[0])

    def cost(self, values: Mapping[str, float]) -> float:
        """Return the squared errors, priors included, that are left with these values [SI]."""
        errors = self.problem.errors_with({**self.problem.values(self.vector), **values})
        return float(errors @ errors)


def linearised(
    problem: Problem, vector: Array, widths: Array | None = None, slopes: Array | None = None
) -> Linearisation:
    """Return the view from a fit; unknown slopes are taken over ``widths`` [scales], shape (p,)."""
    errors = problem.latest(vector)
    if slopes is None:
        slopes = problem.jacobian(vector, widths)
    return Linearisation(problem, vector, errors, slopes)


def _orthonormal(slopes: Array) -> Array:
    if slopes.shape[1] == 0:
        return slopes
    left, singular, _ = np.linalg.svd(slopes, full_matrices=False)
    return left[:, singular > 1e-9 * singular[0]]
