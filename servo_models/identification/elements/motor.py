"""A motor from bench tables: its static characteristic, up and down both ways, and its slowness.

On each side, with voltage and speed counted away from 0, the motor stands still below an
edge, jumps onto the line K (u - zero - b h) and stays at its top speed beyond a second edge;
b is 1 while the voltage rises and -1 while it falls (``sg90.physics.motor_curve``).  All rows
that turn are fitted together: both sides share the gain K, the half shift h and the scatter of
the speed meter.

An edge *with a jump* lies anywhere between the last row before and the first row after it,
with equal chance: the middle, with the standard error of a uniform distribution.  An edge
*without one* is a corner of fitted lines, with the standard error of their crossing.  A jump
is claimed only where it explains the rows better by more than three standard errors.

From any row after a step of voltage on, speed = final + (first - final) exp(-(t - t_first)/T):
time constant and final speed are fitted there, whenever exactly the step was.
Sources: SG90 paper secs. 4.3, Fig. 8, and 5.2 (model 2); Hudson, J. Am. Stat. Assoc. 61 (1966)
1097 (joins); Ljung, System Identification, 2nd ed., sec. 10.2.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servo_models.core.types import Array, Mask
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import (
    Estimate,
    Figure,
    Fit,
    between,
    combined,
    fit,
    is_bent,
    is_correlated,
    linear,
    rounding,
)
from servo_models.identification.elements.lines import BENT

STILL, LINE, TOP = 0, 1, 2
NAMES = ("positive", "negative")
GAIN = "rad/s/V"
ROUNDS = 20  # after which regions that still swap are left as they are


def motor(
    voltage: Array, speed: Array, branch: Array | None = None
) -> tuple[list[Figure], list[str]]:
    """Return the figures of the static characteristic, with the signs of the table; and doubts.

    Args:
        voltage, speed: rows [V], [rad/s], shape (n,), in the order in which they were taken.
        branch: above 0 where the voltage goes away from 0, shape (n,); by default told by the
            order of the rows.

    Raises:
        UserError: one direction only, a side that never turns, or too few rows on a line.
    """
    curve = _fitted(voltage, speed, _rising(voltage) if branch is None else branch > 0.0)
    gain, shift = curve.fit.estimate(lambda v: v[0]), curve.shift
    sides = [_side(curve, k) for k in range(2)]
    figures = [Figure("gain K_EN", gain, GAIN, parameter="motor_gain")]
    for name, sign, side in zip(NAMES, (1.0, -1.0), sides):
        figures.append(Figure(f"gain, {name}", side["gain"], GAIN))
        figures += [
            Figure(f"{what}, {name}", estimate.scaled(sign), unit, "", parameter, sign)
            for what, unit, parameter in (
                ("insensitivity edge", "V", f"edge_{name}"),
                ("edge, rising", "V", ""),
                ("edge, falling", "V", ""),
                ("zero of the line", "V", f"zero_{name}"),
                ("saturation edge", "V", ""),
                ("top speed", "rad/s", f"top_{name}"),
            )
            if (estimate := side.get(what))
        ]
    widths = list(dict.fromkeys(side["width"] for side in sides if "width" in side))
    width = combined(*((0.5, each) for each in widths)) if len(widths) > 1 else None
    width = width or next(iter(widths), None)
    if width:
        text = "hysteresis width at the edges"
        figures.append(Figure(text, width, "V", "", "hysteresis.half_width", 0.5))
    if shift:
        figures.append(Figure("shift of the line, rising to falling", shift, "V"))
    return figures, [*_doubts(curve, sides, width)]


def _doubts(
    curve: _Curve, sides: list[dict[str, Estimate]], width: Estimate | None
) -> Iterator[str]:
    for name, side in zip(NAMES, sides):
        if "top speed" not in side:
            yield (
                f"no {name} voltage reaches a top speed; 'top_{name}' is not identified, add rows"
                " of higher voltage"
            )
    positive, negative = (side["gain"] for side in sides)
    if positive.contradicts(negative):
        yield (
            f"the gains of both sides differ, {positive.value:.5g} and {negative.value:.5g} {GAIN};"
            " 'motor_gain' is their common one, see effect direction_asymmetry"
        )
    off = (curve.rows.y - curve.line) * (curve.fit.squares > 0.0)
    here = [curve.at(k, LINE) for k in range(2)]
    if any(is_bent(curve.rows.x[rows], off[rows]) for rows in here):
        yield BENT
    if not width:
        yield "one branch only; hysteresis shows with rising and falling voltage"
    elif curve.shift and width.contradicts(curve.shift):
        yield (
            f"between the branches the edges move by {width.value:.3g} V and the line by"
            f" {curve.shift.value:.3g} V; effect hysteresis moves both alike"
        )


def _rising(voltages: Array) -> Mask:
    """Whether the voltage goes away from 0 at each row; where it stays, as at the row before."""
    steps = np.diff(voltages)
    away = (np.diff(np.abs(voltages)) > 0.0) | (voltages[1:] * voltages[:-1] < 0.0)
    moved = np.append(np.flatnonzero(steps), len(steps))
    latest = np.maximum.accumulate(np.where(steps != 0.0, np.arange(len(steps)), moved[0]))
    rising = np.append(True, away[np.minimum(latest, len(steps) - 1)])
    rising[: moved[0] + 1] = rising[min(moved[0] + 1, len(steps))]
    return rising


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of a table, counted away from 0, all of shape (n,).

    Attributes:
        x, y: voltage [V] and speed [rad/s].
        branch: 1 where the voltage rises, -1 where it falls.
        side: position of the direction in ``NAMES``.
    """

    x: Array
    y: Array
    branch: Array
    side: NDArray[np.int64]

    def has_both(self, rows: Mask | NDArray[np.int64]) -> bool:
        """Whether there are two rows or more of both branches."""
        up = int(np.sum(self.branch[rows] > 0.0))
        return 2 <= up <= len(self.branch[rows]) - 2


