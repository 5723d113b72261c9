"""The GitHub action and the pre-commit hooks, in a repository made for them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from servo_models.build import build
from servo_models.catalogue import model
from tests.support.own_actuators import write
from tests.support.sources import ROOT

TIME_CONSTANT = 0.2  # of the joint that follows its goal, in s; its goal begins at 1 rad

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="the steps are for bash")


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU, the exact response to a step of its goal, and one that is 2 % too large."""
    folder = tmp_path_factory.mktemp("repository")
    chosen = model(str(write(tmp_path_factory.mktemp("actuator"), TIME_CONSTANT)))
    build(chosen, folder / "joint.fmu")
    (folder / "damaged.fmu").write_bytes((folder / "joint.fmu").read_bytes()[:4000])
    times = np.linspace(0.0, 1.0, 101)
    for name, gain in (("right.csv", 1.0), ("wrong.csv", 1.02)):
        angles = gain * (1.0 - np.exp(-times / TIME_CONSTANT))
        rows = [f"{time:.17g},{angle:.17g}" for time, angle in zip(times, angles)]
        (folder / name).write_text("\n".join(["time,angle", *rows, ""]))
    return folder


def run_action(repository: Path, work: Path, **given: str) -> tuple[int, str, str]:
    """Run the last step of the action as GitHub does: exit code, output, summary."""
    action: dict[str, Any] = yaml.safe_load((ROOT / "action.yml").read_text())
    values = {name: about.get("default", "") for name, about in action["inputs"].items()}
    values |= {name.replace("_", "-"): value for name, value in given.items()}
    step = action["runs"]["steps"][-1]
    inputs = re.compile(r"\$\{\{ inputs\.([\w-]+) \}\}")
    own = {name: inputs.sub(lambda it: values[it[1]], it) for name, it in step["env"].items()}
    installed = work / "servo-models" / "bin" / "servo-models"
    installed.parent.mkdir(parents=True)
    installed.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m servo_models "$@"\n')
    installed.chmod(0o755)
    summary = work / "summary.md"
    environment = {**os.environ, "RUNNER_TEMP": str(work), "GITHUB_STEP_SUMMARY": str(summary)}
    done = subprocess.run(
        ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]],
        cwd=repository,
        env={**environment, **own},
        capture_output=True,
        text=True,
        check=False,
    )
    told = summary.read_text() if summary.exists() else ""
    return done.returncode, done.stdout + done.stderr, told


@pytest.mark.thorough
def test_the_action_passes_what_equals_its_reference(repository: Path, tmp_path: Path) -> None:
    junit = tmp_path / "junit.xml"
    code, out, summary = run_action(
        repository, tmp_path, fmu="joint.fmu", reference="right.csv", junit=str(junit)
    )
    assert code == 0, out
    assert "::error" not in out
    assert "PASSED" in summary
    assert 'failures="0"' in junit.read_text()


@pytest.mark.thorough
def test_the_action_fails_what_does_not(repository: Path, tmp_path: Path) -> None:
    code, out, summary = run_action(repository, tmp_path, fmu="joint.fmu", reference="wrong.csv")
    assert code == 1
    (line,) = [line for line in out.splitlines() if line.startswith("::error")]
    assert "angle" in line
    assert "FAILED" in summary


@pytest.mark.thorough
def test_the_action_takes_patterns_and_runs_nothing_if_told(
    repository: Path, tmp_path: Path
) -> None:
    code, out, _ = run_action(repository, tmp_path / "one", fmu="jo*.fmu", static_only="true")
    assert code == 0, out
    code, out, _ = run_action(repository, tmp_path / "all", fmu="*.fmu", static_only="true")
    assert code != 0
    assert "damaged.fmu" in out


HOOKS = {it["id"]: it for it in yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())}


def run_hook(repository: Path, name: str, fmu: str) -> tuple[int, str]:
    """Run a hook on the file that pre-commit gives it."""
    hook = HOOKS[name]
    assert re.search(hook["files"], fmu)
    assert not re.search(hook["files"], f"{fmu}.txt")
    command, *words = hook["entry"].split()
    assert command == "servo-models"
    done = subprocess.run(
        [sys.executable, "-m", "servo_models", *words, fmu],
        cwd=repository,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.thorough
def test_the_hook_that_runs_nothing(repository: Path) -> None:
    assert run_hook(repository, "validate-fmu-static", "joint.fmu")[0] == 0
    code, told = run_hook(repository, "validate-fmu-static", "damaged.fmu")
    assert code != 0
    assert "damaged.fmu" in told


def test_the_hook_that_compares_says_where_a_reference_is_missing(repository: Path) -> None:
    code, told = run_hook(repository, "validate-fmu", "joint.fmu")
    assert code == 2
    assert "reference" in told
