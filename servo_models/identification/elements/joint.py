"""Lines and top speeds of both sides of a motor's table in one linear least squares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.types import Array
from servo_models.identification.elements.estimate import (
    Estimate,
    LeastSquares,
    is_bent,
    least_squares,
    rounding,
)
from servo_models.identification.elements.regions import (
    LINE,
    ROUNDS,
    STILL,
    TOP,
    TOP_ROWS,
    Regions,
    Side,
)

JUMP = 3.0
"""Standard errors of a row by which a jump must explain the rows better than a corner."""


@dataclass(frozen=True, eq=False)
class Joint:
    """The fit of a motor's table.

    Attributes:
        sides: positive and negative.
        regions: of the rows of each side.
        corners: sides whose line goes over into the top speed without a jump.
        fit: its unknowns are K, K zero of each side, the top speed of each side that has
            one, and K h if there are both branches.
    """

    sides: Sequence[Side]
    regions: Sequence[Regions]
    fit: LeastSquares
    corners: tuple[int, ...] = ()

    @property
    def tops(self) -> list[int]:
        """Sides that reach a top speed."""
        return _tops(self.regions)

    @property
    def gain(self) -> float:
        """K [rad/s/V]."""
        return float(self.fit.values[0])

    @property
    def has_shift(self) -> bool:
        return len(self.fit.values) > 3 + len(self.tops)

    @property
    def shift(self) -> Estimate | None:
        """2 h [V], None without both branches."""
        return self._over_gain({len(self.fit.values) - 1: 2.0}) if self.has_shift else None

    def zero(self, side: int, branch: float = 0.0) -> Estimate:
        """Where the line of a side meets 0 [V]; with ``branch`` 0 the mean of both branches."""
        weights = {1 + side: 1.0}
        if branch and self.has_shift:
            weights[len(self.fit.values) - 1] = branch
        return self._over_gain(weights)

    def top(self, side: int) -> Estimate:
        """Top speed of a side that has one [rad/s]."""
        return self.fit.estimate(3 + self.tops.index(side))

    def corner(self, side: int) -> Estimate:
        """Where the line of a side meets its top speed [V]."""
        return self._over_gain({1 + side: 1.0, 3 + self.tops.index(side): 1.0})

    def effective(self, side: int) -> Array:
        """Voltage less the shift of its branch [V] at each row of a side."""
        shift = float(self.fit.values[-1]) / self.gain if self.has_shift else 0.0
        return self.sides[side].x - shift * self.sides[side].branch

    def line(self, side: int) -> Array:
        """Speed of the line [rad/s] at each row of a side."""
        return self.gain * (self.effective(side) - self.zero(side).value)

    def is_better(self, squares: float) -> bool:
        """Whether rows explained with ``squares`` less are more than chance."""
        measured = np.concatenate([side.y for side in self.sides])
        return squares > JUMP**2 * self.fit.scatter**2 + rounding(measured)

    def is_bent(self, side: int) -> bool:
        """Whether the line of a side shows a bow."""
        rows = self.regions[side] == LINE
        return is_bent(self.sides[side].x[rows], (self.sides[side].y - self.line(side))[rows])

    def _over_gain(self, weights: Mapping[int, float]) -> Estimate:
        """Weighted sum of unknowns over the gain."""
        gradient = np.zeros(len(self.fit.values))
        for unknown, weight in weights.items():
            gradient[unknown] = weight / self.gain
        value = float(gradient @ self.fit.values)
        gradient[0] -= value / self.gain
        return self.fit.derived(value, gradient)


def fitted(sides: Sequence[Side], regions: Sequence[Regions]) -> Joint:
    """Fit lines and top speeds; a corner at the top unless the rows object to it."""
    joint = Joint(sides, regions, _least_squares(sides, regions))
    for side in joint.tops:
        cornered = _with_corner(joint, side)
        if cornered and not joint.is_better(cornered.fit.squares - joint.fit.squares):
            joint = cornered
    return joint


def _with_corner(joint: Joint, side: int) -> Joint | None:
    """The fit in which a row is at the top speed if the line lies above it there."""
    for _ in range(ROUNDS):
        old = joint.regions[side]
        above = joint.line(side) >= joint.top(side).value
        new = np.where(old == STILL, STILL, np.where(above, TOP, LINE))
        if np.sum(new == TOP) < TOP_ROWS or np.sum(new == LINE) < TOP_ROWS:
            return None
        again = [new if k == side else joint.regions[k] for k in range(len(joint.sides))]
        joint = replace(joint, regions=again, fit=_least_squares(joint.sides, again))
        if np.array_equal(old, new):
            return replace(joint, corners=(*joint.corners, side))
    return None


def _least_squares(sides: Sequence[Side], regions: Sequence[Regions]) -> LeastSquares:
    tops = _tops(regions)
    both = any(side.has_both(found == LINE) for side, found in zip(sides, regions))
    blocks, measured = [], []
    for k, (side, found) in enumerate(zip(sides, regions)):
        line, turns = found == LINE, found != STILL
        slopes = np.zeros((len(side.x), 3 + len(tops) + both))
        slopes[line, 0], slopes[line, 1 + k] = side.x[line], -1.0
        if k in tops:
            slopes[found == TOP, 3 + tops.index(k)] = 1.0
        if both:
            slopes[line, -1] = -side.branch[line]
        blocks.append(slopes[turns])
        measured.append(side.y[turns])
    return least_squares(np.vstack(blocks), np.concatenate(measured))


def _tops(regions: Sequence[Regions]) -> list[int]:
    return [k for k, found in enumerate(regions) if np.any(found == TOP)]