@dataclass(frozen=True, eq=False)
class _Curve:
    """Lines and top speeds, fitted to all rows that turn.

    Attributes:
        rows: of both sides, and ``regions`` of them, shape (n,).
        fit: of the gain K, then K zero of each side, K h where there are both branches, and the
            top speeds there are.
        both: whether there are both branches.
        corners: sides whose line goes over into the top speed without a jump.
    """

    rows: _Rows
    regions: NDArray[np.int64]
    fit: Fit
    both: bool
    corners: frozenset[int] = frozenset()

    @classmethod
    def of(cls, rows: _Rows, regions: NDArray[np.int64], corners: frozenset[int]) -> _Curve:
        """Fit to rows in these regions."""
        line, sides = regions == LINE, [rows.side == k for k in range(2)]
        both = any(rows.has_both(line & side) for side in sides)
        tops = [top for side in sides if np.any(top := side & (regions == TOP))]
        columns = [rows.x * line, *(-1.0 * (side & line) for side in sides)]
        columns += [-rows.branch * line] * both + [1.0 * top for top in tops]
        turns = regions != STILL
        best = linear(np.column_stack(columns)[turns], rows.y[turns])
        return cls(rows, regions, best, both, corners)

    @property
    def half(self) -> float:
        return float(self.fit.values[3]) / float(self.fit.values[0]) if self.both else 0.0

    @property
    def shift(self) -> Estimate | None:
        """Of the line, rising minus falling [V]; None without both branches."""
        return self.fit.estimate(lambda v: 2.0 * v[3] / v[0]) if self.both else None

    @property
    def line(self) -> Array:
        """Speed of the line [rad/s] at each row, whether the motor turns or not."""
        gain, *levels = self.fit.values[:3]
        return np.asarray(gain * self.effective - np.array(levels)[self.rows.side])

    @property
    def effective(self) -> Array:
        """Voltage less the shift of its branch [V] at each row."""
        return np.asarray(self.rows.x - self.half * self.rows.branch)

    def at(self, side: int, region: int) -> Mask:
        return np.asarray((self.rows.side == side) & (self.regions == region))

    def top(self, side: int) -> int:
        """Position of a side's top speed among the unknowns."""
        return 3 + self.both + (side == 1 and bool(np.any(self.at(0, TOP))))

    def zero(self, side: int, branch: float = 0.0) -> Estimate:
        """Where the line of a side meets 0 [V]; with ``branch`` 0 the mean of both branches."""
        share = branch if self.both else 0.0
        return self.fit.estimate(lambda v: (v[1 + side] + (share and share * v[3])) / v[0])

    def is_better(self, squares: float) -> bool:
        """Whether rows explained with ``squares`` less are more than chance."""
        return squares > (3.0 * self.fit.scatter) ** 2 + rounding(self.rows.y)


