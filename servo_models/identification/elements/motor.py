"""A motor from bench tables: its static characteristic, up and down both ways, and its slowness.

On each side, with voltage and speed counted away from 0, the motor stands still below an
edge, jumps onto the line K (u - zero - b h) and stays at its top speed beyond a second edge;
b is 1 while the voltage rises and -1 while it falls (``sg90.physics.motor_curve``).  All rows
that turn are fitted together: both sides share the gain K, the half shift h and the scatter of
the speed meter.

An edge *with a jump* lies anywhere between the last row before and the first row after it,
with equal chance.  An edge *without one* is a corner of fitted lines, with the standard error of
their crossing.  A jump is claimed only where the row beside it is off the line by more than three
standard deviations.

From any row after a step of voltage on, speed = final + (first - final) exp(-(t - t_first)/T):
time constant and final speed are fitted there, whenever exactly the step was.
Sources: SG90 paper secs. 4.3, Fig. 8, and 5.2 (model 2); Hudson, J. Am. Stat. Assoc. 61 (1966)
1097 (joins); Ljung, System Identification, 2nd ed., sec. 10.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Mask
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    BENT,
    Figure,
    Fit,
    Interval,
    fit,
    is_curved,
    linear,
)

STILL, LINE, TOP = 0, 1, 2
NAMES = ("positive", "negative")
GAIN = "rad/s/V"
ROUNDS = 20  # rounds after which regions that still swap are left as they are
STEP_GAIN = "gain of the step"


def motor(
    voltage: Array, speed: Array, branch: Array | None = None
) -> tuple[list[Figure], list[str]]:
    """Return figures of the static characteristic, with the signs of the table, and doubts.

    Args:
        voltage, speed: rows [V], [rad/s], shape (n,), in the order in which they were taken.
        branch: above 0 where the voltage goes away from 0, shape (n,); by default told by the
            order of the rows.

    Raises:
        UserError: one direction only, a side that never turns, or too few rows on a line.
    """
    curve = _fitted(voltage, speed, _rising(voltage) if branch is None else branch > 0.0)
    gain, shift, doubts = curve.fit.estimate(itemgetter(0)), curve.shift, list[str]()
    figures = [Figure("gain K_EN", gain, GAIN, parameter="motor_gain")]
    gains, widths = list[Interval](), list[Interval]()
    off = (curve.y - curve.line) * (curve.fit.squares > 0.0)
    for k, name in enumerate(NAMES):
        found, moved = _side(curve, k)
        figures, gains, widths = figures + found, [*gains, found[0].estimate], widths + moved
        if not np.any(curve.at(k, TOP)):
            doubts.append(
                f"no {name} voltage reaches a top speed; 'top_{name}' is not identified, add rows"
                " of higher voltage"
            )
    if gains[0].contradicts(gains[1]):
        doubts.append(
            f"the gains of both sides differ, {gains[0].value:.5g} and {gains[1].value:.5g} {GAIN};"
            " 'motor_gain' is their common one, see effect direction_asymmetry"
        )
    if any(is_curved(curve.x[rows], off[rows]) for rows in (curve.at(k, LINE) for k in range(2))):
        doubts.append(BENT)
    if not widths:
        doubts.append("one branch only; hysteresis shows with rising and falling voltage")
        return figures, doubts
    distinct = dict.fromkeys(widths)  # without jumps both sides have that of the lines
    width = Interval.sum(*((1.0 / len(distinct), one) for one in distinct))
    text = "hysteresis width at the edges"
    figures.append(Figure(text, width, "V", "", "hysteresis.half_width", 0.5))
    if shift:
        figures.append(Figure("shift of the line, rising to falling", shift, "V"))
        if width.contradicts(shift):
            doubts.append(
                f"between the branches the edges move by {width.value:.3g} V and the line by"
                f" {shift.value:.3g} V; effect hysteresis moves both alike"
            )
    return figures, doubts


def _rising(voltages: Array) -> Mask:
    """Whether the voltage goes away from 0 at each row; where it stays, as at the row before."""
    steps = np.diff(voltages)
    away = (np.diff(np.abs(voltages)) > 0.0) | (voltages[1:] * voltages[:-1] < 0.0)
    moved = np.flatnonzero(steps)
    latest = np.searchsorted(moved, np.arange(-1, len(steps)), "right") - 1
    return np.asarray(away[moved[np.maximum(latest, 0)]])


@dataclass(frozen=True, eq=False)
class _Curve:
    """Lines and top speeds, fitted to all rows that turn; rows are counted away from 0.

    Attributes:
        x, y: voltage [V] and speed [rad/s], shape (n,).
        branch: 1 where the voltage rises, -1 where it falls, shape (n,).
        side: position of the direction in ``NAMES``, shape (n,).
        regions: of the rows, shape (n,).
    """

    x: Array
    y: Array
    branch: Array
    side: NDArray[np.int64]
    regions: NDArray[np.int64]

    @cached_property
    def fit(self) -> Fit:
        """K, K zero of each side, K h, and the top speed of each side; 0 where no row tells."""
        line, sides = self.regions == LINE, [self.side == k for k in range(2)]
        up = [self.branch[line & side] > 0.0 for side in sides]
        both = any(2 <= np.sum(rises) <= len(rises) - 2 for rises in up)
        columns = [self.x, *(-1.0 * side for side in sides), -1.0 * both * self.branch]
        tops = [1.0 * self.at(k, TOP) for k in range(2)]
        turns = self.regions != STILL
        design = np.column_stack([*(column * line for column in columns), *tops])
        return linear(design[turns], self.y[turns])

    @property
    def effective(self) -> Array:
        """Voltage less the shift of its branch [V] at each row."""
        return np.asarray(self.x - self.fit.values[3] / self.fit.values[0] * self.branch)

    @property
    def line(self) -> Array:
        """Speed of the line [rad/s] at each row, whether the motor turns or not."""
        gain, *levels = self.fit.values[:3]
        return np.asarray(gain * self.effective - np.array(levels)[self.side])

    @property
    def chance(self) -> float:
        """Speed [rad/s] by which a row may be off for nothing but noise."""
        return 3.0 * self.fit.scatter + 1e-9 * float(np.max(self.y))

    @property
    def shift(self) -> Interval | None:
        """Of the line, rising minus falling [V]; None without both branches."""
        told = np.any(self.fit.slopes[:, 3])
        return self.fit.estimate(lambda v: 2.0 * v[3] / v[0]) if told else None

    def at(self, side: int, region: int) -> Mask:
        return np.asarray((self.side == side) & (self.regions == region))

    def zero(self, side: int, branch: float = 0.0) -> Interval:
        """Where the line of a side meets 0 [V]; with ``branch`` 0 the mean of both branches."""
        return self.fit.estimate(lambda v: (v[1 + side] + branch * v[3]) / v[0])


def _fitted(voltages: Array, speeds: Array, rising: Mask) -> _Curve:
    """Fit lines and top speeds to both sides."""
    moved = voltages != 0.0
    sign = np.sign(voltages[moved])
    x, y, branch = np.abs(voltages[moved]), sign * speeds[moved], np.where(rising[moved], 1.0, -1.0)
    side, regions = (sign < 0.0).astype(np.int64), np.zeros(len(x), dtype=np.int64)
    for k, name in enumerate(NAMES):
        here = side == k
        if not np.any(here):
            raise UserError(f"no {name} voltage; add rows of both directions")
        if not np.max(y[here]) > 0.0:
            raise UserError(
                f"the motor never turns in the direction of {name} voltages; add rows beyond the"
                " edge, or correct the sign of the speed"
            )
        alone = _Curve(x[here], y[here], branch[here], 0 * side[here], regions[here])
        regions[here] = _regions(alone, name)
    return _Curve(x, y, branch, side, regions)


def _regions(side: _Curve, name: str) -> NDArray[np.int64]:
    """Return the region of each row of a side.

    A row turns if its speed is nearer to the line than to 0; the line and the top speed are those
    of the rows that turn, split where that leaves least.
    """
    turns, order = side.y > 0.05 * np.max(side.y), np.argsort(side.x, kind="stable")
    for _ in range(ROUNDS):
        rows, splits = order[turns[order]], list[tuple[float, int, _Curve]]()
        n, x = len(rows), side.x[rows]
        for cut in [*range(3, n - 1), n]:  # the first row at a top speed; n for none
            regions = np.full(len(side.x), STILL, dtype=np.int64)
            regions[rows[:cut]], regions[rows[cut:]] = LINE, TOP
            curve, torn = replace(side, regions=regions), cut < n and x[cut] == x[cut - 1]
            rise = curve.fit.values[0] * np.ptp(x[:cut])
            if len(np.unique(x[:cut])) >= 3 and not torn and rise >= 0.05 * np.max(side.y):
                # a level, and an edge searched for
                splits.append((curve.fit.criterion(4.0 * (cut < n)), cut, curve))
        if not splits:
            raise UserError(
                f"no linear region at {name} voltages; add 3 rows or more between the edge, from"
                " which the motor turns, and its top speed"
            )
        *_, best = min(splits)
        nearer = (best.line > 0.0) & (np.abs(side.y - best.line) < np.abs(side.y))
        before, turns = turns, nearer | (best.regions == TOP)
        if np.array_equal(before, turns):
            break
    return best.regions


def _side(curve: _Curve, k: int) -> tuple[list[Figure], list[Interval]]:
    """Figures of a side that the table tells, its gain first, and the hysteresis at its edges."""
    name, sign = NAMES[k], (1.0, -1.0)[k]
    on_line, at_top, x = curve.at(k, LINE), curve.at(k, TOP), curve.effective
    alone = linear(np.column_stack([x, np.ones(len(x))])[on_line], curve.y[on_line])
    figures = [Figure(f"gain, {name}", alone.estimate(itemgetter(0)), GAIN)]

    def add(what: str, estimate: Interval, unit: str = "V", parameter: str = "") -> None:
        text, shown = f"{what}, {name}", estimate.scaled(sign)
        figures.append(Figure(text, shown, unit, "", parameter and f"{parameter}_{name}", sign))

    edges = {"rising": _edge(curve, k, 1.0), "falling": _edge(curve, k, -1.0)}
    known = {which: edge for which, edge in edges.items() if edge}
    (middle, leaps), *others = known.values()
    widths = list[Interval]()
    for other, also in others:
        widths.append(Interval.sum((1.0, middle), (-1.0, other)))
        if middle != other:  # else one edge, seen twice
            middle = Interval.sum((0.5, middle), (0.5, other))
            if curve.shift and not (leaps or also):
                middle, widths = curve.zero(k), [curve.shift]
    add("insensitivity edge", middle, parameter="edge")
    for which, (place, _) in known.items():
        add(f"edge, {which}", place)
    add("zero of the line", curve.zero(k), parameter="zero")
    if np.any(at_top):
        saturation = Interval.between(float(x[on_line].max()), float(x[at_top].min()))
        top = curve.fit.estimate(itemgetter(4 + k))
        if top.value - np.min(curve.line[at_top]) < curve.chance:  # no jump, but a corner
            saturation = curve.fit.estimate(lambda v: (v[1 + k] + v[4 + k]) / v[0])
        add("saturation edge", saturation)
        add("top speed", top, "rad/s", "top")
    return figures, widths


def _edge(curve: _Curve, k: int, branch: float) -> tuple[Interval, bool] | None:
    """Where a branch starts or ends to turn, and whether it jumps; None if no row of it turns."""
    here = (curve.side == k) & (curve.branch == branch)
    still, turns = here & (curve.regions == STILL), here & (curve.regions != STILL)
    if not turns.any():
        return None
    zero, first = curve.zero(k, branch), float(np.min(curve.x[turns]))
    if still.any() and np.max((curve.line - curve.y)[still]) < curve.chance:
        return replace(zero, high=max(zero.high, first)), False
    last = max(float(np.max(curve.x[still], initial=0.0)), zero.value)
    return Interval.between(last, first), True


def motor_step(
    time: Array, speed: Array, voltage: Array | None = None
) -> tuple[list[Figure], list[str]]:
    """Return time constant and, with the voltage, gain of a step up or down; and doubts.

    Args:
        time, speed: rows [s], [rad/s], shape (n,), from the step on if there is no voltage.
        voltage: [V], shape (n,), constant but for one step; without a step in it the motor stood
            still without voltage before the record.

    Raises:
        UserError: fewer than 6 rows after the step, a second step, or a record that ends
            before the time constant shows.
    """
    first = 0
    if voltage is not None:
        above = voltage > 0.5 * (np.min(voltage) + np.max(voltage))
        changes = np.flatnonzero(np.diff(above)) + 1
        if len(changes) > 1:
            raise UserError("the voltage changes more than once; cut the record to one step")
        first = int(changes[0]) if len(changes) else 0
    since, after = time[first:] - time[first], speed[first:]
    if len(since) < 6:
        raise UserError(
            f"{len(since)} rows after the step: give at least 6, until the speed settles"
        )
    start = [after[-1], after[0] - after[-1], math.log(0.1 * since[-1])]
    best = fit(lambda v: v[0] + v[1] * np.exp(-since * np.exp(-v[2])), after, start)
    constant = best.estimate(lambda v: math.exp(v[2]))
    if constant.low <= 0.0 or constant.value > since[-1]:
        raise UserError(
            "the speed does not settle as that of a first order does; record until it stays"
        )
    figures = [Figure("time constant T", constant, "s", parameter="motor_time_constant")]
    if voltage is not None:
        size, initial = float(np.mean(voltage[first:])), Interval.of(0.0)  # if no row shows it
        if first:
            size -= voltage[0]
            error = best.scatter / math.sqrt(first)
            initial = Interval.of(float(np.mean(speed[:first])), error)
        if size == 0.0:
            raise UserError("the voltage is 0 throughout; leave its column out, or correct it")
        gain = Interval.sum((1.0 / size, best.estimate(itemgetter(0))), (-1.0 / size, initial))
        figures.append(Figure(STEP_GAIN, gain, GAIN))
    doubt = (
        "the speed is not quite that of a first order, so that the standard errors are too small;"
        " without a voltage the table begins at the step"
    )
    return figures, [doubt] * is_curved(since, best.residuals)
