"""Tutorials and pitfalls are followed from an empty folder, by what they say and in their order."""

from pathlib import Path

import pytest

from tests.conftest import Run
from tests.support.document import ROOT, work_through


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("tutorials/csv_to_gap", marks=pytest.mark.thorough),
        pytest.param("tutorials/fmus_in_a_host", marks=pytest.mark.thorough),
        pytest.param("tutorials/all_joints", marks=pytest.mark.long),
        pytest.param("pitfalls", marks=pytest.mark.long),
    ],
)
def test_a_page_to_follow(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    if "in_libcosim.py" in text:
        pytest.importorskip("libcosimpy", reason="the second host is libcosim")
    monkeypatch.chdir(tmp_path)
    work_through(text, tmp_path, run)
