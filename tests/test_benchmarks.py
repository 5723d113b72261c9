"""Studies and benchmarks name what is there: a rule that was renamed would end a study at once."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.sources import ROOT

NAMES = sorted(path.stem for path in ROOT.glob("benchmarks/*.py"))


@pytest.mark.thorough
def test_every_study_can_be_imported() -> None:
    code = f"import sys; sys.path[:0] = ['benchmarks', '.']; import {', '.join(NAMES)}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
