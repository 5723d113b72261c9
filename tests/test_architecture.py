"""The way of the data, read from the imports; and what every file must be."""

from __future__ import annotations

import ast
import functools
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FLOORS = (
    "errors files units",
    "report",
    "core",
    "effects",
    "actuators",
    "analysis",
    "fmu_src",
    "build",
    "data",
    "identification validation",
    "diagnosis",
    "withheld",
    "cli",
    "__main__ build_fmu",
)
"""From the data to the person: an import goes to a floor further up this list."""
MOST_ROOT_MODULES, MOST_FOLDERS, MOST_MODULES = 6, 12, 18
CROWDED = {"effects"}
"""Folders of as many modules as there are things of their kind."""

FLOOR = {name: floor for floor, names in enumerate(FLOORS) for name in names.split()}
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
        return  # it offers the public names
    for other in own_parts(path) - {me}:
        beside = {me, other} <= {"files", "units"}  # which report their faults by each other
        assert FLOOR[other] < FLOOR[me] or beside or other == "errors", f"{me} knows {other}"


def test_the_plan_has_few_rooms() -> None:
    package = ROOT / "servo_models"
    assert len(list(package.glob("*.py"))) <= MOST_ROOT_MODULES
    folders = [path.parent for path in package.rglob("__init__.py") if path.parent != package]
    assert len([folder for folder in folders if folder.parent == package]) <= MOST_FOLDERS
    for folder in folders:
        modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
        assert len(modules) <= MOST_MODULES or folder.name in CROWDED, folder.name


@every_source
def test_private_names_stay_in_their_folder(path: Path) -> None:
    for name in imported(path):
        folder, _, last = name.rpartition(".")
        private = last.startswith("_") and not last.startswith("__")
        assert not (private and folder.startswith("servo_models.")), name


BLOCKS = [
    path
    for path in [
        *ROOT.glob("servo_models/effects/*.py"),
        *ROOT.glob("servo_models/actuators/*/physics.py"),
        ROOT / "servo_models/actuators/shaft.py",
    ]
    if path.name != "__init__.py"
]


@pytest.mark.parametrize("path", BLOCKS, ids=lambda p: str(p.relative_to(ROOT)))
def test_blocks_know_nothing_but_blocks(path: Path) -> None:
    own = {name for name in imported(path) if name.startswith("servo_models.")}
    assert all(name.startswith("servo_models.core.block.") for name in own)
    others = {name.split(".")[0] for name in imported(path) - own}
    assert others <= {"__future__", "math", "typing"}


REFERENCES = [
    ROOT / "servo_models/validation/solvers.py",
    *ROOT.glob("servo_models/validation/*/*reference.py"),
]


@pytest.mark.parametrize("path", REFERENCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_the_references_know_nothing_of_the_models(path: Path) -> None:
    fellows = {".".join(p.relative_to(ROOT).with_suffix("").parts) for p in REFERENCES}
    fellows |= {"servo_models.core.types"}
    own = {name for name in imported(path) if name.startswith("servo_models")}
    assert all({name, name.rpartition(".")[0]} & fellows for name in own)


def test_the_generator_of_withheld_cases_knows_nothing_of_the_product() -> None:
    for path in ROOT.glob("servo_models/withheld/generator/*.py"):
        own = {name for name in imported(path) if name.startswith("servo_models")}
        assert all(name.startswith("servo_models.withheld.generator.") for name in own), path.name


ACTUATORS = {path.parent.name for path in ROOT.glob("servo_models/actuators/*/__init__.py")}


@every_source
def test_an_actuator_is_named_in_its_own_folders_only(path: Path) -> None:
    """Adding one is adding folders; the generator of withheld cases has rigs of its own."""
    if path.parent.name in ACTUATORS or path.parent.name == "generator":
        return
    texts = {
        node.value
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert not texts & ACTUATORS
    assert not ACTUATORS & {step for name in imported(path) for step in name.split(".")}


def test_the_tests_know_each_other_by_one_name() -> None:
    """A bare ``pytest`` knows no ``tests.test_x``, and it would be loaded beside ``test_x``."""
    for path in ROOT.glob("tests/**/*.py"):
        assert not {name for name in imported(path) if name.startswith("tests.")}, path.name


TRAVELLERS = ("flat", "printer", "stepper")


@pytest.mark.parametrize("name", TRAVELLERS)
def test_what_travels_in_every_fmu_needs_the_standard_library_only(name: str) -> None:
    fellow = tuple(f"servo_models.core.{other}." for other in TRAVELLERS)
    every = imported(ROOT / "servo_models" / "core" / f"{name}.py")
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
