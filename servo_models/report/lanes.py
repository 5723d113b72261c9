"""Boxes one below the other, and wires at right angles beside them: the layout of a block diagram.

A wire to the next box runs straight down.  Any other has a lane: right of the boxes where it leads
down, left of them where it leads back.  Lengths are in points, y runs down.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

LANE = 7.0  # distance between parallel wires [pt]
HEAD = 10.0  # length of a wire above a box, for the head of its arrow [pt]
RIGHT, NEAR, LEFT = 1, 0, -1  # NEAR: straight down from above, then to a column of the box

Point = tuple[float, float]
Way = tuple[int, int]  # a wire, by its number, and the side on which it has a lane


@dataclass(frozen=True)
class Net:
    """A wire from one box to others.

    Attributes:
        source: number of the box it leaves.
        at: where, right of the middle of that box and below its upper edge [pt].
        sinks: numbers of boxes, at least one, with where it enters from above, right of the middle;
            None for wherever it fits.
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
        heads: where it enters boxes, with the way along which it does.
        dots: where it branches [pt].
    """

    back: bool
    lines: list[tuple[Point, Point]] = field(default_factory=list)
    heads: list[tuple[Point, Point]] = field(default_factory=list)
    dots: list[Point] = field(default_factory=list)

    def run(self, *points: Point) -> None:
        """Add pieces through these points."""
        self.lines += pairwise(points)

    def enter(self, point: Point, end: Point) -> None:
        """Add a piece with a head, down or to one side."""
        self.run(point, end)
        across = end[0] - point[0]
        self.heads.append((end, (across / abs(across), 0.0) if across else (0.0, 1.0)))


def arrange(sizes: Sequence[Point], nets: Sequence[Net]) -> tuple[list[Point], list[Route], Point]:
    """Return the upper middle of each box, how each wire runs, and the extent of it all [pt].

    No wire crosses a box, and no two wires lie on one another.

    Args:
        sizes: width and height of each box [pt].
        nets: between them; the boxes stand in their order, but one to which nothing leads stands
            above the first that it leads to, and those without a wire are last.

    Example:
        >>> wire = Net(0, (0.0, 20.0), ((1, None),))
        >>> places, _, extent = arrange([(40.0, 20.0), (40.0, 20.0)], [wire])
        >>> places, extent
        ([(20.0, 0.0), (20.0, 37.0)], (40.0, 57.0))
    """
    plan = _Plan(sizes, nets)
    height = plan.stack()
    routes = [plan.route(k) for k in range(len(nets))]
    return [(plan.middle, top) for top in plan.tops], routes, (plan.width, height)


class _Plan:
    """Where boxes stand and wires run; ``row`` is the place of a box from above, ``ways`` are the
    boxes that a wire reaches on a side."""

    def __init__(self, sizes: Sequence[Point], nets: Sequence[Net]) -> None:
        self.sizes, self.nets = sizes, nets
        self.order = _order(len(sizes), nets)
        self.row = row = {box: k for k, box in enumerate(self.order)}
        self.straight: set[tuple[int, int]] = set()  # wires with the boxes right below
        self.ways: dict[Way, list[tuple[int, float | None]]] = defaultdict(list)
        for k, net in enumerate(nets):
            for box, at in net.sinks:
                is_next = row[box] == row[net.source] + 1
                if is_next and at is None and abs(net.at[0]) < sizes[box][0] / 2 - LANE / 2:
                    self.straight.add((k, box))
                    continue
                side = RIGHT if row[box] > row[net.source] else LEFT
                self.ways[k, NEAR if is_next and at is not None else side].append((box, at))
        spans = {  # a wire leaves below its box
            way: [row[nets[way[0]].source] + 0.5, *(row[box] for box, _ in sinks)]
            for way, sinks in self.ways.items()
            if way[1] != NEAR
        }
        self.lanes = _lanes({way: (min(rows), max(rows)) for way, rows in spans.items()})
        half = max(width for width, _ in sizes) / 2
        left, right = (
            half + LANE * max((1 + n for way, n in self.lanes.items() if way[1] == side), default=0)
            for side in (LEFT, RIGHT)
        )
        self.middle, self.width = left, left + right
        self.lane_x = {
            way: left + way[1] * (half + LANE * (1 + self.lanes[way]))
            if way[1] != NEAR
            else left + nets[way[0]].at[0]
            for way in self.ways
        }
        self.tops = [0.0 for _ in sizes]
        self.leave: dict[int, float] = {}  # y at which a wire turns to its lanes,
        self.enter: dict[tuple[Way, int], float] = {}  # and at which it comes from one to a box

    def stack(self) -> float:
        """Put the boxes one below the other, with room for wires between; return the height."""
        y = -HEAD
        for box in self.order:
            coming = [(way, at) for way, to in self.ways.items() for it, at in to if it == box]
            above = sorted(way for way, at in coming if at is not None)
            above.sort(key=lambda way: way[1] != NEAR)  # from a box right above it, first
            beside = [way for way, at in coming if at is None]
            for way in above:
                y += LANE
                self.enter[way, box] = y
            self.tops[box] = y = y + HEAD
            for side in (LEFT, RIGHT):  # no lane crosses those that end at its box
                mine = sorted((way for way in beside if way[1] == side), key=self._inside)
                step = min(LANE, self.sizes[box][1] / (len(mine) + 1))
                self.enter |= {(way, box): y + step * n for n, way in enumerate(mine, 1)}
            y += self.sizes[box][1]
            for k in dict.fromkeys(k for k, _ in self.ways if self.nets[k].source == box):
                y += LANE
                self.leave[k] = y
            y += LANE
        return y - LANE

    def _inside(self, way: Way) -> int:
        """What sorts wires to one side of a box from above: those from above begin with the lane
        next to the box, those from below with the furthest."""
        return way[1] * self.lanes[way]

    def route(self, k: int) -> Route:
        """How a wire runs."""
        net, ways = self.nets[k], [way for way in self.ways if way[0] == k]
        x, bottom = self.middle + net.at[0], self.tops[net.source] + net.at[1]
        route = Route(any(self.row[box] <= self.row[net.source] for box, _ in net.sinks))
        below = [box for box, _ in net.sinks if (k, box) in self.straight]
        for box in below:
            route.enter((x, bottom), (x, self.tops[box]))
        if ways and len(ways) + len(below) > 1:
            route.dots.append((x, self.leave[k]))
        for way in ways:
            lane, ends = self.lane_x[way], [self.enter[way, box] for box, _ in self.ways[way]]
            far = min(ends) if way[1] == LEFT else max(ends)
            route.run((x, bottom), (x, self.leave[k]), (lane, self.leave[k]), (lane, far))
            route.dots += [(lane, end) for end in ends if end != far]
            for (box, at), end in zip(self.ways[way], ends):
                if at is None:
                    edge = self.middle + way[1] * self.sizes[box][0] / 2
                    route.enter((lane, end), (edge, end))
                else:
                    column = self.middle + at
                    route.run((lane, end), (column, end))
                    route.enter((column, end), (column, self.tops[box]))
        return route


def _order(count: int, nets: Sequence[Net]) -> list[int]:
    """The boxes from top to bottom."""
    place = dict.fromkeys(range(count), float(count))  # without a wire: last
    for net in nets:
        first = min(box for box, _ in net.sinks) - 0.5
        place[net.source] = min(place[net.source], first)
    place |= {box: float(box) for net in nets for box, _ in net.sinks}
    return sorted(place, key=place.__getitem__)


def _lanes(spans: Mapping[Way, Point]) -> dict[Way, int]:
    """The lane of each span, short ones further in, so that no two in a lane of a side meet."""
    lanes: dict[Way, int] = {}
    for way in sorted(spans, key=lambda it: (spans[it][1] - spans[it][0], it)):
        low, high = spans[way]
        beside = (it for it in lanes if it[1] == way[1])
        met = {lanes[it] for it in beside if spans[it][0] <= high and low <= spans[it][1]}
        lanes[way] = min({*range(len(met) + 1)} - met)
    return lanes
