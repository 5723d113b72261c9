"""Studies and benchmarks name what is there: a rule that was renamed would end one at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

from studies.__main__ import named
from tests.support.sources import ROOT, imported

BENCHMARKS = sorted(f"benchmarks.{path.stem}" for path in ROOT.glob("benchmarks/*.py"))
STUDIES = [f"studies.{name}" for name in named()]


@pytest.mark.thorough
def test_every_study_can_be_imported() -> None:
    code = f"import {', '.join([*STUDIES, *BENCHMARKS])}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_studies_are_listed_each_with_what_it_does() -> None:
    assert {"golden", "ablation", "withheld.generator", "second_plant"} <= named().keys()
    assert all(len(what) > 10 for what in named().values())


def test_nothing_of_the_package_needs_them_but_the_withheld_check() -> None:
    users = [
        path.name
        for path in ROOT.glob("servo_models/**/*.py")
        if any(name.partition(".")[0] == "studies" for name in imported(path))
    ]
    assert users == ["blind.py"]
