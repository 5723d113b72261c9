"""Static characteristic of a motor from rows of voltage and speed, up and down, both ways.

On each side, with voltage and speed counted away from 0, the motor stands still below an
edge, jumps onto the line K (u - zero - b h) and stays at its top speed beyond a second edge;
b is 1 while the voltage rises and -1 while it falls.  Gain K, zeros, half shift h and top
speeds come from one linear least squares over all rows that turn: both sides share the gain
(as in ``plants.hobby_servo.motor_curve``), the shift and the scatter of the speed meter.

An edge *with a jump* lies anywhere between the last row before and the first row after it,
with equal chance: the middle, with the standard error of a uniform distribution.  An edge
*without one* is a corner of fitted lines, with the standard error of their crossing.  A jump
is claimed only where it explains the rows better by more than ``joint.JUMP`` standard errors.
Sources: SG90 paper sec. 4.3, Fig. 8; Hudson, J. Am. Stat. Assoc. 61 (1966) 1097 (joins).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array, Mask
from servo_models.identification.elements.estimate import Estimate, between, combined
from servo_models.identification.elements.joint import Joint, fitted
from servo_models.identification.elements.lines import straight_line
from servo_models.identification.elements.regions import LINE, STILL, TOP, regions, sides

UNEQUAL = 3.0
"""Standard errors from which the gains of the two sides count as different."""


@dataclass(frozen=True)
class SideCurve:
    """One direction of rotation, counted away from 0.

    Attributes:
        gain: of this side alone [rad/s/V].
        zero: voltage at which the line meets speed 0, mean of both branches [V].
        starts, stops: edge with rising and with falling voltage [V]; None without rows.
        edge: mean of both [V], or the one there is.
        width: ``starts`` - ``stops``, the hysteresis at the edge [V].
        saturation: voltage from which the speed stays [V]; None if the table never gets there.
        top: that speed [rad/s].
    """

    gain: Estimate
    zero: Estimate
    starts: Estimate | None
    stops: Estimate | None
    edge: Estimate
    width: Estimate | None
    saturation: Estimate | None
    top: Estimate | None


@dataclass(frozen=True)
class MotorCurve:
    """Both directions.

    Attributes:
        gain: K_EN, of both sides [rad/s/V].
        shift: of the line, rising minus falling [V]; None without both branches.
        positive, negative: the sides.
        unequal: their gains differ by more than chance.
        bent: a line shows a bow.
    """

    gain: Estimate
    shift: Estimate | None
    positive: SideCurve
    negative: SideCurve
    unequal: bool
    bent: bool

    @property
    def width(self) -> Estimate | None:
        """Hysteresis at the edges, mean of both sides [V]; None without both branches."""
        each = [side.width for side in (self.positive, self.negative) if side.width]
        distinct = list(dict.fromkeys(each))
        if len(distinct) < 2:
            return distinct[0] if distinct else None
        return combined(*((0.5, width) for width in distinct))


def motor_curve(voltages: Array, speeds: Array, rising: Mask | None = None) -> MotorCurve:
    """Estimate the static characteristic of a motor.

    Args:
        voltages, speeds: rows [V], [rad/s], shape (n,), in the order in which they were taken.
        rising: whether the voltage was going away from 0, shape (n,); by default told by
            the order of the rows.

    Raises:
        UserError: one direction only, a side that never turns, or too few rows on a line.
    """
    both = sides(voltages, speeds, rising)
    joint = fitted(both, [regions(side) for side in both])
    positive, negative = (_side(joint, k) for k in range(2))
    gap = combined((1.0, positive.gain), (-1.0, negative.gain))
    return MotorCurve(
        gain=joint.fit.estimate(0),
        shift=joint.shift,
        positive=positive,
        negative=negative,
        unequal=abs(gap.value) > UNEQUAL * gap.standard_error,
        bent=joint.is_bent(0) or joint.is_bent(1),
    )


@dataclass(frozen=True)
class _Edge:
    """Where a branch starts or ends to turn; ``rows`` on both sides of a jump."""

    place: Estimate
    rows: tuple[float, float] | None


def _side(joint: Joint, k: int) -> SideCurve:
    side, line = joint.sides[k], joint.regions[k] == LINE
    starts, stops = (_edge(joint, k, branch) for branch in (1.0, -1.0))
    return SideCurve(
        gain=straight_line(joint.effective(k)[line], side.y[line]).gain,
        zero=joint.zero(k),
        starts=starts.place if starts else None,
        stops=stops.place if stops else None,
        edge=_mean(joint, k, starts, stops),
        width=_width(joint, starts, stops),
        saturation=_saturation(joint, k),
        top=joint.top(k) if k in joint.tops else None,
    )


def _edge(joint: Joint, k: int, branch: float) -> _Edge | None:
    """The edge of one branch, None if no row of it turns."""
    side, own = joint.sides[k], joint.sides[k].branch == branch
    still, turns = own & (joint.regions[k] == STILL), own & (joint.regions[k] != STILL)
    if not turns.any():
        return None
    zero, first, line = joint.zero(k, branch), float(np.min(side.x[turns])), joint.line(k)
    held = still & (line > 0.0)
    better = float(np.sum((side.y[held] - line[held]) ** 2 - side.y[held] ** 2))
    if still.any() and not joint.is_better(better):
        return _Edge(
            Estimate(zero.value, zero.standard_error, zero.low, max(zero.high, first)), None
        )
    last = max(float(np.max(side.x[still], initial=0.0)), zero.value)
    return _Edge(between(last, first), (last, first))


def _mean(joint: Joint, k: int, starts: _Edge | None, stops: _Edge | None) -> Estimate:
    """Middle of both branches; two branches between the same rows are one edge seen twice."""
    known = [edge for edge in (starts, stops) if edge]
    if len(known) == 1 or known[0].rows == known[1].rows:
        jump = known[0].rows or len(known) == 1
        return known[0].place if jump else joint.zero(k)
    return combined(*((0.5, edge.place) for edge in known))


def _width(joint: Joint, starts: _Edge | None, stops: _Edge | None) -> Estimate | None:
    if not (starts and stops):
        return None
    if starts.rows is None and stops.rows is None and joint.shift:
        return joint.shift
    return combined((1.0, starts.place), (-1.0, stops.place))


def _saturation(joint: Joint, k: int) -> Estimate | None:
    if k not in joint.tops:
        return None
    if k in joint.corners:
        return joint.corner(k)
    x, found = joint.effective(k), joint.regions[k]
    return between(float(np.max(x[found == LINE])), float(np.min(x[found == TOP])))
