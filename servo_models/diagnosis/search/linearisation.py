"""A fit, linear about its estimates: what its parameters would do about a change of the response.

That asks for thousands of small quadratic problems in boxes, solved together: without their bounds
parameters would do wonders, and ten deviations of a stiffness hide an offset.
Source: Portugal, Judice, Vicente, Mathematics of Computation 63 (1994) 625 (block principal
pivoting, one variable at a time where blocks take turns).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array
from servo_models.identification.problem import Problem

BLOCK_EXCHANGES = 8
"""Of all variables on the wrong side of a bound at once."""
SINGLE_EXCHANGES = 40
"""Of one variable at a time, after them."""
COORDINATE_SWEEPS = 3
"""Over single variables, at last."""
RELATIVE_RIDGE = 1e-10
"""On the diagonal, scaled to 1: variables that do the same share what is to do."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A fitted problem, linear about its estimates.

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
    """Return a fit, linearised; unknown slopes are taken over ``widths`` [scales], shape (p,)."""
    errors = problem.latest(vector)
    if slopes is None:
        slopes = problem.jacobian(vector, widths)
    return Linearisation(problem, vector, errors, slopes)


def _orthonormal(slopes: Array) -> Array:
    if slopes.shape[1] == 0:
        return slopes
    left, singular, _ = np.linalg.svd(slopes, full_matrices=False)
    return left[:, singular > 1e-9 * singular[0]]


def least_in_box(gram: Array, gradient: Array, low: Array, high: Array) -> Array:
    """Return z that makes z G z / 2 + g z least between bounds, shape (k, n).

    Args:
        gram: G of each problem, positive semidefinite, shape (k, n, n).
        gradient: g, shape (k, n).
        low, high: bounds, shape (n,) or (k, n), the lower one not above the other.
    """
    size = np.sqrt(np.einsum("kii->ki", gram))
    size = np.where(size > 0.0, size, 1.0)
    gram = gram / (size[:, :, None] * size[:, None, :])
    gradient, low, high = gradient / size, low * size, high * size
    low, high = np.broadcast_to(low, gradient.shape), np.broadcast_to(high, gradient.shape)
    side = np.where(high > low, 0, -1).astype(np.int8)
    z, left = np.zeros_like(gradient), np.arange(len(gradient))
    for k in range(BLOCK_EXCHANGES + SINGLE_EXCHANGES):
        z[left], side[left], wrong = _exchanged(
            gram[left],
            gradient[left],
            low[left],
            high[left],
            side[left],
            single=k >= BLOCK_EXCHANGES,
        )
        left = left[wrong]
        if not len(left):
            break
    z = np.clip(z, low, high)
    curvature = np.maximum(np.einsum("kii->ki", gram), RELATIVE_RIDGE)
    for i in list(range(z.shape[1])) * COORDINATE_SWEEPS:
        slope_i = gradient[:, i] + np.einsum("kj,kj->k", gram[:, i], z)
        z[:, i] = np.clip(z[:, i] - slope_i / curvature[:, i], low[:, i], high[:, i])
    return np.asarray(z / size)


def _exchanged(
    gram: Array,
    gradient: Array,
    low: Array,
    high: Array,
    side: NDArray[np.int8],
    single: bool,
) -> tuple[Array, NDArray[np.int8], NDArray[np.bool_]]:
    """The least with some variables on a side, the sides they should be on, and where they differ.

    Of those that are on the wrong side, only the last changes it where a ``single`` one may.
    """
    free = side == 0
    fixed = np.where(side < 0, low, np.where(side > 0, high, 0.0))
    z = fixed + _unbounded(gram, gradient + _times(gram, fixed), free)
    slope = gradient + _times(gram, z)
    below, above = free & (z < low), free & (z > high)
    back = (high > low) & (((side < 0) & (slope < 0.0)) | ((side > 0) & (slope > 0.0)))
    wrong = below | above | back
    changed = wrong
    if single:
        last = wrong.shape[1] - 1 - np.argmax(wrong[:, ::-1], axis=1)
        changed = wrong & (np.arange(wrong.shape[1]) == last[:, None])
    right = np.where(below, -1, np.where(above, 1, np.where(back, 0, side)))
    return z, np.where(changed, right, side).astype(np.int8), wrong.any(axis=1)


def value_at(gram: Array, gradient: Array, z: Array) -> Array:
    """Return z G z + 2 g z of each problem: the change of a sum of squares, shape (k,)."""
    return np.asarray(np.einsum("ki,ki->k", _times(gram, z) + 2.0 * gradient, z))


def _unbounded(gram: Array, gradient: Array, free: NDArray[np.bool_]) -> Array:
    """The least of each problem over its free variables, the others 0."""
    both = free[:, :, None] & free[:, None, :]
    matrix = np.where(both, gram, 0.0)
    diagonal = np.arange(gram.shape[1])
    matrix[:, diagonal, diagonal] += np.where(free, RELATIVE_RIDGE, 1.0)
    return np.asarray(np.linalg.solve(matrix, np.where(free, -gradient, 0.0)[..., None])[..., 0])


def _times(gram: Array, z: Array) -> Array:
    return np.asarray((gram @ z[..., None])[..., 0])
