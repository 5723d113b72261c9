"""A motor from bench tables: its static characteristic, up and down both ways, and its slowness.

On each side, with voltage and speed counted away from 0, the motor stands still below an
edge, jumps onto the line K (u - zero - b h) and stays at its top speed beyond a second edge;
b is 1 while the voltage rises and -1 while it falls.  The block ``sg90.physics.motor_curve``
itself is fitted to all rows that turn: both sides share the gain K, the half shift h and the
scatter of the speed meter.

An edge *with a jump* lies anywhere between the last row before and the first row after it,
with equal chance: the middle, with the standard error of a uniform distribution.  An edge
*without one* is a corner of fitted lines, with the standard error of their crossing.  A jump
is claimed only where it explains the rows better by more than ``JUMP`` standard errors.

From any row after a step of voltage on, speed = final + (first - final) exp(-(t - t_first)/T):
time constant and final speed are fitted there, whenever exactly the step was.
Sources: SG90 paper secs. 4.3, Fig. 8, and 5.2 (model 2); Hudson, J. Am. Stat. Assoc. 61 (1966)
1097 (joins); Ljung, System Identification, 2nd ed., sec. 10.2.
"""

from __future__ import annotations

import inspect
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servo_models.actuators.sg90 import physics
from servo_models.core.types import Array, Mask
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    Estimate,
    Fit,
    between,
    combined,
    exactly,
    fit,
    is_bent,
    is_correlated,
    rounding,
)
from servo_models.identification.elements.lines import straight_line

Regions = NDArray[np.int64]

NAMES = ("positive", "negative")
SETTINGS = tuple(inspect.signature(physics.motor_curve.function).parameters)[1:]
"""What the block takes besides the voltage; 0 where a fit has no value for it."""
HALF = "half"  # half shift of the line between both branches [V]; no parameter of the block
STILL, LINE, TOP = 0, 1, 2
FIRST_GUESS = 0.05  # share of the highest speed above which a row counts as turning at first
TOP_COST = 4.0
"""Criterion's cost of a top speed, in ln n: its level, and that its edge is searched for."""
LINE_VOLTAGES, TOP_ROWS = 3, 2
LEAST_RISE = 0.05  # share of the highest speed by which a line rises at least
ROUNDS = 20
JUMP = 3.0  # standard errors of a row by which a jump must explain the rows better than a corner
STEP_ROWS = 6
BEGUN = 0.1  # share of the change from which the step counts as made, where no voltage tells it
LEAST_SPAN = 1.0  # time constants that the rows must span, or the final speed is a guess


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
        bent: a line shows a bow.
    """

    gain: Estimate
    shift: Estimate | None
    positive: SideCurve
    negative: SideCurve
    bent: bool

    @property
    def unequal(self) -> bool:
        """Whether the gains of both sides differ by more than chance."""
        return self.positive.gain.contradicts(self.negative.gain)

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
    up = _rising(voltages) if rising is None else rising
    curve = _fitted(*(_Rows.of(k, voltages, speeds, up) for k in range(2)))
    positive, negative = (_side(curve, k) for k in range(2))
    return MotorCurve(
        gain=curve.fit.estimate(0),
        shift=curve.shift,
        positive=positive,
        negative=negative,
        bent=curve.is_bent(0) or curve.is_bent(1),
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of one direction, counted away from 0.

    Attributes:
        name, sign: of the direction.
        x, y: voltage [V] and speed [rad/s], shape (n,).
        branch: 1 where the voltage rises, -1 where it falls, shape (n,).
    """

    name: str
    sign: float
    x: Array
    y: Array
    branch: Array

    @classmethod
    def of(cls, k: int, voltages: Array, speeds: Array, up: Mask) -> _Rows:
        """Take the positive side, 0, or the negative one, 1, out of a table."""
        name, sign = NAMES[k], (1.0, -1.0)[k]
        rows = sign * voltages > 0.0
        if not rows.any():
            raise UserError(f"no {name} voltage; add rows of both directions")
        branch = np.where(up[rows], 1.0, -1.0)
        return cls(name, sign, sign * voltages[rows], sign * speeds[rows], branch)

    def has_both(self, rows: Mask | NDArray[np.int64]) -> bool:
        """Whether there are two rows or more of both branches among ``rows``."""
        up = self.branch[rows] > 0.0
        return bool(np.sum(up) >= 2 and np.sum(~up) >= 2)


