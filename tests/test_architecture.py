"""The way of the data, read from the imports; and what every file must be."""

from __future__ import annotations

import ast
import re
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.support.sources import ROOT, by_string, imported

FLOORS = (
    "errors files units",
    "report",
    "core",
    "effects fmu",
    "actuators",
    "foreign",
    "catalogue",
    "analysis",
    "fmu_src",
    "build",
    "data",
    "identification validation",
    "diagnosis simulators",
    "survey",
    "withheld",
    "cli",
    "__main__ build_fmu",
)
"""From the data to the person: an import goes to a floor further up this list."""
MOST_ROOT_MODULES, MOST_FOLDERS, MOST_MODULES = 7, 15, 19
LONGEST_CHAIN = 10
LONGEST_CHAIN_OF_FILES = 35
CROWDED = {"effects", "cli"}  # folders of as many modules as there are things of their kind

OLD = {"actuator", "block"}  # modules of version 0.2, which ``own_actuator.py`` still offers
FLOOR = {name: floor for floor, names in enumerate(FLOORS) for name in names.split()}
SOURCES = sorted(
    {*ROOT.glob("servo_models/**/*.py"), *ROOT.glob("fmu_src/**/*.py"), ROOT / "build_fmu.py"}
)


FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in SOURCES
    if path != ROOT / "servo_models/__init__.py"
}
"""By the names under which they are imported."""


def part(path: Path) -> str:
    """The layer's member that a file belongs to: a module of the package, or a folder."""
    steps = path.relative_to(ROOT).with_suffix("").parts
    return steps[1] if steps[0] == "servo_models" else steps[0]


def own_parts(path: Path) -> set[str]:
    """The members of the layers that a file imports from."""
    names = [name.split(".") for name in imported(path)]
    own = {steps[1] for steps in names if steps[0] == "servo_models"} - OLD
    return own | {steps[0] for steps in names if steps[0] == "fmu_src"}


def test_imports_go_one_way() -> None:
    for path in SOURCES:
        me = part(path)
        if me == "__init__":
            continue  # it offers the public names
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


