"""The package as Python shows it: its version, its names, its help."""

from __future__ import annotations

import doctest
import pydoc
import subprocess
import sys
from importlib.metadata import version

from conftest import Run

import servo_models as sm


def test_the_version_is_that_of_the_installed_package(run: Run) -> None:
    assert sm.__version__ == version("servo-models")
    code, out, _ = run("--version")
    assert (code, out) == (0, f"servo-models {version('servo-models')}\n")


def test_dir_lists_the_public_names_before_any_is_used() -> None:
    code = "import servo_models as sm; print(*(name for name in dir(sm) if name[0] != '_'))"
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert listed.stdout.decode().split() == sorted(sm.__all__)


def test_help_shows_an_example_and_the_functions() -> None:
    page = pydoc.plain(pydoc.render_doc(sm))
    assert ">>> " in page
    for name in ("simulate(chosen", "diagnose(", "class Model"):
        assert name in page


def test_the_example_of_help_runs() -> None:
    result = doctest.testmod(sm)
    assert result.attempted > 0
    assert result.failed == 0
