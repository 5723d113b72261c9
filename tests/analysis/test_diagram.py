"""Block diagrams: true to the chain that is flattened, and legible."""

from __future__ import annotations

import random
import re
from collections import Counter
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import pytest

from servo_models.analysis.diagram import Box, boxes, diagram
from servo_models.analysis.pictures import save
from servo_models.catalogue import actuator, actuators
from servo_models.core.block import Block
from servo_models.core.plant import Placement, Plant
from servo_models.report.layers import Net, arrange
from servo_models.report.style import figure
from tests.conftest import Run
from tests.support.own_actuators import WITH_EFFECTS, write

PLANTS = {
    f"{found.name}-{variant.name}": found.plant_of(variant.name)
    for found in actuators().values()
    for variant in found.variants
    if variant.plant or variant is found.variants[0]
}


def wires_of(plant: Plant) -> list[str]:
    """Every wire of a plant, from its declaration."""
    given = [wire for link in plant.chain if isinstance(link, Block) for wire in link.gives]
    every = [*(it.name for it in plant.inputs), *(it.name for it in plant.states), *given]
    acted_on = {it for link in plant.chain if isinstance(link, Placement) for it in link.on}
    return every + sorted(acted_on - {*every})  # parameters that an effect rewrites


@pytest.mark.parametrize("name", actuators())
def test_every_wire_and_every_placed_effect_is_drawn_once(name: str) -> None:
    found = actuators()[name]
    texts = figure(diagram(found)).axes[0].texts
    effects = " ".join(text.get_text() for text in texts if text.get_fontsize() == 7.0)
    placed = Counter(link.name for link in found.plant.chain if isinstance(link, Placement))
    assert {it: len(re.findall(rf"\b{it}\b", effects)) for it in placed} == placed
    labels = Counter(text.get_text().split(" [")[0] for text in texts if text.get_fontsize() == 8.0)
    again = {it for it in found.plant.outputs if labels[it] == 2}  # where it leaves, behind effects
    rewritten = {it for link in found.plant.placements.values() for one in link for it in one.on}
    assert again <= rewritten
    assert labels - Counter(again) == Counter(wires_of(found.plant))


def way(wire: str, reader: Box, found: list[Box]) -> list[str]:
    """The effects that a wire passes on its way to a box, from its definition on."""
    (source,) = (box for box in found if reader in box.sinks.get(wire, []))
    before = [] if source.defines else way(wire, source, found)
    return before + [link.owner for link in source.effects if wire in link.writes]


@pytest.mark.parametrize("plant", PLANTS.values(), ids=PLANTS)
def test_lines_are_the_connections_of_the_plant(plant: Plant) -> None:
    """Each block has a line for each wire that it reads, through the effects before it."""
    found, known = boxes(plant), {*wires_of(plant)}
    lines = {(wire, to) for box in found for wire, sinks in box.sinks.items() for to in sinks}
    assert len(lines) == sum(len(sinks) for box in found for sinks in box.sinks.values())
    expected = set()
    for k, link in enumerate(plant.chain):
        placed = [it for it in plant.chain[:k] if isinstance(it, Placement)]
        if isinstance(link, Block):
            readers = [it for it in found if it.title == link.name and it.wires[0] in link.gives]
            for wire in {wire.removeprefix("start_") for wire in link.wires} & known:
                for box in readers:
                    expected.add((wire, box))
                    assert way(wire, box, found) == [it.name for it in placed if wire in it.on]
    placed = [it for it in plant.chain if isinstance(it, Placement)]
    for state in plant.states:
        (box,) = (it for it in found if it.wires == (state.name,))
        expected.add((state.rate, box))
        assert way(state.rate, box, found) == [it.name for it in placed if state.rate in it.on]
    assert {(wire, box) for wire, box in lines if box.title} == expected
    through = [(wire, box) for wire, box in lines if not box.title]
    assert all(wire in link.writes for wire, box in through for link in box.effects[:1])


