"""The block diagram of a plant: blocks, the wires between them, and where effects attach.

It is drawn from the declaration alone, and runs down the page, as names are wide and low.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, groupby, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from servo_models.core.block import RESERVED, START
from servo_models.core.flatten import Link
from servo_models.core.plant import Actuator, Plant
from servo_models.report.layers import Net, Point, Route, arrange
from servo_models.report.sections import Picture
from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KEY = (
    "Rounded: inputs and outputs. Dashed: effects, which rewrite the wire above them one after the"
    " other, and states that are theirs; in brackets what they read beside it. Blue: wires of"
    " which a branch leads back. A block of parameters alone stands at each of its wires."
)
TITLE = 8.5  # size of a block's letters [pt]
LABEL = 8.0  # size of a wire's letters [pt]
SMALL = 7.0  # size of an effect's letters [pt]
EM = 0.63  # width of a letter over its size, rounded up
LINE = 1.35  # distance of lines over the size of their letters
HIGH = 13.0  # height of a wire's label [pt]
PAD = 5.0  # distance of a text from its frame [pt]
WRAP = 30  # letters in a line of an effect
INCH = 72.0  # points in an inch
MARGIN = 8.0  # margin around the diagram [pt]
NARROW = 16.0  # width of a wire through an effect [pt]
BOLD = 1.1  # width of bold letters over that of regular ones
BLOCK = {"ec": colour("ink"), "lw": 1.0}
EFFECT = {"ec": colour("orange"), "lw": 0.8, "ls": (0.0, (3.0, 2.0))}
TERMINAL = {"ec": colour("green"), "lw": 0.9}


@dataclass(eq=False)
class Box:
    """A block, a state or an input, with the effects on what it gives; or effects alone.

    Attributes:
        title: name of the block, the sign of an integral for a state, else "".
        wires: the wires that leave it, from left to right.
        defines: whether it defines these wires; else other boxes do.
        owner: effect that a state belongs to, "" for the plant.
        effects: on its wires, in their order.
        sinks: boxes that take each wire as it leaves.
        outputs: wires that are outputs of the actuator as they leave this box.
    """

    title: str
    wires: tuple[str, ...]
    defines: bool = True
    owner: str = ""
    effects: list[Link] = field(default_factory=list)
    sinks: dict[str, list[Box]] = field(default_factory=dict)
    outputs: list[str] = field(default_factory=list)


def boxes(plant: Plant) -> list[Box]:
    """Return the boxes of a plant, joined as its chain joins them: inputs, states, the chain.

    An effect belongs to the box that gives its wires, unless another box took one before it.
    """
    states = {state: Box("∫", (state.name,), owner=state.owner) for state in plant.states}
    all_boxes = [*(Box("", (wire.name,)) for wire in plant.inputs), *states.values()]
    at = {wire: box for box in all_boxes for wire in box.wires}

    def add(box: Box, reads: Sequence[str]) -> None:
        for wire in reads:
            at[wire].sinks.setdefault(wire, []).append(box)
        all_boxes.append(box)
        at.update(dict.fromkeys(box.wires, box))

    for link in [Link.of(link) for link in plant.chain]:
        if link.owner:
            box = at.get(link.writes[0])
            if (
                not box
                or {at.get(it) for it in link.writes} != {box}
                or {*link.writes} & {*box.sinks}
            ):
                box = Box("", link.writes, defines=not box)
                add(box, [wire for wire in link.writes if wire in at])
            box.effects.append(link)
            continue
        every = (wire.removeprefix(START) for wire in link.reads.values())
        reads = [wire for wire in dict.fromkeys(every) if wire in at]
        for wires in [link.writes] if reads else [(wire,) for wire in link.writes]:
            add(Box(link.block.name, wires), reads)
    for state, box in states.items():
        at[state.rate].sinks.setdefault(state.rate, []).append(box)
    for wire in plant.outputs:
        at[wire].outputs.append(wire)
    return all_boxes


def diagram(actuator: Actuator, variant: str | None = None) -> Picture:
    """Return the block diagram of an actuator, in its natural size.

    Raises:
        UserError: no variant of that name.

    Example:
        >>> import servo_models as sm
        >>> diagram(sm.actuator("sg90")).title
        'Block diagram'
    """
    plant = actuator.plant_of(variant)
    title = f"{actuator.name}, variant {actuator.variant(variant).name}"
    all_boxes = boxes(plant)
    sheets = {box: _Sheet(box, plant) for box in all_boxes}
    number = {box: k for k, box in enumerate(all_boxes)}
    nets = []
    for box in all_boxes:
        for wire, sinks in box.sinks.items():
            ends = ((it, None if it.title else sheets[it].columns[wire]) for it in sinks)
            entries = tuple((number[it], at) for it, at in ends)
            nets.append(Net(number[box], sheets[box].leaves(wire), entries))
    sizes = [(sheet.width, sheet.height) for sheet in sheets.values()]
    places, routes, (width, height) = arrange(sizes, nets)
    contact = plant.projection
    rule = f" After a step '{contact.name}' sets {' and '.join(contact.gives)}." if contact else ""
    notes = textwrap.wrap(KEY + rule, int(width / (EM * SMALL)))
    top, bottom = -2.0 * LINE * TITLE, height + LINE * SMALL * (len(notes) + 1.0)

    def draw(panels: Sequence[Axes]) -> None:
        (axes,) = panels
        axes.figure.set_layout_engine("none")  # type: ignore[union-attr]
        axes.set_position((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set(xlim=(-MARGIN, width + MARGIN), ylim=(bottom + MARGIN, top - MARGIN))
        _write(axes, 0.0, top, title, size=TITLE, weight="bold", ha="left")
        for k, note in enumerate(notes):
            y = height + LINE * SMALL * (k + 1.5)
            _write(axes, 0.0, y, note, size=SMALL, ha="left", color=colour("muted"))
        for route in routes:
            _draw(axes, route)
        for sheet, (x, y) in zip(sheets.values(), places):
            sheet.draw(axes, x, y)

    extent = (width + 2.0 * MARGIN) / INCH, (bottom - top + 2.0 * MARGIN) / INCH
    return Picture("Block diagram", draw, width=extent[0], height=extent[1])


class _Sheet:
    """A box with its texts and frames; x is from its middle to the right, y runs down [pt].

    Attributes:
        width, height: of the box with its texts.
        columns: where each wire leaves.
    """

    def __init__(self, box: Box, plant: Plant) -> None:
        self.texts: list[tuple[float, float, str, dict[str, Any]]] = []
        self.frames: list[tuple[float, float, float, float, dict[str, Any]]] = []
        self.labels = {wire: _label(plant, wire) for wire in box.wires}
        effects = [
            (on, [line for link in links for line in _lines(link)])
            for on, links in groupby(box.effects, lambda link: link.writes)
        ]
        edges = self._columns(box, effects)
        y = self._head(box, {wire.name for wire in plant.inputs})
        self.bottoms = dict.fromkeys(box.wires, y)
        for on, lines in effects:
            y = max(self.bottoms[wire] for wire in on)
            left, right = min(edges[wire][0] for wire in on), max(edges[wire][1] for wire in on)
            for k, line in enumerate(lines):
                look = {"size": SMALL, "color": colour("orange")}
                middle = y + PAD / 2 + LINE * SMALL * (k + 0.5)
                self.texts.append(((left + right) / 2, middle, line, look))
            self.bottoms |= dict.fromkeys(on, y + PAD + LINE * SMALL * len(lines))
            self.frames.append((left, y, right, self.bottoms[on[0]], EFFECT))
        for wire in box.outputs:
            if not box.defines or any(wire in on for on, _ in effects):
                self._terminal(wire, self.bottoms[wire] + PAD / 2)
                self.bottoms[wire] += PAD / 2 + HIGH
        self.height = max(self.bottoms.values())

    def _columns(
        self, box: Box, effects: Sequence[tuple[Sequence[str], list[str]]]
    ) -> dict[str, Point]:
        """Give each wire a column as wide as what stands on it."""
        widths = {
            wire: _width(label, LABEL) if box.defines or wire in box.outputs else NARROW
            for wire, label in self.labels.items()
        }
        for on, lines in effects:
            missing = max(_width(line, SMALL) for line in lines) - sum(widths[it] for it in on)
            widths |= {wire: widths[wire] + max(0.0, missing) / len(on) for wire in on}
        missing = BOLD * _width(box.title, TITLE) - sum(widths.values())
        shares = [width + max(0.0, missing) / len(widths) for width in widths.values()]
        self.width = sum(shares)
        ends = [right - self.width / 2 for right in accumulate(shares, initial=0.0)]
        edges = dict(zip(widths, pairwise(ends)))
        self.columns = {wire: sum(edge) / 2 for wire, edge in edges.items()}
        return edges

    def _head(self, box: Box, inputs: set[str]) -> float:
        """Write the title and the wires of a box; return the y at which they end."""
        y = 0.0
        if box.title:
            y = PAD / 2 + LINE * TITLE
            look = {"size": TITLE, "weight": "bold"}
            self.texts.append((0.0, PAD / 2 + LINE * TITLE / 2, box.title, look))
        if box.defines:
            for wire in box.wires:
                rewritten = any(wire in link.writes for link in box.effects)
                if wire in inputs or (wire in box.outputs and not rewritten):
                    self._terminal(wire, y)
                else:
                    self.texts.append((self.columns[wire], y + HIGH / 2, self.labels[wire], {}))
            y += HIGH + PAD / 2
        if box.title:
            look = {**BLOCK, "ls": EFFECT["ls"]} if box.owner else BLOCK
            self.frames.insert(0, (-self.width / 2, 0.0, self.width / 2, y, look))
        return y

    def _terminal(self, wire: str, y: float) -> None:
        x, label, high = self.columns[wire], self.labels[wire], HIGH
        half = _width(label, LABEL) / 2 - PAD / 2
        round_ = f"round,pad=0,rounding_size={high / 2}"
        self.frames.append((x - half, y, x + half, y + high, {**TERMINAL, "boxstyle": round_}))
        self.texts.append((x, y + high / 2, label, {}))

    def leaves(self, wire: str) -> Point:
        return self.columns[wire], self.bottoms[wire]

    def draw(self, axes: Axes, x: float, y: float) -> None:
        """Draw it with its upper middle at a place."""
        from matplotlib.patches import FancyBboxPatch

        for left, upper, right, lower, look in self.frames:
            square = {"boxstyle": "square,pad=0", "fc": colour("paper"), "zorder": 2.0, **look}
            axes.add_patch(
                FancyBboxPatch((x + left, y + upper), right - left, lower - upper, **square)
            )
        for dx, dy, text, look in self.texts:
            _write(axes, x + dx, y + dy, text, **look)


def _draw(axes: Axes, route: Route) -> None:
    ink = colour("blue" if route.back else "ink")
    pieces = [(*one, *other, math.nan, math.nan) for one, other in route.lines]
    places = np.array(pieces).reshape(-1, 2)
    axes.plot(*places.T, color=ink, lw=0.9, solid_capstyle="projecting")
    for x, y in route.heads:
        axes.fill([x - 2.6, x + 2.6, x], [y - 6.0, y - 6.0, y], color=ink, lw=0.0)
    axes.plot(*np.reshape(route.dots, (-1, 2)).T, "o", color=ink, ms=2.8)


def _write(axes: Axes, x: float, y: float, text: str, **look: Any) -> None:
    look = {"size": LABEL, "ha": "center", "va": "center", "zorder": 3.0, **look}
    axes.text(x, y, text, parse_math=False, **look)


def _width(text: str, size: float) -> float:
    """Room for a text in its frame [pt]."""
    return EM * size * len(text) + 2.0 * PAD


def _label(plant: Plant, wire: str) -> str:
    """A wire with the unit in which a person reads it; one that only blocks read has none."""
    declared = plant.wire.get(wire)
    unit = (declared.display or declared.unit) if declared else "1"
    return wire if unit == "1" else f"{wire} [{unit}]"


def _lines(effect: Link) -> list[str]:
    """An effect and, in brackets, the wires that it reads beside those on which it acts."""
    beside = [
        wire
        for argument, wire in effect.reads.items()
        if argument not in effect.block.acts_on and wire not in RESERVED
    ]
    return textwrap.wrap(f"{effect.owner} ({', '.join(beside)})" if beside else effect.owner, WRAP)
