"""The way of the data, read from the imports; and what every file must be."""

from __future__ import annotations

import ast
import functools
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAYERS = (
    "errors threads interchange",
    "files sheets noise compare reference recording linear_model",
    "toml_file",
    "units block flat logs",
    "bounds",
    "inline actuator printer plants effects",
    "actuators flatten stepper compiled audit lookalikes own_actuator",
    "catalogue grey_box",
    "simulate explain",
    "fmu_src experiment tables drafting",
    "identification",
    "build parameter_set small_signals excitation",
    "linearise",
    "sine_test",
    "validation parameter_sheet description figures",
    "transfer elements diagnosis plausibility",
    "report formats figures_sheet",
    "validate pictures transfer_pictures synthesis_pictures check",
    "demonstration identify diagnose",
    "blind",
    "cli",
    "__main__ build_fmu",
)
"""From the data to the person: an import goes to a layer further up this list."""

ROOMS = (
    "codes",
    "sizes",
    "candidates fitting",
    "search clock belief repeatability preconditions",
    "detectors gap",
    "verdict",
    "claims where",
    "unseen experiments",
    "result",
    "confirm",
    "telling",
)
"""The same inside the diagnosis."""

RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names.split()}
ROOM = {name: rank for rank, names in enumerate(ROOMS) for name in names.split()}
SOURCES = sorted(
    [*ROOT.glob("servo_models/**/*.py"), *ROOT.glob("fmu_src/*.py"), ROOT / "build_fmu.py"]
)
every_source = pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))


def part(path: Path) -> str:
    """The layer's member that a file belongs to: a module of the package, or a folder."""
    steps = path.relative_to(ROOT).with_suffix("").parts
    return steps[1] if steps[0] == "servo_models" else steps[0]


@functools.cache
def imported(path: Path) -> frozenset[str]:
    """Full names of everything that a file imports, wherever in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def own_parts(path: Path) -> set[str]:
    """The members of the layers that a file imports from."""
    names = [name.split(".") for name in imported(path)]
    return {steps[1] for steps in names if steps[0] == "servo_models"} | {
        steps[0] for steps in names if steps[0] == "fmu_src"
    }


@every_source
def test_imports_go_one_way(path: Path) -> None:
    me = part(path)
    if me == "__init__":
        return  # it offers the public names, each imported when first used
    for other in own_parts(path) - {me}:
        assert other in RANK, f"say in LAYERS where '{other}' belongs"
        assert RANK[other] < RANK[me], f"{me} may not know {other}"


@pytest.mark.parametrize(
    "path",
    [it for it in SOURCES if "diagnosis" in it.parent.parts[-2:] and "report" not in it.parts],
    ids=lambda p: p.stem,
)
def test_the_rooms_of_the_diagnosis_know_those_before(path: Path) -> None:
    me = path.relative_to(ROOT / "servo_models/diagnosis").with_suffix("").parts[0]
    if me == "__init__":
        return
    names = [name.split(".") for name in imported(path)]
    others = {steps[2] for steps in names if steps[:2] == ["servo_models", "diagnosis"]} - {me}
    for other in others:
        assert ROOM[other] < ROOM[me], f"{me} may not know {other}"


@pytest.mark.parametrize("folder", ["effects", "plants"])
def test_blocks_know_nothing_but_blocks(folder: str) -> None:
    for path in ROOT.glob(f"servo_models/{folder}/*.py"):
        own = {name for name in imported(path) if name.startswith("servo_models.")}
        assert all(name.startswith("servo_models.block.") for name in own), path.name
        others = {name.split(".")[0] for name in imported(path) - own}
        assert others <= {"__future__", "math", "typing"}, path.name


def test_the_references_know_nothing_of_the_models() -> None:
    for path in ROOT.glob("servo_models/reference/*.py"):
        assert own_parts(path) <= {"reference"}, path.name


def test_the_generator_of_withheld_cases_knows_nothing_of_the_product() -> None:
    for path in ROOT.glob("servo_models/blind/generator/*.py"):
        own = {name for name in imported(path) if name.startswith("servo_models")}
        assert all(name.startswith("servo_models.blind.generator.") for name in own), path.name


def test_the_tests_know_each_other_by_one_name() -> None:
    """A bare ``pytest`` knows no ``tests.test_x``, and it would be loaded beside ``test_x``."""
    for path in ROOT.glob("tests/**/*.py"):
        assert not {name for name in imported(path) if name.startswith("tests.")}, path.name


TRAVELLERS = ("flat", "printer", "stepper")


@pytest.mark.parametrize("name", TRAVELLERS)
def test_what_travels_in_every_fmu_needs_the_standard_library_only(name: str) -> None:
    fellow = tuple(f"servo_models.{other}." for other in TRAVELLERS)
    every = imported(ROOT / "servo_models" / f"{name}.py")
    others = {n for n in every if not n.startswith(fellow)}
    assert {n.split(".")[0] for n in others} <= sys.stdlib_module_names


@every_source
def test_a_module_says_what_it_is(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)) or path.name == "__init__.py"


def test_the_repository_names_no_machine() -> None:
    """No absolute path of somebody's machine in code, tests or documents."""
    machine = re.compile(r"(?<![\w.])/(?:home|root|work|Users|mnt)/\w")
    folders = ("servo_models", "fmu_src", "tests", "docs", "benchmarks", "examples", ".ci")
    files = [p for folder in folders for p in (ROOT / folder).rglob("*") if p.is_file()]
    files += [p for p in ROOT.iterdir() if p.suffix in {".py", ".md", ".toml", ".cff"}]
    text = {".py", ".md", ".toml", ".cff", ".html", ".css", ".svg", ".csv", ""}
    for path in files:
        if path.suffix in text and "__pycache__" not in path.parts:
            found = machine.search(path.read_text(encoding="utf-8"))
            assert not found, f"{path.relative_to(ROOT)}: {found and found.group()}"