def _fitted(voltages: Array, speeds: Array, rising: Mask) -> _Curve:
    """Fit lines and top speeds; a corner at the top unless the rows object to it."""
    moved = voltages != 0.0
    sign = np.sign(voltages[moved])
    branch, side = np.where(rising[moved], 1.0, -1.0), (sign < 0.0).astype(np.int64)
    rows = _Rows(np.abs(voltages[moved]), sign * speeds[moved], branch, side)
    regions = np.zeros(len(rows.x), dtype=np.int64)
    for k, name in enumerate(NAMES):
        if not np.any(side == k):
            raise UserError(f"no {name} voltage; add rows of both directions")
        if not np.max(rows.y[side == k]) > 0.0:
            raise UserError(
                f"the motor never turns in the direction of {name} voltages; add rows beyond the"
                " edge, or correct the sign of the speed"
            )
        regions[side == k] = _regions(rows, side == k, name)
    curve = _Curve.of(rows, regions, frozenset())
    for k in range(2):
        corner = _with_corner(curve, k) if np.any(curve.at(k, TOP)) else None
        if corner and not curve.is_better(corner.fit.squares - curve.fit.squares):
            curve = corner
    return curve


def _regions(rows: _Rows, here: Mask, name: str) -> NDArray[np.int64]:
    """Return the region of each row of a side.

    A row turns if its speed is nearer to the line than to 0; the line and the top speed are
    those of the rows that turn.
    """
    side = _Rows(rows.x[here], rows.y[here], rows.branch[here], rows.side[here])
    turns = side.y > 0.05 * np.max(side.y)  # a first guess
    columns = np.column_stack([np.ones(len(side.x)), side.x, -side.branch])
    for _ in range(ROUNDS):
        splits = list(_splits(side, columns, turns))
        if not splits:
            raise UserError(
                f"no linear region at {name} voltages; add 3 rows or more between the edge, from"
                " which the motor turns, and its top speed"
            )
        _, _, regions, fitted = min(splits, key=lambda split: split[:2])
        nearer = (fitted > 0.0) & (np.abs(side.y - fitted) < np.abs(side.y))
        before, turns = turns, nearer | (regions == TOP)
        if np.array_equal(before, turns):
            break
    return regions


def _splits(
    side: _Rows, columns: Array, turns: Mask
) -> Iterable[tuple[float, int, NDArray[np.int64], Array]]:
    """Criterion, rows on the line, regions and speeds of the line for every place from which the
    turning rows may be at a top speed, the last of them for none."""
    order = np.flatnonzero(turns)[np.argsort(side.x[turns], kind="stable")]
    n = len(order)
    for cut in [*range(3, n - 1), n]:
        on_line, top = order[:cut], order[cut:]
        voltages = np.unique(side.x[on_line])
        if len(voltages) < 3 or (len(top) and side.x[top[0]] == voltages[-1]):
            continue
        used = columns[:, : 3 if side.has_both(on_line) else 2]
        line = np.linalg.lstsq(used[on_line], side.y[on_line], rcond=None)[0]
        if line[1] * np.ptp(voltages) < 0.05 * np.max(side.y):  # flat
            continue
        fitted = used @ line
        squares = float(np.sum((side.y - fitted)[on_line] ** 2))
        squares += len(top) * float(np.var(side.y[top])) if len(top) else 0.0
        score = n * math.log((squares + rounding(side.y)) / n)
        score += 4.0 * math.log(n) * (len(top) > 0)  # a level, and an edge that is searched for
        regions = np.full(len(side.x), STILL, dtype=np.int64)
        regions[on_line], regions[top] = LINE, TOP
        yield score, cut, regions, fitted


def _with_corner(curve: _Curve, k: int) -> _Curve | None:
    """The fit in which the top speed cuts the line, which says what rows are at the top."""
    here, corners = (curve.rows.side == k) & (curve.regions != STILL), curve.corners | {k}
    for _ in range(ROUNDS):
        at_top = curve.line >= curve.fit.values[curve.top(k)]
        regions = np.where(here, np.where(at_top, TOP, LINE), curve.regions)
        if min(np.sum(regions[here] == TOP), np.sum(regions[here] == LINE)) < 2:
            return None
        settled = np.array_equal(regions, curve.regions)
        curve = _Curve.of(curve.rows, regions, corners)
        if settled:
            return curve
    return None


def _side(curve: _Curve, k: int) -> dict[str, Estimate]:
    """Figures of a side, counted away from 0, by name; those that the table tells."""
    on_line, at_top, x, y = curve.at(k, LINE), curve.at(k, TOP), curve.effective, curve.rows.y
    alone = linear(np.column_stack([x, np.ones(len(x))])[on_line], y[on_line])
    figures = {"gain": alone.estimate(lambda v: v[0]), "zero of the line": curve.zero(k)}
    edges = [_edge(curve, k, branch) for branch in (1.0, -1.0)]
    for name, edge in zip(("edge, rising", "edge, falling"), edges):
        if edge:
            figures[name] = edge[0]
    places = [edge[0] for edge in edges if edge]
    between_rows = [edge[1] for edge in edges if edge]
    figures["insensitivity edge"] = combined(*((1.0 / len(places), place) for place in places))
    if len(places) == 1:
        figures["insensitivity edge"] = places[0]
    elif between_rows[0] == between_rows[1]:  # one edge seen twice
        figures["insensitivity edge"] = places[0] if between_rows[0] else curve.zero(k)
    if len(places) == 2:
        corners = not any(between_rows) and curve.shift
        figures["width"] = corners or combined((1.0, places[0]), (-1.0, places[1]))
    if np.any(at_top):
        top = curve.top(k)
        figures["top speed"] = curve.fit.estimate(lambda v: v[top])
        figures["saturation edge"] = between(float(x[on_line].max()), float(x[at_top].min()))
        if k in curve.corners:
            figures["saturation edge"] = curve.fit.estimate(lambda v: (v[1 + k] + v[top]) / v[0])
    return figures


