"""The notebooks run in an empty folder, one after the other in one process, and find the truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tests.support.document import ROOT

NOTEBOOKS = ROOT / "docs" / "notebooks"

pytestmark = pytest.mark.thorough


@pytest.fixture
def follow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs the cells of a notebook as plain Python, and returns the names they leave."""
    plt.switch_backend("agg")
    monkeypatch.chdir(tmp_path)

    def run(name: str) -> dict[str, Any]:
        cells = json.loads((NOTEBOOKS / f"{name}.ipynb").read_text("utf-8"))["cells"]
        names: dict[str, Any] = {}
        for cell in cells:
            if cell["cell_type"] == "code":
                assert not cell["outputs"]  # what is not saved cannot be out of date
                exec("".join(cell["source"]), names)
        plt.close("all")
        return names

    return run


def test_the_csv_ends_in_a_model_with_the_true_play(follow: Any, tmp_path: Path) -> None:
    names = follow("csv_to_gap")
    (play,) = (it for it in names["result"].found if it.name == "backlash.half_width")
    assert abs(play.value - np.radians(0.8)) < 4.0 * play.standard_error
    assert play.standard_error < 0.1 * play.value
    assert names["left"]["after"] == pytest.approx(0.05, rel=0.15)  # the noise, of 600 samples
    assert (tmp_path / "servo.fmu").exists()


def test_an_fmu_in_a_loop_is_the_model(follow: Any) -> None:
    names = follow("fmu_in_a_loop")
    assert names["largest"] < 1e-12
    counts = 4096.0 / (2.0 * np.pi)
    stiffness = 400.0 * counts / (256.0 * 885.0) * 0.52  # N m/rad: gain, firmware, stall torque
    rest = -0.4 - names["loads"][-1] / stiffness  # goal, and what the weight takes off
    assert names["angles"][-1] == pytest.approx(rest, abs=0.02 / stiffness + 1.0 / counts)


def test_a_joint_keeps_its_friction_on_the_way_to_mujoco(follow: Any) -> None:
    names = follow("so101_joint")
    fields = names["exported"].values
    assert fields["frictionloss"] == pytest.approx(0.12, rel=0.1)  # N m, of the truth
    assert names["exported"].servo.inertia == pytest.approx(0.035, rel=0.02)


def test_the_papers_figures_are_met(follow: Any) -> None:
    names = follow("papers_figures")
    assert names["apart_7"] < np.radians(1e-6)
    assert names["apart_12"] < np.radians(1e-4)
    assert names["apart_at"] < 1e-9
    assert names["overshoot"][0.18] == pytest.approx(0.0484, abs=5e-4)
    assert names["constants"] == pytest.approx({0.18: 2.6, 0.1: 4.6}, abs=0.05)
    for name, printed in names["table_2"].items():
        assert names["computed"][name] == pytest.approx(printed, rel=0.011)