def own_imports(path: Path, inside: bool = False) -> set[str]:
    """Modules of the package that a file imports; with ``inside`` only those within a function."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    places: list[ast.AST] = [tree]
    if inside:
        places = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    found = set()
    for node in (node for place in places for node in ast.walk(place)):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = (f"{node.module}.{name.name}" for name in node.names)
            found |= {name if name in FILES else node.module for name in names}
        elif isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        found |= by_string(node)
    return found & FILES.keys()


def test_no_two_files_import_each_other() -> None:
    """Neither directly nor over others, imports for types included."""
    graph = {name: own_imports(path) - {name} for name, path in FILES.items()}
    order = [*TopologicalSorter(graph).static_order()]  # raises CycleError with the circle
    length: dict[str, int] = {}
    for name in order:
        length[name] = 1 + max((length[other] for other in graph[name]), default=0)
    assert max(length.values()) <= LONGEST_CHAIN_OF_FILES


def test_an_import_by_string_is_seen() -> None:
    """One tied a circle that no other test saw."""
    for text, found in (
        ("import_module('servo_models.foreign').load(path)", {"servo_models.foreign"}),
        ("import_module(name=f'servo_models.{folder}')", {"servo_models."}),
        ("LATE = 'servo_models.data.example'", {"servo_models.data.example"}),
        ("python('from servo_models.fmu.child import serve; serve()')", {"servo_models.fmu.child"}),
        ("said = 'pip install servo_models, then see servo_models.data'", set()),
    ):
        assert set().union(*map(by_string, ast.walk(ast.parse(text)))) == found
    for path in SOURCES:
        computed = {name for name in imported(path) if name.endswith(".")}
        assert not computed, f"{path}: a module whose name is computed ties any circle"


def test_own_modules_are_imported_at_the_top() -> None:
    """But for commands, which load what they need, and the package, whose names are lazy."""
    for path in SOURCES:
        if part(path) not in {"cli", "__init__", "build_fmu"}:
            assert not own_imports(path, inside=True), path


def test_the_chain_of_folders_is_short() -> None:
    """From the one that imports no other to the one that nobody imports."""
    folders = {path.parent.name for path in ROOT.glob("servo_models/*/__init__.py")} | {"fmu_src"}
    length: dict[str, int] = {}
    for folder in sorted(folders, key=FLOOR.__getitem__):
        known = set().union(*(own_parts(path) for path in SOURCES if part(path) == folder))
        length[folder] = 1 + max((length[other] for other in known & length.keys()), default=0)
    assert max(length.values()) <= LONGEST_CHAIN, length


LEAST_LINES = 25
THIN = {"effects", "cli"}
"""Folders of an effect or a sub-command a file, which may be as short as that is."""
THIN_FILES = {"__init__.py", "__main__.py", "errors.py", "types.py"}


def test_no_module_is_shallow() -> None:
    for path in SOURCES:
        if path.parent.name not in THIN and path.name not in THIN_FILES:
            lines = path.read_text(encoding="utf-8").count("\n")
            assert lines >= LEAST_LINES, f"{path}: {lines} lines; merge it into its neighbour"


def test_private_names_stay_in_their_folder() -> None:
    for path in SOURCES:
        for name in imported(path):
            folder, _, last = name.rpartition(".")
            private = last.startswith("_") and not last.startswith("__")
            assert not (private and folder.startswith("servo_models.")), (path, name)


BLOCKS = [
    path
    for path in [
        *ROOT.glob("servo_models/effects/*.py"),
        *ROOT.glob("servo_models/actuators/*/physics.py"),
        ROOT / "servo_models/actuators/shaft.py",
    ]
    if path.name != "__init__.py"
]


def test_blocks_know_nothing_but_blocks() -> None:
    for path in BLOCKS:
        own = {name for name in imported(path) if name.startswith("servo_models.")}
        assert all(name.startswith("servo_models.core.block.") for name in own), path
        others = {name.split(".")[0] for name in imported(path) - own}
        assert others <= {"__future__", "math", "typing"}, path


REFERENCES = [
    ROOT / "servo_models/validation/solvers.py",
    *ROOT.glob("servo_models/validation/*/*reference.py"),
]


def test_the_references_know_nothing_of_the_models() -> None:
    for path in REFERENCES:
        fellows = {".".join(p.relative_to(ROOT).with_suffix("").parts) for p in REFERENCES}
        fellows |= {"servo_models.core.types"}
        own = {name for name in imported(path) if name.startswith("servo_models")}
        assert all({name, name.rpartition(".")[0]} & fellows for name in own), path


GENERATOR = ("servo_models/withheld/generator", "servo_models/withheld/rig")


def test_the_generator_of_withheld_cases_knows_nothing_of_the_product() -> None:
    for folder in GENERATOR:
        for path in (ROOT / folder).glob("*.py"):
            own = {name for name in imported(path) if name.startswith(("servo_models", "studies"))}
            allowed = tuple(f"{known.replace('/', '.')}." for known in GENERATOR)
            assert all(f"{name}.".startswith(allowed) for name in own), path


ACTUATORS = {path.parent.name for path in ROOT.glob("servo_models/actuators/*/__init__.py")}
ABOUT_ONE = {"elements", "generator"}
"""Folders about certain actuators: the elements of the SG90's loop, the rigs of withheld cases."""


def test_an_actuator_is_named_in_its_own_folders_only() -> None:
    """Adding one is adding folders."""
    for path in SOURCES:
        if path.parent.name in ACTUATORS | ABOUT_ONE:
            continue
        texts = {
            node.value
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        }
        steps = {step for name in imported(path) for step in name.split(".")}
        assert not ACTUATORS & (texts | steps), path


