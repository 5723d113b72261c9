"""Boxes in layers, and wires at right angles between them: the layout of a block diagram.

A box that follows stands below; a wire back runs up between the boxes.  Lengths are in points, y
runs down.  Source: Sugiyama, Tagawa, Toda, IEEE Trans. SMC 11 (1981) 109; places in a layer by a
linear program, as in Gansner et al., IEEE Trans. Softw. Eng. 19 (1993) 214.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from graphlib import TopologicalSorter
from itertools import pairwise, permutations

import numpy as np

GAP = 14.0  # distance between boxes of a layer [pt]
LANE = 7.0  # distance between parallel wires [pt]
HEAD = 10.0  # length of a wire above a box, for the head of its arrow [pt]
TRIES = 8  # attempts at most to keep wires apart that would lie on one another
SWEEPS = 40  # passes over all layers in search of their orders
SHELF = 600.0  # width of boxes without a wire in a layer, at most about [pt]
STIFF = 3.0  # weight of a wire's length past boxes over that at one: long wires are straight

TINY = 1e-3  # difference below which two places are the same [pt]

Point = tuple[float, float]


@dataclass(frozen=True)
class Net:
    """A wire from one box to others.

    Attributes:
        source: number of the box it leaves.
        at: where, right of the middle of that box and below its upper edge [pt].
        sinks: numbers of boxes, at least one, with where it enters; None for wherever it fits.
    """

    source: int
    at: Point
    sinks: tuple[tuple[int, float | None], ...]


@dataclass
class Route:
    """A wire as it is drawn.

    Attributes:
        back: whether it also leads to a box that is not further down.
        lines: straight pieces, from point to point [pt].
        heads: where it enters boxes, from above [pt].
        dots: where it branches [pt].
    """

    back: bool
    lines: list[tuple[Point, Point]] = field(default_factory=list)
    heads: list[Point] = field(default_factory=list)
    dots: list[Point] = field(default_factory=list)


@dataclass(eq=False)
class _Item:
    """An item of a layer: a box, or a wire that passes, which has no size."""

    layer: int
    width: float = 0.0
    height: float = 0.0
    x: float = 0.0
    y: float = 0.0


@dataclass(eq=False)
class _End:
    """Point where a wire meets an item; ``origin`` is its other end if it may enter anywhere."""

    item: _Item
    below: bool
    offset: float = 0.0
    down: float = 0.0
    origin: _End | None = None

    @property
    def x(self) -> float:
        return self.item.x + self.offset


_Channel = dict[int, list[_End]]  # wires between two layers: their ends, by wire


def arrange(sizes: Sequence[Point], nets: Sequence[Net]) -> tuple[list[Point], list[Route], Point]:
    """Return the upper middle of each box, how each wire runs, and the extent of it all [pt].

    No wire crosses a box, and no two wires lie on one another.

    Args:
        sizes: width and height of each box [pt].
        nets: between them; the way begins at the first box.  Boxes without a wire stand last.

    Example:
        >>> wire = Net(0, (0.0, 20.0), ((1, None),))
        >>> places, _, extent = arrange([(40.0, 20.0), (40.0, 20.0)], [wire])
        >>> places, extent
        ([(20.0, 0.0), (20.0, 37.0)], (40.0, 57.0))
    """
    layer = _layers(sizes, nets)
    items = [_Item(layer[box], *size) for box, size in enumerate(sizes)]
    rows = [[item for item in items if item.layer == k] for k in range(max(layer) + 1)]
    channels: list[_Channel] = [{} for _ in range(len(rows) + 1)]
    for k, net in enumerate(nets):
        _thread(k, net, items, rows, channels)
    _order(rows, channels)
    apart: list[tuple[_End, _End]] = []
    width = _place(rows, channels, apart)
    for _ in range(TRIES):  # now wires enter boxes in the order in which they come
        width = _place(rows, channels, apart)
        clashes = [pair for channel in channels for pair in _tracks(channel)[1]]
        apart += clashes
        if not clashes:
            break
    routes = [Route(any(layer[box] <= layer[net.source] for box, _ in net.sinks)) for net in nets]
    y = 0.0
    for row, channel in zip([*rows, []], channels):
        tracks, _ = _tracks(channel)
        first = y + LANE
        y = first + LANE * max(tracks.values()) + HEAD if tracks else y + GAP * bool(y and row)
        for item in row:
            item.y = y
        for k, wire in channel.items():
            _draw(routes[k], wire, first + LANE * tracks[k])
        y += max((item.height for item in row), default=0.0)
    return [(item.x, item.y) for item in items], routes, (width, y)


def _layers(sizes: Sequence[Point], nets: Sequence[Net]) -> list[int]:
    """The layer of each box: below all boxes that lead to it, except by wires back.

    In a loop, a wire is one back if it ends nearer to the first box than it begins.
    """
    boxes = range(len(sizes))
    follows: list[set[int]] = [set() for _ in boxes]
    for net in nets:
        follows[net.source] |= {box for box, _ in net.sinks}
    beyond = [_reached([*follows[box]], follows) for box in boxes]
    met = list(dict.fromkeys(one for box in boxes for one in _reached([box], follows)))
    before: dict[int, list[int]] = {box: [] for box in boxes}
    for box in boxes:
        for after in follows[box]:
            if box not in beyond[after] or met.index(box) < met.index(after):
                before[after].append(box)
    layer = [0 for _ in boxes]
    for box in TopologicalSorter(before).static_order():
        layer[box] = max((layer[one] + 1 for one in before[box]), default=0)
    last, x = max(layer) + 1, 0.0
    for box in boxes:
        below = [layer[after] for after in follows[box] if box in before[after]]
        if below and not before[box]:
            layer[box] = min(below) - 1
        elif not follows[box] and all(box not in after for after in follows):
            x += sizes[box][0] + GAP
            layer[box] = last + int(x / SHELF)
    return layer


def _reached(boxes: list[int], follows: Sequence[set[int]]) -> list[int]:
    """Boxes and all that follows them, the nearest first."""
    for box in boxes:
        boxes += [after for after in sorted(follows[box]) if after not in boxes]
    return boxes


def _thread(
    k: int, net: Net, items: list[_Item], rows: list[list[_Item]], channels: list[_Channel]
) -> None:
    """Lead a wire through the layers between its boxes."""
    source = items[net.source]
    reached = [source.layer + 1, *(items[box].layer for box, _ in net.sinks)]
    channels[source.layer + 1][k] = [_End(source, True, *net.at)]
    for layer in range(min(reached), max(reached)):
        passing = _Item(layer)
        rows[layer].append(passing)
        channels[layer].setdefault(k, []).append(_End(passing, False))
        channels[layer + 1].setdefault(k, []).append(_End(passing, True))
    for box, at in net.sinks:
        wire, forward = channels[items[box].layer][k], items[box].layer > source.layer
        origin = next(end for end in wire if end.below == forward)
        wire.append(_End(items[box], False, at or 0.0, origin=None if at is not None else origin))


def _order(rows: list[list[_Item]], channels: list[_Channel]) -> None:
    """Put every layer in the order, of those tried, that makes the wires shortest."""
    joined: dict[_Item, list[tuple[_End, list[_End]]]] = {item: [] for row in rows for item in row}
    wires = [wire for channel in channels for wire in channel.values()]
    for wire in wires:
        for end in wire:
            joined[end.item].append((end, [other for other in wire if other is not end]))

    def wish(item: _Item, below: bool) -> float:
        """Place of an item in the middle of the items it is joined with on one side."""
        wishes = [
            sum(other.x for other in others) / len(others) - end.offset
            for end, others in joined[item]
            if end.below == below
        ]
        return sum(wishes) / len(wishes) if wishes else item.x

    shortest, best = math.inf, rows
    for sweep in range(SWEEPS):
        up = sweep % 2 == 1
        for row in reversed(rows) if up else rows:
            wishes = {item: wish(item, below=up) for item in row}
            row.sort(key=wishes.__getitem__)
            right = -math.inf
            for item, after in zip(row, [*row[1:], row[-1]]):
                item.x = max(wishes[item], right)
                right = item.x + _apart(item, after)
            shift = sum(wishes[item] - item.x for item in row) / len(row)
            for item in row:
                item.x += shift
        length = sum(high - low for low, high in map(_span, wires))
        if length < shortest:
            shortest, best = length, [[*row] for row in rows]
    rows[:] = best


def _apart(left: _Item, right: _Item) -> float:
    """Least distance between the middles of two neighbours."""
    return (left.width + right.width) / 2 + (GAP if left.width and right.width else LANE)


def _span(wire: Sequence[_End]) -> Point:
    """Where a wire between two layers begins and ends."""
    places = [end.x for end in wire]
    return min(places), max(places)


def _place(
    rows: list[list[_Item]], channels: list[_Channel], apart: Sequence[tuple[_End, _End]]
) -> float:
    """Place all items, and the wires at boxes, so that wires are shortest; return the width.

    Pairs of ends that are to be ``apart`` keep their order.
    """
    cost = [1.0]  # of each variable; the first one is the width
    steps: list[tuple[int, int, float]] = []  # by how much a variable is less than another

    def variable(weight: float = 0.0) -> int:
        cost.append(weight)
        return len(cost) - 1

    at = {item: variable() for row in rows for item in row}
    for row in rows:
        steps += [(at[left], at[right], _apart(left, right)) for left, right in pairwise(row)]
    entries: dict[_Item, list[tuple[float, int, _End]]] = {item: [] for item in at}
    where: dict[_End, tuple[int, float]] = {}
    for wire in (wire for channel in channels for wire in channel.values()):
        weight = 1.0 if any(end.item.width for end in wire) else STIFF
        low, high = variable(-weight), variable(weight)
        for end in wire:
            place = at[end.item]
            if end.origin:
                place = variable()
                entries[end.item].append((end.origin.x, place, end))
            offset = 0.0 if end.origin else end.offset
            steps += [(low, place, -offset), (place, high, offset)]
            where[end] = place, offset
    for pair in apart:
        (left, offset), (right, further) = (where[end] for end in sorted(pair, key=lambda e: e.x))
        steps.append((left, right, offset - further + LANE / 2))
    for item, met in entries.items():
        steps.append((at[item], 0, item.width / 2))
        margin = min(LANE, item.width / (len(met) + 1))
        order = [place for _, place, _ in sorted(met, key=lambda entry: entry[0])]
        steps += [(left, right, margin) for left, right in pairwise(order)]
        steps += [(at[item], place, margin - item.width / 2) for place in order[:1]]
        steps += [(place, at[item], margin - item.width / 2) for place in order[-1:]]
    differences = np.zeros((len(steps), len(cost)))
    for k, (less, more, _) in enumerate(steps):
        differences[k, less], differences[k, more] = 1.0, -1.0
    least = np.zeros(len(cost))
    least[[*at.values()]] = [item.width / 2 for item in at]
    bounds = np.column_stack([least, np.full(len(cost), np.inf)])
    from scipy.optimize import linprog  # late: it loads for longer than a diagnosis takes

    solution = linprog(cost, differences, [-step for *_, step in steps], bounds=bounds).x.tolist()
    for item, place in at.items():
        item.x = solution[place]
        for _, entry, end in entries[item]:
            end.offset = solution[entry] - item.x
    return float(solution[0])


def _tracks(channel: _Channel) -> tuple[dict[int, int], list[tuple[_End, _End]]]:
    """The track of each wire between two layers; a wire that comes down on another goes first.

    Where several wires come down on each other in a cycle, the pairs of ends that clash come too.
    """
    spans = {k: _span(wire) for k, wire in channel.items()}
    upon = {
        (above, below): [
            (upper, lower)
            for upper in channel[above]
            for lower in channel[below]
            if upper.below and not lower.below and abs(upper.x - lower.x) < LANE / 2 - TINY
        ]
        for above, below in permutations(channel, 2)
    }
    tracks: dict[int, int] = {}
    clashes: list[tuple[_End, _End]] = []
    waiting = sorted(spans, key=spans.__getitem__)
    while waiting:
        free = (k for k in waiting if not any(upon[j, k] for j in waiting if j != k))
        k = next(free, waiting[0])
        waiting.remove(k)
        clashes += [pair for j in waiting for pair in upon[j, k]]
        track = max((tracks[j] + 1 for j in tracks if upon[j, k]), default=0)
        low, high = spans[k]
        while any(
            at == track and spans[j][0] < high + LANE and low < spans[j][1] + LANE
            for j, at in tracks.items()
        ):
            track += 1
        tracks[k] = track
    return tracks, clashes


def _draw(route: Route, wire: list[_End], y: float) -> None:
    """Draw a wire between two layers, on its track at ``y``."""
    low, high = _span(wire)
    route.lines.append(((low, y), (high, y)))
    for end in wire:
        route.lines.append(((end.x, y), (end.x, end.item.y + end.down)))
        if low < end.x < high or (len(wire) > 2 and sum(one.x == end.x for one in wire) > 1):
            route.dots.append((end.x, y))
        if end.item.width and not end.below:
            route.heads.append((end.x, end.item.y))
