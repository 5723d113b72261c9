"""Sentences that readers did not understand, which do not come back."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TEXTS = [
    *ROOT.glob("servo_models/**/*.py"),
    *ROOT.glob("docs/*.md"),
    *ROOT.glob("*.md"),
    *ROOT.glob("*.py"),
]


@pytest.mark.parametrize(
    "phrase",
    [
        "the response hunts",
        "goes with the input coherently",
        "nobody could tell apart",
        "the fit has seen all",
        "Told are",
        "is told from each of the others",
        "there is nothing to tell apart",
        "pass for free parameters",
        "move nothing measured",
        "which comes from",
        "passes for noise",
        "invent effects",
        "has it sought",
    ],
)
def test_a_phrase_that_nobody_understood_is_gone(phrase: str) -> None:
    for path in TEXTS:
        text = path.read_text(encoding="utf-8").replace('"', " ")  # a sentence over several lines
        assert phrase not in " ".join(text.split()), path