def test_the_tests_know_each_other_by_one_name() -> None:
    """A helper that is imported as ``fmu_host`` and as ``tests.support.fmu_host`` exists twice."""
    paths = sorted(ROOT.glob("tests/**/*.py"))
    own = {path.stem for path in paths if path.stem != "__init__"}
    for path in paths:
        assert not {name for name in imported(path) if name.split(".")[0] in own}, path.name


def test_no_test_imports_another() -> None:
    for path in ROOT.glob("tests/**/*.py"):
        others = [name for name in imported(path) if re.match(r"tests\.(\w+\.)?test_", name)]
        assert not others, (path, others)


EFFECTS = {
    node.name
    for path in ROOT.glob("servo_models/effects/[!_]*.py")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if isinstance(node, ast.FunctionDef)
} | {path.stem for path in ROOT.glob("servo_models/effects/[!_]*.py")}
THEIR_OWN = ("effects", "actuators", "validation", "foreign/border", "simulators", "withheld")
"""Folders that may name effects: who defines and places them, who writes an actuator's truth down a
second time, on purpose, who says what another simulator holds of them, and whose cases
have them."""
OTHER_THINGS = {
    "offset": "a key of a log",
    "lag": "a column of a table",
    "curve": "a part of a residual map",
    "residual_map": "a key of a diagnosis",
}
"""Words that are more than the name of an effect."""
NAMED = {
    "diagnosis/residual_map.py": "it learns the one effect that has any form",
    "data/mistakes.py": "a mistake knows which effects imitate it",
    "identification/plausibility.py": "a mistake knows which effects imitate it",
    "identification/elements/motor.py": "the table of a hysteresis loop is one of the elements",
}
"""Modules that name an effect, and why."""


def test_an_effect_is_known_by_name_where_it_is_defined_or_placed() -> None:
    """What is known of an effect stands in its file; other modules read it there."""
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix().removeprefix("servo_models/")
        if name.startswith(THEIR_OWN) or name in NAMED:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                word, dot, _ = node.value.partition(".")
                known = word in EFFECTS and (dot or word not in OTHER_THINGS)
                assert not known, f"{name}, line {node.lineno}: '{node.value}'"
        known = {it for it in imported(path) if it.startswith("servo_models.effects.")}
        assert known <= {f"servo_models.effects.{it}" for it in ("effects", "effects_on")}, path


TRAVELLERS = ("flat", "printer", "stepper")


@pytest.mark.parametrize("name", TRAVELLERS)
def test_what_travels_in_every_fmu_needs_the_standard_library_only(name: str) -> None:
    fellow = tuple(f"servo_models.core.{other}." for other in TRAVELLERS)
    every = imported(ROOT / "servo_models" / "core" / f"{name}.py")
    others = {n for n in every if not n.startswith(fellow)}
    assert {n.split(".")[0] for n in others} <= sys.stdlib_module_names


def test_a_module_says_what_it_is() -> None:
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text)) or path.name == "__init__.py", path


def test_the_repository_names_no_machine() -> None:
    """No absolute path of somebody's machine in code, tests or documents."""
    machine = re.compile(r"(?<![\w.])/(?:home|root|work|Users|mnt)/\w")
    folders = (
        "servo_models",
        "fmu_src",
        "tests",
        "docs",
        "benchmarks",
        "studies",
        "examples",
        ".ci",
    )
    files = [p for folder in folders for p in (ROOT / folder).rglob("*") if p.is_file()]
    files += [p for p in ROOT.iterdir() if p.suffix in {".py", ".md", ".toml", ".cff"}]
    text = {".py", ".md", ".toml", ".cff", ".html", ".css", ".svg", ".csv", ""}
    for path in files:
        if path.suffix in text and "__pycache__" not in path.parts:
            found = machine.search(path.read_text(encoding="utf-8"))
            assert not found, f"{path.relative_to(ROOT)}: {found and found.group()}"
