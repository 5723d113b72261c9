"""docs/own_effect.md as it stands: an effect that no table knows, found by its own hints."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest

import servo_models as sm
from servo_models.analysis.isolability import cause, experiment
from servo_models.diagnosis.search.candidates import candidates
from servo_models.identification.live import explored
from tests.conftest import Run

DOCUMENT = Path(__file__).parents[2] / "docs" / "own_effect.md"
STEP = 0.06  # [rad/s], that the document's rig has


def listings() -> tuple[str, str, str]:
    """The actuator's file, the description, and the script that makes a log."""
    text = DOCUMENT.read_text(encoding="utf-8")
    actuator, script, *_ = re.findall(r"```python\n(.*?)```", text, re.S)
    (description,) = re.findall(r"```toml\n(.*?)```", text, re.S)
    return actuator, description, script


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files of the document, in which its script runs."""
    actuator, description, _ = listings()
    (tmp_path / "joint.py").write_text(actuator)
    (tmp_path / "rig.toml").write_text(description)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_script(capsys: pytest.CaptureFixture[str]) -> str:
    exec(compile(listings()[2], str(DOCUMENT), "exec"), {})
    return capsys.readouterr().out.strip()


def test_the_document_runs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed = run_script(capsys)
    assert printed == f"{STEP:.4f} rad/s"
    assert f"It prints `{printed}`" in DOCUMENT.read_text(encoding="utf-8")


def test_without_its_hint_slopes_do_not_lead_there(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "joint.py"
    plain = re.sub(r" +grid=Grid.*\n", "", path.read_text())
    assert plain != path.read_text()
    path.write_text(plain)
    found = float(run_script(capsys).split()[0])
    assert abs(found / STEP - 1.0) > 0.01


def test_its_hints_are_its_own(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The grid has the ends and the spacing that its file declares; 5 rad/s is full scale."""
    run_script(capsys)
    told = sm.read_description("rig.toml")
    every = {it.name: it for it in candidates(told.model, told.logs)}
    values = [next(iter(it.values())) for it in every["speed_steps"].grid]
    typical = 0.02 * 5.0
    assert values[0] == pytest.approx(20.0 * typical)
    assert values[-1] == pytest.approx(0.1 * typical, rel=0.01)
    assert min(1.0 - b / a for a, b in pairwise(values)) == pytest.approx(0.002)
    assert every["transport_delay"].grid == ()


def test_what_separates_it_is_its_own(folder: Path) -> None:
    plant = sm.actuator("joint.py").plant
    causes = [cause(name, plant) for name in ("speed_steps", "time_constant")]
    assert causes == ["speed_steps", "lag"]
    assert experiment(*causes, plant).startswith("a very slow ramp")
    assert experiment(*causes[::-1], plant) == experiment(*causes, plant)


def test_pages_and_fmus_have_it(folder: Path, run: Run) -> None:
    """An effect that the catalogue does not know is on a page, and in an FMU's documentation."""
    page = folder / "joint.html"
    assert run("explain", "joint.py", "--page", page)[0] == 0
    assert run("explore", "joint.py", "--no-show", "--out", page)[0] == 0
    assert run("build", "joint.py", "--out", folder)[0] == 0
    (panel,) = explored("joint.py").panels
    assert panel.models[0].effects["speed_steps"]


def test_without_a_typical_size_it_is_found_all_the_same(folder: Path) -> None:
    """From 0 a search would find nothing, and the diagnosis would say that nothing acts there."""
    path = folder / "joint.py"
    path.write_text(path.read_text().replace(", typical=0.02", ""))
    plant = sm.actuator("joint.py").plant
    assert plant.parameters["speed_steps.step"].param.typical == pytest.approx(0.1 * 0.5 * 5.0)
