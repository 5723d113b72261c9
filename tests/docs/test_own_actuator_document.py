"""``docs/own_actuator.md`` does what it says: its files, its commands, its refusals."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from servo_models.actuators import shaft
from servo_models.catalogue import actuator
from servo_models.core.block import RESERVED, Block
from servo_models.core.plant import place
from servo_models.effects import effects, effects_on
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.viscous_friction import viscous_friction
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.document import ROOT, code_blocks, follow

PAGE = (ROOT / "docs" / "own_actuator.md").read_text(encoding="utf-8")
BEGUN, COMMANDS = PAGE.split("## The listing")
LISTING, LOG = (text for text in code_blocks(PAGE, "python") if text.startswith('"""'))
(DESCRIPTION,) = code_blocks(PAGE, "toml")
FILES = {"gimbal.py": LISTING, "make_log.py": LOG, "gimbal.toml": DESCRIPTION}
REFUSED = re.findall(
    r"^\| `(.*?)` \| `(.*?)` \| `(.*?)` \|$", PAGE.split("## What is refused")[1], re.MULTILINE
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with the files that the page says to save there."""
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_example_is_what_the_page_shows() -> None:
    for name, text in FILES.items():
        assert (ROOT / "examples" / "gimbal" / name).read_text(encoding="utf-8") == text


def test_effects_by_name_make_the_same_chain(folder: Path) -> None:
    (by_name,) = (text for text in code_blocks(PAGE, "python") if "import effects_on" in text)
    listing = runpy.run_path("gimbal.py")
    names = dict(listing)
    exec(by_name, names)
    assert names["chain"] == listing["PLANT"].chain


def test_other_bounds_are_the_same_either_way(folder: Path) -> None:
    names = runpy.run_path("gimbal.py") | {"effects_on": effects_on}
    (params,) = re.findall(r"`params=({.*?})`", PAGE, re.S)
    (by_name,) = re.findall(r"Other bounds, by the parameter's name: `\*(.*?)`", PAGE, re.S)
    placed = place("drive_dead_zone", dead_zone, "voltage", params=eval(params, names))
    assert eval(by_name, names) == (placed,)


def test_the_script_makes_the_log_of_the_example(folder: Path) -> None:
    runpy.run_path("make_log.py")
    made, kept = (
        np.loadtxt(place / "log.csv", delimiter=",", skiprows=1)
        for place in (folder, ROOT / "examples" / "gimbal")
    )
    np.testing.assert_allclose(made, kept, atol=0.0011)  # a last digit


@pytest.mark.thorough
def test_commands_print_what_the_page_shows(folder: Path, run: Run) -> None:
    runpy.run_path("make_log.py")
    commands = follow(COMMANDS, run, doubted=("identify", "diagnose"))  # there is a gap
    assert {command.split()[0] for command in commands} == {
        *("explain", "simulate", "build", "validate", "figures", "check", "identify", "diagnose")
    }


def test_the_page_begins_with_the_template(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    assert follow(BEGUN, run) == ["new actuator mine.py"]
    (count,) = re.findall(r"with (\d+) effects", BEGUN)
    assert len(actuator("mine.py").plant.placements) == int(count)


def names(cell: str) -> tuple[str, ...]:
    """The names in a cell of a table."""
    return tuple(re.findall(r"`(\w+)`", cell))


def rows(first: str) -> list[list[str]]:
    """The cells of the table of the page whose first column is called so."""
    (lines,) = re.findall(rf"^\| {first} \|.*\n\|[-|]*\|\n((?:\|.*\n)*)", PAGE, re.MULTILINE)
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines.splitlines()]


def test_the_page_says_on_what_every_effect_acts() -> None:
    """As their signatures do: a new effect or another argument needs its row."""
    shown = {(names(row[0]), effect) for row in rows("acts on") for effect in names(row[-1])}
    assert shown == {
        (function.acts_on, effect)
        for effect, functions in effects().items()
        for function in functions
    }


def test_the_page_says_what_every_effect_reads() -> None:
    shown = {
        (wire, effect)
        for row in rows("reads")
        for wire in names(row[0])
        for effect in names(row[-1])
    }
    assert shown == {
        (wire.removeprefix("start_"), effect)
        for effect, functions in effects().items()
        for function in functions
        for wire in function.wires
        if wire not in (*RESERVED, *function.acts_on)
    }


def test_signals_of_other_names_are_given_as_the_page_shows() -> None:
    (call,) = re.findall(r"`(place\(\"drag\".*?\))`", PAGE)
    placed = eval(call, {"place": place, "viscous_friction": viscous_friction})
    assert placed.wire_of("shaft_speed") == "speed"
    assert placed.wire_of("full_speed") == "top_speed"


def test_the_page_says_what_the_blocks_of_a_shaft_read_and_give() -> None:
    known = {name: value for name, value in vars(shaft).items() if isinstance(value, Block)}
    del known["driven_shaft"]  # of the torque-causal form
    assert {name.strip("`") for name, _, _ in rows("block")} == set(known)
    for name, reads, gives in rows("block"):
        block = known[name.strip("`")]
        wires = {wire.removeprefix("start_") for wire in block.wires}
        assert {*names(reads)} == wires - {"dt"}, name
        assert names(gives) == block.gives, name


@pytest.mark.parametrize(("written", "instead", "message"), REFUSED)
def test_what_is_refused(folder: Path, written: str, instead: str, message: str) -> None:
    assert LISTING.count(written) >= 1
    path = folder / "gimbal.py"
    path.write_text(LISTING.replace(written, instead, 1), encoding="utf-8")
    with pytest.raises(UserError) as caught:
        actuator(str(path)).plant_of()
    assert "gimbal.py'" in str(caught.value)
    assert message in str(caught.value)
