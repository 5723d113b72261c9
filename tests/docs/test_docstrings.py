"""Every public function shows how it is called, and the call does what it shows."""

from __future__ import annotations

import doctest
import inspect
import shutil
from pathlib import Path
from typing import Any

import pytest

import servo_models as sm
from tests.support.document import ROOT

FUNCTIONS = [name for name in sm.__all__ if inspect.isfunction(getattr(sm, name))]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with the gimbal and its log, as the examples have it."""
    for file in (ROOT / "examples" / "gimbal").iterdir():
        if file.is_file():
            shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)


def results(thing: Any, name: str) -> doctest.TestResults:
    (found,) = doctest.DocTestFinder(recurse=False).find(thing, name, globs={})
    return doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(found)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_example_of_a_function(name: str) -> None:
    found = results(getattr(sm, name), name)
    assert found.attempted > 0
    assert found.failed == 0


def test_the_example_of_the_package() -> None:
    found = results(sm, "servo_models")
    assert found.attempted > 0
    assert found.failed == 0
