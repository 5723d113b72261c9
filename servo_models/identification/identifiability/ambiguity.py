"""Differences beside each other: what free parameters explain of them, and which are alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from servo_models.core.types import Array
from servo_models.identification.identifiability.responses import Cause

SINGULAR = 1e-9
"""Share of the largest eigenvalue up to which one of a Gram matrix of unit slopes is rounding."""
ALIKE_COSINE = 0.98
"""Cosine between two differences from which they cannot be told apart."""
EXPLAINED = 1e-6
"""Share of the square of a difference that may be rounding."""


class Comparison:
    """Inner products of all differences, and what remains of them beside free parameters."""

    def __init__(
        self,
        causes: Sequence[Cause],
        asked: Iterable[str],
        priors: Mapping[str, float],
        jitter: Array,
    ) -> None:
        """Roughness of the response counts as noise beside the floor; ``jitter`` is its variance
        [noise floors^2], shape (m,).  Slopes are without it, differences by effects are not."""
        self.causes = causes
        # two simulations differ by twice the variance of each
        self.noise = 1.0 + 2.0 * jitter
        self.differences = np.array([cause.difference for cause in causes]) / np.sqrt(self.noise)
        self.rough = np.array([c.effect for c in causes])[:, None] * (1.0 - 1.0 / self.noise)
        free = set(asked)
        self.free = [i for i, c in enumerate(causes) if c.name in free and not c.effect]
        data = self.differences @ self.differences.T
        own = np.maximum(np.diag(data) - self.rough.sum(axis=1), 0.0)
        self.data = data - np.diag(np.diag(data) - own)
        self.gram = self.data + np.diag([float(c.name in priors) for c in causes])

    def rest(self, *which: int) -> Array:
        """Inner products of what remains of causes beside the free parameters of no one of them.

        Shape (k, k) for k causes.
        """
        own = {self.causes[i].name for i in which} | {
            self.causes[i].owner for i in which if self.causes[i].effect
        }
        others = [
            i
            for i in self.free
            if self.causes[i].name not in own and self.causes[i].owner not in own
        ]
        cross = self.gram[np.ix_(which, others)]
        unit = 1.0 / np.sqrt(np.maximum(self.gram[others, others], 1e-300))
        known = self.gram[np.ix_(others, others)] * np.outer(unit, unit)
        inverse = np.linalg.pinv(known, SINGULAR, hermitian=True) * np.outer(unit, unit)
        return np.asarray(self.gram[np.ix_(which, which)] - cross @ inverse @ cross.T)

    def alike(self, i: int, other: int) -> bool:
        """Return whether two causes look alike beside the other free parameters."""
        rest = self.rest(i, other)
        if (np.diag(rest) <= EXPLAINED * self.gram[[i, other], [i, other]]).any():
            return False
        return bool(abs(rest[0, 1]) > ALIKE_COSINE * np.sqrt(rest[0, 0] * rest[1, 1]))