@pytest.mark.parametrize("name", ["sg90", "smart_servo"])
def test_no_text_lies_on_another(name: str) -> None:
    drawn = figure(diagram(actuators()[name]))
    extents = [text.get_window_extent() for text in drawn.axes[0].texts]
    assert not any(one.overlaps(other) for one, other in combinations(extents, 2))
    assert all(drawn.bbox.contains(*corner) for it in extents for corner in (it.min, it.max))


def tangle(seed: int) -> tuple[list[tuple[float, float]], list[Net]]:
    """Boxes with wires between any of them, also to themselves."""
    draw = random.Random(seed)
    sizes = [(draw.uniform(40.0, 160.0), draw.uniform(20.0, 80.0)) for _ in range(15)]
    nets = []
    for box, (width, height) in enumerate(sizes):
        sinks = draw.sample(range(len(sizes)), draw.randint(0, 3))
        if sinks:
            at = draw.uniform(-width / 2, width / 2), height
            nets.append(Net(box, at, tuple((sink, None) for sink in sinks)))
    return sizes, nets


@pytest.mark.parametrize("seed", range(20))
def test_wires_cross_no_box_and_lie_on_no_other(seed: int) -> None:
    sizes, nets = tangle(seed)
    places, routes, (width, height) = arrange(sizes, nets)
    frames = [(x - w / 2, y, x + w / 2, y + h) for (x, y), (w, h) in zip(places, sizes)]
    for (left, top, right, bottom), (left_2, top_2, right_2, bottom_2) in combinations(frames, 2):
        assert right <= left_2 or right_2 <= left or bottom <= top_2 or bottom_2 <= top
    for net, route in zip(nets, routes):
        assert len(route.heads) == len(net.sinks)
        for (x, y), (x_2, y_2) in route.lines:
            assert x == x_2 or y == y_2
            assert min(x, x_2) >= 0.0
            assert max(x, x_2) <= width
            assert max(y, y_2) <= height
            for left, top, right, bottom in frames:
                beside = max(x, x_2) <= left or right <= min(x, x_2)
                assert beside or max(y, y_2) <= top or bottom <= min(y, y_2)
    for one, other in combinations(routes, 2):
        for (a, b), (c, d) in ((p, q) for p in one.lines for q in other.lines):
            for along, across in ((0, 1), (1, 0)):
                parallel = a[across] == b[across] and c[across] == d[across]
                low = max(min(a[along], b[along]), min(c[along], d[along]))
                high = min(max(a[along], b[along]), max(c[along], d[along]))
                assert not parallel or low >= high or abs(a[across] - c[across]) > 1.0


def test_hostile_names_stay_text(tmp_path: Path) -> None:
    found, hostile = actuator("sg90"), "$\\frac{<script>&"
    wires = tuple(replace(wire, display=hostile) for wire in found.plant.wires)
    drawn, plant = tmp_path / "x.svg", replace(found.plant, wires=wires)
    save(figure(diagram(replace(found, plant=plant))), drawn)
    tree = ElementTree.parse(drawn)
    assert f"error [{hostile}]" not in tree.getroot().itertext()  # it has no unit
    assert f"supply [{hostile}]" in tree.getroot().itertext()
    assert not tree.findall(".//{*}script")


def test_the_diagram_of_an_own_actuator_is_written(run: Run, tmp_path: Path) -> None:
    own, drawn = write(tmp_path, changes=WITH_EFFECTS), tmp_path / "joint.svg"
    code, _, _ = run("explain", own, "--diagram", drawn)
    assert code == 0
    texts = {*ElementTree.parse(drawn).getroot().itertext()}
    assert {"joint, variant plain", "goal [rad]", "follow", "speed_limit", "angle [rad]"} <= texts


def test_an_effect_has_no_block_diagram(run: Run, tmp_path: Path) -> None:
    code, _, err = run("explain", "backlash", "--diagram", tmp_path / "x.svg")
    assert code == 2
    assert "'backlash' is no actuator" in err
