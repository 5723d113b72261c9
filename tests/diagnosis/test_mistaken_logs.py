"""A log that is not what was measured is told first, and no cause is sure."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

from tests.conftest import Run

GIMBAL = Path(__file__).parents[2] / "examples" / "gimbal"


def test_a_clipped_reading_is_told_first(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "gimbal"
    shutil.copytree(GIMBAL, folder)
    header, *rows = (folder / "log.csv").read_text("utf-8").splitlines()
    table = np.array([row.split(",") for row in rows], dtype=float)
    angle = table[:, header.split(",").index("angle_deg")]
    angle[:] = np.clip(angle, *np.quantile(angle, [0.2, 0.8]))
    np.savetxt(folder / "log.csv", table, "%.6g", ",", header=header, comments="")
    path = folder / "gimbal.toml"
    code, out, _ = run("diagnose", path, "--format", "json")
    assert code == 1
    found = json.loads(out)
    assert found["sentence"].startswith("Correct log 'log': 'reading' is clipped")
    assert all(effect["probability"] is None for effect in found["effects"])
    assert "explains" not in found["sentence"].partition(":")[2].partition(";")[0]
