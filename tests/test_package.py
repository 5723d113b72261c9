"""The package as Python shows it: its version, its names, its help."""

from __future__ import annotations

import ast
import doctest
import importlib
import pydoc
import re
import subprocess
import sys
from fnmatch import fnmatchcase
from importlib.metadata import version

import pytest

import servo_models as sm
from fmu_src.description import FMI2
from fmu_src.native.description3 import FMI3
from tests.conftest import Run
from tests.support.sources import ROOT


def test_the_version_is_that_of_the_installed_package(run: Run) -> None:
    assert sm.__version__ == version("servo-models")
    code, out, _ = run("--version")
    assert (code, out) == (0, f"servo-models {version('servo-models')}\n")


def test_dir_lists_the_public_names() -> None:
    code = "import servo_models as sm; print(*dir(sm))"
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert {*sm.__all__, "__version__"} <= set(listed.stdout.decode().split())


def test_type_checkers_read_the_names_that_there_are() -> None:
    """The stub is what they read; every name of it is what the module has."""
    stub = ast.parse((ROOT / "servo_models/__init__.pyi").read_text("utf-8"))
    told = {
        alias.asname: getattr(importlib.import_module(str(node.module)), alias.name)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {name: getattr(sm, name) for name in sm.__all__} == told


def test_the_package_imports_nothing_heavy() -> None:
    """A name is imported when it is used, and a script that only simulates needs few of them."""
    code = "import servo_models, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    heavy = {"numpy", "scipy", "polars", "pandas", "pint"}
    heavy |= {"matplotlib", "numba", "control", "fmpy", "rich", "typer"}
    assert not heavy & set(loaded.stdout.decode().split())


def test_help_shows_an_example_and_the_functions() -> None:
    page = pydoc.plain(pydoc.render_doc(sm))
    assert ">>> " in page
    for name in ("simulate(chosen", "diagnose(", "class Model"):
        assert name in page


def test_the_example_of_help_runs() -> None:
    result = doctest.testmod(sm)
    assert result.attempted > 0
    assert result.failed == 0


def test_the_makers_of_fmus_can_be_imported_first() -> None:
    """Each of the two packages imports from the other."""
    subprocess.run([sys.executable, "-c", "import fmu_src.variables"], check=True)


def test_a_module_does_not_hide_the_function_of_its_name() -> None:
    code = (
        "import servo_models.build as module, servo_models as sm\n"
        "from servo_models.build import build\n"
        "print(sm.build is build, callable(module))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert found.stdout.decode().split() == ["True", "True"]


def test_what_indexes_show_names_every_version_of_fmi_that_is_built() -> None:
    for file, key in (("pyproject.toml", "description = "), ("CITATION.cff", "title: ")):
        lines = (ROOT / file).read_text("utf-8").splitlines()
        shown = next(line for line in lines if line.startswith(key))
        assert all(version.name in shown for version in (FMI2, FMI3))


def listed(key: str) -> list[str]:
    """The strings of a list in pyproject.toml."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    return re.findall(r'"([^"]+)"', text.split(f"\n{key} = [")[1].split("]\n")[0])


def test_the_wheel_has_two_names() -> None:
    """Any other name of ours would lie in everybody's site-packages."""
    folders = {path.name for path in ROOT.iterdir() if path.is_dir()}
    taken = {name for name in folders if any(fnmatchcase(name, it) for it in listed("include"))}
    assert taken - {"servo_models.egg-info"} == {"servo_models", "fmu_src"}


@pytest.mark.parametrize("package", ["servo_models", "fmu_src"])
def test_the_wheel_has_every_file(package: str) -> None:
    """A file that is no Python is in the wheel if a pattern of package-data takes it."""
    taken = {path for it in listed(package) for path in (ROOT / package).glob(it)}
    every = {path for path in (ROOT / package).rglob("*.*") if "__pycache__" not in path.parts}
    assert {path for path in every if path.suffix != ".py"} == taken
