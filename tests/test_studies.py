"""Studies and benchmarks name what is there: a rule that was renamed would end one at once."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from studies.__main__ import GENERATOR, named
from tests.support.sources import ROOT, imported

BENCHMARKS = sorted(f"benchmarks.{path.stem}" for path in ROOT.glob("benchmarks/*.py"))
STUDIES = [f"studies.{name}" for name in named() if name != GENERATOR]


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


def test_nothing_of_the_package_needs_them() -> None:
    """They are not in the wheel."""
    for path in [*ROOT.glob("servo_models/**/*.py"), *ROOT.glob("fmu_src/**/*.py")]:
        assert "studies" not in {name.partition(".")[0] for name in imported(path)}, path
        assert not re.search(r"[\"' ]studies\.", path.read_text(encoding="utf-8")), path


def test_the_generator_is_a_study_as_well() -> None:
    """Of the same cases as ``servo-models blind`` has: it is one program under two names."""
    asked = [sys.executable, "-m", "studies", GENERATOR, "--help"]
    done = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "--tiers" in done.stdout