def _edge(
    curve: _Curve, k: int, branch: float
) -> tuple[Estimate, tuple[float, float] | None] | None:
    """Where a branch starts or ends to turn, and between what rows it jumps; None if no row of
    it turns."""
    rows, line = curve.rows, curve.line
    here = (rows.side == k) & (rows.branch == branch)
    still, turns = here & (curve.regions == STILL), here & (curve.regions != STILL)
    if not turns.any():
        return None
    zero, first = curve.zero(k, branch), float(np.min(rows.x[turns]))
    held = still & (line > 0.0)
    better = float(np.sum((rows.y[held] - line[held]) ** 2 - rows.y[held] ** 2))
    if still.any() and not curve.is_better(better):
        return replace(zero, high=max(zero.high, first)), None
    last = max(float(np.max(rows.x[still], initial=0.0)), zero.value)
    return between(last, first), (last, first)


def motor_step(
    time: Array, speed: Array, voltage: Array | None = None
) -> tuple[list[Figure], list[str]]:
    """Return time constant and, with the voltage, gain of a step up or down; and doubts.

    Args:
        time, speed: rows [s], [rad/s], shape (n,).
        voltage: [V], shape (n,), constant but for one step; without a step in it the motor stood
            still without voltage before the record.

    Raises:
        UserError: fewer than 6 rows after the step, a second step, or a record that ends
            before the time constant shows.
    """
    first = _begun(speed, voltage)
    since, after = time[first:] - time[first], speed[first:]
    if len(since) < 6:
        raise UserError(
            f"{len(since)} rows after the step: give at least 6, until the speed settles"
        )
    final = float(np.mean(after[-max(len(after) // 10, 1) :]))
    covered = np.abs(after - after[0]) >= (1.0 - math.exp(-1.0)) * abs(final - after[0])
    slow = math.log(max(since[np.argmax(covered)], since[1]))
    best = fit(
        lambda t, final, change, slow: final + change * np.exp(-t * np.exp(-slow)),
        since,
        after,
        [final, after[0] - final, slow],
    )
    constant = best.estimate(lambda v: math.exp(v[2]))
    if constant.low <= 0.0 or constant.value > since[-1]:
        raise UserError(
            "the speed does not settle as that of a first order does; record until it stays"
        )
    figures = [Figure("time constant T", constant, "s", parameter="motor_time_constant")]
    if voltage is not None:
        before, size = speed[:first], float(np.mean(voltage[first:]))
        start = Estimate.of(0.0)  # the speed before, if no row shows it
        if first:
            size -= voltage[0]
            start = Estimate.of(float(np.mean(before)), best.scatter / math.sqrt(first))
        if size == 0.0:
            raise UserError("the voltage is 0 throughout; leave its column out, or correct it")
        gain = combined((1.0 / size, best.estimate(lambda v: v[0])), (-1.0 / size, start))
        figures.append(Figure("gain of the step", gain, GAIN))
    doubt = (
        "the speed is not quite that of a first order, so that the standard errors are too small"
    )
    return figures, [doubt] * is_correlated(best.residuals)


def _begun(speeds: Array, voltages: Array | None) -> int:
    """First row after the step of the voltage, 0 if there is none; without a voltage that from
    which the speed has covered a tenth of its change for good."""
    if voltages is not None:
        above = voltages > 0.5 * (np.min(voltages) + np.max(voltages))
        changes = np.flatnonzero(np.diff(above)) + 1
        if len(changes) > 1:
            raise UserError("the voltage changes more than once; cut the record to one step")
        return int(changes[0]) if len(changes) else 0
    covered = (speeds - speeds[0]) * np.sign(speeds[-1] - speeds[0])
    before = np.flatnonzero(covered < 0.1 * abs(speeds[-1] - speeds[0]))
    return int(before[-1]) + 1 if len(before) > 1 else 0
