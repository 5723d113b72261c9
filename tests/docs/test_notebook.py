"""The notebook runs from its first cell to its last, and closes the gap down to the noise."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.document import ROOT, alike

nbclient = pytest.importorskip("nbclient", reason="the notebook needs the extra 'test'")
nbformat = pytest.importorskip("nbformat")
pytest.importorskip("ipykernel", reason="the notebook needs the extra 'test'")

NOISE = 0.05  # deg, of make_log.py
SAMPLES = 400


def texts(notebook: Any) -> list[str]:
    """What the cells print and show, line by line."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    shown = [output.get("text") or output["data"]["text/plain"] for output in outputs]
    return [line for text in shown for line in text.splitlines()]


@pytest.mark.thorough
def test_the_notebook_closes_the_gap(tmp_path: Path) -> None:
    folder = shutil.copytree(ROOT / "examples" / "gimbal", tmp_path / "gimbal")
    saved, notebook = (nbformat.read(folder / "gap.ipynb", as_version=4) for _ in range(2))
    nbclient.NotebookClient(
        notebook, timeout=120, resources={"metadata": {"path": str(folder)}}
    ).execute()
    lines = texts(notebook)
    (after,) = re.findall(r"after: (.*) deg RMS", "\n".join(lines))
    spread = NOISE / np.sqrt(2.0 * SAMPLES)
    assert float(after) == pytest.approx(NOISE, abs=4.0 * spread)
    assert any(line.startswith("<Diagnosis of gimbal: effect, drive_dead_zone") for line in lines)
    assert (folder / "fmus" / "gimbal.fmu").exists()
    for line, kept in zip(lines, texts(saved), strict=True):
        assert alike(kept, line)  # what is saved in it is what it computes
