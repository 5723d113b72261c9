"""Rows of a motor's table by what the motor does in them: stand still, follow a line, stay."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Mask
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import LeastSquares, least_squares, rounding

Regions = NDArray[np.int64]

STILL, LINE, TOP = 0, 1, 2
FIRST_GUESS = 0.05
"""Share of the highest speed above which a row counts as turning at first."""
TOP_COST = 4.0
"""Criterion's cost of a top speed, in ln n: its level, and that its edge is searched for."""
LINE_VOLTAGES, TOP_ROWS = 3, 2
LEAST_RISE = 0.05
"""Share of the highest speed by which a line rises at least."""
ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Side:
    """Rows of one direction, counted away from 0.

    Attributes:
        name: in words.
        x, y: voltage [V] and speed [rad/s], shape (n,).
        branch: 1 where the voltage rises, -1 where it falls, shape (n,).
    """

    name: str
    x: Array
    y: Array
    branch: Array

    def has_both(self, rows: Mask) -> bool:
        """Whether there are two rows or more of both branches among ``rows``."""
        up = self.branch[rows] > 0.0
        return bool(np.sum(up) >= 2 and np.sum(~up) >= 2)


def sides(voltages: Array, speeds: Array, rising: Mask | None) -> list[Side]:
    """Return the positive and the negative side.

    Raises:
        UserError: there is but one.
    """
    up = _rising(voltages) if rising is None else rising
    found = []
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        rows = sign * voltages > 0.0
        if not rows.any():
            raise UserError(f"no {name} voltage; add rows of both directions")
        branch = np.where(up[rows], 1.0, -1.0)
        found.append(Side(name, sign * voltages[rows], sign * speeds[rows], branch))
    return found


def _rising(voltages: Array) -> Mask:
    """Whether the voltage goes away from 0 at each row; where it stays, as at the row before."""
    rising = np.ones(len(voltages), dtype=bool)
    first = float(voltages[0])
    later = voltages[np.flatnonzero(voltages != first)[0]] if np.any(voltages != first) else first
    rising[0] = abs(later) >= abs(first) or later * first < 0.0
    for k in range(1, len(voltages)):
        before, now = float(voltages[k - 1]), float(voltages[k])
        crossed = before * now <= 0.0
        rising[k] = rising[k - 1] if now == before else crossed or abs(now) > abs(before)
    return rising


def regions(side: Side) -> Regions:
    """Return the region of each row, shape (n,).

    A row turns if its speed is nearer to the line than to 0; the line and the top speed are
    those of the rows that turn.

    Raises:
        UserError: the motor never turns, or too few rows are on the line.
    """
    if not np.max(side.y) > 0.0:
        raise UserError(
            f"the motor never turns in the direction of {side.name} voltages; add rows beyond the"
            " edge, or correct the sign of the speed"
        )
    turns = side.y > FIRST_GUESS * np.max(side.y)
    for _ in range(ROUNDS):
        found, line = _split(side, turns)
        fitted = _slopes(side, found == LINE) @ line.values
        nearer = (fitted > 0.0) & (np.abs(side.y - fitted) < np.abs(side.y))
        again = nearer | (found == TOP)
        if np.array_equal(again, turns):
            break
        turns = again
    return found


def _split(side: Side, turns: Mask) -> tuple[Regions, LeastSquares]:
    """Regions and line that explain the turning rows best, with a top speed or without."""
    order = np.flatnonzero(turns)[np.argsort(side.x[turns], kind="stable")]
    best: tuple[float, Regions, LeastSquares] | None = None
    for cut in [*range(LINE_VOLTAGES, len(order) - TOP_ROWS + 1), len(order)]:
        found = np.full(len(side.x), STILL, dtype=np.int64)
        found[order[:cut]], found[order[cut:]] = LINE, TOP
        on_line, top = found == LINE, side.y[found == TOP]
        voltages = np.unique(side.x[on_line])
        if len(voltages) < LINE_VOLTAGES or (len(top) and side.x[order[cut]] == voltages[-1]):
            continue
        line = least_squares(_slopes(side, on_line)[on_line], side.y[on_line])
        if line.values[1] * np.ptp(voltages) < LEAST_RISE * np.max(side.y):
            continue
        squares = line.squares + (float(np.sum((top - top.mean()) ** 2)) if len(top) else 0.0)
        n = len(order)
        score = n * math.log((squares + rounding(side.y)) / n)
        score += TOP_COST * math.log(n) * (len(top) > 0)
        if best is None or score < best[0]:
            best = score, found, line
    if best is None:
        raise UserError(
            f"no linear region at {side.name} voltages; add {LINE_VOLTAGES} rows or more between"
            " the edge, from which the motor turns, and its top speed"
        )
    return best[1:]


def _slopes(side: Side, on_line: Mask) -> Array:
    """Slopes of the line by its level, its gain and, with both branches, its shift."""
    columns = [np.ones(len(side.x)), side.x]
    columns += [-side.branch] if side.has_both(on_line) else []
    return np.column_stack(columns)