def _rising(voltages: Array) -> Mask:
    """Whether the voltage goes away from 0 at each row; where it stays, as at the row before."""
    steps = np.diff(voltages)
    away = (np.diff(np.abs(voltages)) > 0.0) | (voltages[1:] * voltages[:-1] <= 0.0)
    moved = np.flatnonzero(steps)
    if not len(moved):
        return np.ones(len(voltages), dtype=bool)
    latest = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(steps)), moved[0]))
    first, later = float(voltages[0]), float(voltages[moved[0] + 1])
    begins = abs(later) >= abs(first) or later * first < 0.0
    rising = np.concatenate([[begins], away[latest]])
    rising[: moved[0] + 1] = begins
    return rising


def _regions(side: _Rows) -> tuple[Regions, Array]:
    """Return the region of each row, shape (n,), and level, gain and shift of the line.

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
    columns = np.column_stack([np.ones(len(side.x)), side.x, -side.branch])
    for _ in range(ROUNDS):
        regions, line = _split(side, columns, turns)
        fitted = columns @ line
        nearer = (fitted > 0.0) & (np.abs(side.y - fitted) < np.abs(side.y))
        again = nearer | (regions == TOP)
        if np.array_equal(again, turns):
            break
        turns = again
    return regions, line


def _split(side: _Rows, columns: Array, turns: Mask) -> tuple[Regions, Array]:
    """Regions and line that explain the turning rows best, with a top speed or without."""
    order = np.flatnonzero(turns)[np.argsort(side.x[turns], kind="stable")]
    n, highest = len(order), float(np.max(side.y))
    best: tuple[float, Regions, Array] | None = None
    for cut in [*range(LINE_VOLTAGES, n - TOP_ROWS + 1), n]:
        on_line, top = order[:cut], order[cut:]
        voltages = np.unique(side.x[on_line])
        if len(voltages) < LINE_VOLTAGES or (len(top) and side.x[top[0]] == voltages[-1]):
            continue
        used = columns[on_line][:, : 3 if side.has_both(on_line) else 2]
        line = np.append(np.linalg.lstsq(used, side.y[on_line], rcond=None)[0], 0.0)[:3]
        if line[1] * np.ptp(voltages) < LEAST_RISE * highest:
            continue
        squares = float(np.sum((side.y[on_line] - columns[on_line] @ line) ** 2))
        squares += len(top) * float(np.var(side.y[top])) if len(top) else 0.0
        score = n * math.log((squares + rounding(side.y)) / n)
        score += TOP_COST * math.log(n) * (len(top) > 0)
        if best is None or score < best[0]:
            regions = np.full(len(side.x), STILL, dtype=np.int64)
            regions[on_line], regions[top] = LINE, TOP
            best = score, regions, line
    if best is None:
        raise UserError(
            f"no linear region at {side.name} voltages; add {LINE_VOLTAGES} rows or more between"
            " the edge, from which the motor turns, and its top speed"
        )
    return best[1:]


@dataclass(frozen=True, eq=False)
class _Curve:
    """The block fitted to all rows that turn.

    Attributes:
        sides: positive and negative.
        regions: of the rows of each side.
        names: of the unknowns, the gain first: parameters of the block and ``HALF``.
        fit: values in that order; of voltages and speeds with their signs.
        corners: sides whose line goes over into the top speed without a jump.
    """

    sides: tuple[_Rows, ...]
    regions: tuple[Regions, ...]
    names: tuple[str, ...]
    fit: Fit
    corners: frozenset[int] = frozenset()

    @property
    def values(self) -> dict[str, float]:
        return dict(zip(self.names, self.fit.values.tolist()))

    def estimate(self, function: Callable[[Mapping[str, float]], float]) -> Estimate:
        """Return a function of the unknowns by their names."""
        return self.fit.estimate(lambda values: function(dict(zip(self.names, values))))

    @property
    def shift(self) -> Estimate | None:
        """Of the line, rising minus falling [V]; None without both branches."""
        return self.estimate(lambda v: 2.0 * v[HALF]) if HALF in self.names else None

    def zero(self, side: int, branch: float = 0.0) -> Estimate:
        """Where the line of a side meets 0 [V]; with ``branch`` 0 the mean of both branches."""
        return self.estimate(lambda v: v[f"zero_{NAMES[side]}"] + branch * v.get(HALF, 0.0))

    def top(self, side: int) -> Estimate | None:
        """Top speed of a side [rad/s], None if it has none."""
        name = f"top_{NAMES[side]}"
        return self.fit.estimate(self.names.index(name)) if name in self.names else None

    def effective(self, side: int) -> Array:
        """Voltage less the shift of its branch [V] at each row of a side."""
        rows = self.sides[side]
        return np.asarray(rows.x - self.values.get(HALF, 0.0) * rows.branch)

    def line(self, side: int) -> Array:
        """Speed of the line [rad/s] at each row of a side."""
        sign = self.sides[side].sign
        return sign * _speeds(_untopped(self.values), sign * self.effective(side))[0]

    def is_better(self, squares: float) -> bool:
        """Whether rows explained with ``squares`` less are more than chance."""
        measured = np.concatenate([side.y for side in self.sides])
        return squares > JUMP**2 * self.fit.scatter**2 + rounding(measured)

    def is_bent(self, side: int) -> bool:
        """Whether the line of a side shows a bow."""
        rows, on_line = self.sides[side], self.regions[side] == LINE
        return self.fit.squares > 0.0 and is_bent(
            rows.x[on_line], (rows.y - self.line(side))[on_line]
        )


def _speeds(values: Mapping[str, float], voltages: Array) -> tuple[Array, Mask]:
    """Speed [rad/s] of a turning motor by the block, and whether it is at its top; shape (n,)."""
    settings = [itertools.repeat(values.get(name, 0.0)) for name in SETTINGS]
    rows = list(map(physics.motor_curve.function, voltages.tolist(), *settings))
    return np.array([row[0] for row in rows]), np.array([row[1] > 0.0 for row in rows])


def _untopped(values: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in values.items() if not name.startswith("top_")}


def _fitted(positive: _Rows, negative: _Rows) -> _Curve:
    """Fit lines and top speeds; a corner at the top unless the rows object to it."""
    sides = positive, negative
    (regions, lines) = zip(*map(_regions, sides))
    gain = float(np.mean([line[1] for line in lines]))
    start = {"motor_gain": gain}
    start |= {f"zero_{name}": -line[0] / line[1] for name, line in zip(NAMES, lines)}
    if any(side.has_both(rows == LINE) for side, rows in zip(sides, regions)):
        start[HALF] = float(np.mean([line[2] for line in lines])) / gain
    tops = [k for k, rows in enumerate(regions) if np.any(rows == TOP)]
    start |= {f"top_{NAMES[k]}": float(np.mean(sides[k].y[regions[k] == TOP])) for k in tops}
    curve = _with_block(sides, regions, start)
    for k in tops:
        corner = _with_corner(curve, k)
        if corner and not curve.is_better(corner.fit.squares - curve.fit.squares):
            curve = corner
    return curve


def _with_block(
    sides: Sequence[_Rows], regions: Sequence[Regions], start: Mapping[str, float]
) -> _Curve:
    """Fit the block: on a line without a top, and at a top by a voltage without end."""
    names = tuple(start)
    turns, top = np.concatenate(regions) != STILL, np.concatenate(regions) == TOP

    def turning(each: Iterable[Array]) -> Array:
        return np.asarray(np.concatenate(list(each))[turns])

    voltages = turning(side.sign * side.x for side in sides)
    shifts = turning(side.sign * side.branch for side in sides)
    speeds = turning(side.sign * side.y for side in sides)

    def model(voltages: Array, *unknowns: float) -> Array:
        values = dict(zip(names, unknowns))
        modelled = _speeds(_untopped(values), voltages - values.get(HALF, 0.0) * shifts)[0]
        ends = _speeds(values, np.array([np.inf, -np.inf]))[0]
        return np.where(top[turns], np.where(voltages > 0.0, *ends), modelled)

    best = fit(model, voltages, speeds, [*start.values()])
    return _Curve(tuple(sides), tuple(regions), names, best)


def _with_corner(curve: _Curve, k: int) -> _Curve | None:
    """The fit in which the block says itself which turning rows are at the top."""
    sign, old = curve.sides[k].sign, curve.regions
    for _ in range(ROUNDS):
        at_top = _speeds(curve.values, sign * curve.effective(k))[1]
        rows = np.where(old[k] == STILL, STILL, np.where(at_top, TOP, LINE))
        if min(np.sum(rows == TOP), np.sum(rows == LINE)) < TOP_ROWS:
            return None
        regions = [rows if side == k else old[side] for side in range(2)]
        curve = replace(
            _with_block(curve.sides, regions, curve.values), corners=curve.corners | {k}
        )
        if np.array_equal(rows, old[k]):
            return curve
        old = curve.regions
    return None


@dataclass(frozen=True)
class _Edge:
    """Where a branch starts or ends to turn; ``rows`` on both sides of a jump."""

    place: Estimate
    rows: tuple[float, float] | None


def _side(curve: _Curve, k: int) -> SideCurve:
    rows, on_line = curve.sides[k], curve.regions[k] == LINE
    starts, stops = (_edge(curve, k, branch) for branch in (1.0, -1.0))
    return SideCurve(
        gain=straight_line(curve.effective(k)[on_line], rows.y[on_line]).gain,
        zero=curve.zero(k),
        starts=starts.place if starts else None,
        stops=stops.place if stops else None,
        edge=_mean(curve, k, starts, stops),
        width=_width(curve, starts, stops),
        saturation=_saturation(curve, k),
        top=curve.top(k),
    )


def _edge(curve: _Curve, k: int, branch: float) -> _Edge | None:
    """The edge of one branch, None if no row of it turns."""
    rows, on_branch = curve.sides[k], curve.sides[k].branch == branch
    still = on_branch & (curve.regions[k] == STILL)
    turns = on_branch & (curve.regions[k] != STILL)
    if not turns.any():
        return None
    zero, first, line = curve.zero(k, branch), float(np.min(rows.x[turns])), curve.line(k)
    held = still & (line > 0.0)
    better = float(np.sum((rows.y[held] - line[held]) ** 2 - rows.y[held] ** 2))
    if still.any() and not curve.is_better(better):
        return _Edge(replace(zero, high=max(zero.high, first)), None)
    last = max(float(np.max(rows.x[still], initial=0.0)), zero.value)
    return _Edge(between(last, first), (last, first))


def _mean(curve: _Curve, k: int, starts: _Edge | None, stops: _Edge | None) -> Estimate:
    """Middle of both branches; two branches between the same rows are one edge seen twice."""
    known = [edge for edge in (starts, stops) if edge]
    if len(known) == 1 or known[0].rows == known[1].rows:
        jump = known[0].rows or len(known) == 1
        return known[0].place if jump else curve.zero(k)
    return combined(*((0.5, edge.place) for edge in known))


def _width(curve: _Curve, starts: _Edge | None, stops: _Edge | None) -> Estimate | None:
    if not (starts and stops):
        return None
    if starts.rows is None and stops.rows is None and curve.shift:
        return curve.shift
    return combined((1.0, starts.place), (-1.0, stops.place))


def _saturation(curve: _Curve, k: int) -> Estimate | None:
    zero, top = f"zero_{NAMES[k]}", f"top_{NAMES[k]}"
    if top not in curve.names:
        return None
    if k in curve.corners:
        return curve.estimate(lambda v: v[zero] + v[top] / v["motor_gain"])
    x, regions = curve.effective(k), curve.regions[k]
    return between(float(np.max(x[regions == LINE])), float(np.min(x[regions == TOP])))


@dataclass(frozen=True)
class FirstOrder:
    """A motor of first order.

    Attributes:
        time_constant: [s].
        gain: change of speed per change of voltage [rad/s/V]; None without the voltage.
        correlated: residuals follow their neighbours, so that it is not quite first order.
    """

    time_constant: Estimate
    gain: Estimate | None
    correlated: bool


def first_order(times: Array, speeds: Array, voltages: Array | None = None) -> FirstOrder:
    """Estimate time constant and gain from one step, up or down.

    Args:
        times, speeds: rows [s], [rad/s], shape (n,).
        voltages: [V], shape (n,), constant but for one step; without a step in it the
            motor stood still without voltage before the record.

    Raises:
        UserError: fewer than ``STEP_ROWS`` rows after the step, a second step, or a record
            that ends before the time constant shows.
    """
    first = _begun(speeds) if voltages is None else _stepped(voltages)
    since, after = times[first:] - times[first], speeds[first:]
    if len(since) < STEP_ROWS:
        raise UserError(
            f"{len(since)} rows after the step: give at least {STEP_ROWS}, until the speed settles"
        )
    best = _exponential(since, after)
    time_constant = best.estimate(lambda v: math.exp(v[2]))
    if time_constant.low <= 0.0 or time_constant.value * LEAST_SPAN > since[-1]:
        raise UserError(
            "the speed does not settle as that of a first order does; record until it stays"
        )
    gain = None if voltages is None else _gain(best, speeds[:first], voltages[0], voltages[first:])
    return FirstOrder(time_constant, gain, is_correlated(best.residuals))


def _begun(speeds: Array) -> int:
    """First row from which the speed has covered ``BEGUN`` of its change for good."""
    change = float(speeds[-1] - speeds[0])
    before = np.flatnonzero((speeds - speeds[0]) * math.copysign(1.0, change) < BEGUN * abs(change))
    return int(before[-1]) + 1 if len(before) > 1 else 0


def _stepped(voltages: Array) -> int:
    """Row at which the voltage changes, 0 if it never does."""
    above = voltages > 0.5 * (np.min(voltages) + np.max(voltages))
    changes = np.flatnonzero(np.diff(above)) + 1
    if len(changes) > 1:
        raise UserError("the voltage changes more than once; cut the record to one step")
    return int(changes[0]) if len(changes) else 0


def _exponential(since: Array, speeds: Array) -> Fit:
    """Fit of final speed, change to come and the time constant's logarithm."""
    final = float(np.mean(speeds[-max(len(speeds) // 10, 1) :]))
    covered = np.abs(speeds - speeds[0]) >= (1.0 - math.exp(-1.0)) * abs(final - speeds[0])
    return fit(
        lambda t, final, change, slow: final + change * np.exp(-t * np.exp(-slow)),
        since,
        speeds,
        [final, speeds[0] - final, math.log(max(since[np.argmax(covered)], since[1]))],
    )


def _gain(best: Fit, before: Array, old: float, after: Array) -> Estimate:
    """Change of speed per change of voltage; the speed before is 0 if no row shows it."""
    size, start = float(np.mean(after)), exactly(0.0)
    if len(before):
        mean, error = float(np.mean(before)), best.scatter / math.sqrt(len(before))
        size, start = size - old, Estimate(mean, error, mean - 2.0 * error, mean + 2.0 * error)
    if size == 0.0:
        raise UserError("the voltage is 0 throughout; leave its column out, or correct it")
    return combined((1.0 / size, best.estimate(0)), (-1.0 / size, start))
