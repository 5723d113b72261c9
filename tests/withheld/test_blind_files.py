"""Withheld cases on disk: logs are what the answers say, nothing of the truth is beside them, and
the seal breaks."""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.stop import silent
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.errors import UserError
from servo_models.withheld.generator.cases import HIDDEN, RATIO
from servo_models.withheld.generator.causes import CATALOGUE, FOREIGN
from servo_models.withheld.generator.files import generate
from servo_models.withheld.generator.rigs import RIGS
from servo_models.withheld.run import Asked, sealed_cases, unlock

pytestmark = pytest.mark.thorough

CASES, SEED = 24, 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Generated cases of all tiers, and their seal."""
    path = tmp_path_factory.mktemp("withheld") / "cases of a test"
    return path, generate(path, CASES, SEED)


def case_of(folder: Path, answer: dict[str, Any]) -> tuple[Description, Description]:
    """A case as the diagnosis reads it, and with the noise-free logs in place of its own."""
    measured = read_description(folder / "cases" / answer["case"] / "description.toml")
    truth = folder / "truth" / answer["case"] / "description.toml"
    truth.write_bytes(measured.path.read_bytes())
    try:
        return measured, read_description(truth)
    finally:
        truth.unlink()


def joined(description: Description, name: str) -> Array:
    return np.concatenate([log.outputs[name] for log in description.logs])


def simulated(description: Description, name: str, parameters: dict[str, float]) -> Array:
    """The product's response to the commands of a case."""
    chosen = model(description.actuator, description.variant, parameters)
    parts = []
    for log in description.logs:
        times = np.concatenate([[0.0], log.times + log.settle])
        inputs = {key: np.concatenate([v[:1], v]) for key, v in log.inputs.items()}
        inputs |= {key: np.full(len(times), value) for key, value in log.constants.items()}
        parts.append(simulate(chosen, times, inputs)[name][1:])
    return np.concatenate(parts)


@pytest.mark.thorough
def test_logs_are_what_the_answers_say(folder: tuple[Path, str]) -> None:
    """Noise floor and gap from the written files; without the cause, by the product."""
    kinds = set()
    for answer in unlock(*folder):
        measured, clean = case_of(folder[0], answer)
        name, kind, tier = answer["judged"], answer["kind"], answer["tier"]
        kinds.add((tier, kind))
        noise = joined(measured, name) - joined(clean, name)
        wide = math.sqrt(answer["noise"] ** 2 + answer["quantum"] ** 2 / 12.0)
        rows = len(noise) / (10.0 if tier == "hard" else 1.0)  # as many as are independent
        assert np.std(noise) == pytest.approx(wide, rel=5.0 / math.sqrt(2.0 * rows))
        colour = np.corrcoef(noise[1:], noise[:-1])[0, 1]
        assert (colour > 0.25) == (tier == "hard")
        gap = joined(clean, name) - simulated(measured, name, answer["parameters"])
        size = float(np.sqrt(np.mean(gap * gap)))
        if kind == "nothing":
            assert size < 0.05 * answer["floor"]
        elif kind != "two":
            rest = HIDDEN if tier == "hard" else 0.0
            main = answer["effects"][0]["gap"]
            assert (1.0 - rest - 0.05) * main < size < (1.0 + rest + 0.05) * main
    assert {kind for _, kind in kinds} == {"nothing", "one", "two", "foreign"}


def test_tiers_are_those_that_were_fixed(folder: tuple[Path, str]) -> None:
    for answer in unlock(*folder):
        rig = next(b for b in RIGS if b.actuator == answer["actuator"])
        description, _ = case_of(folder[0], answer)
        hard = answer["tier"] == "hard"
        for effect in answer["effects"]:
            assert RATIO[0] * 0.999 <= effect["gap"] / answer["floor"] <= RATIO[1] * 1.001
        for hidden in answer["hidden"]:
            assert hidden["gap"] / answer["effects"][0]["gap"] == pytest.approx(HIDDEN, rel=0.051)
        assert len(answer["hidden"]) == (hard and answer["kind"] in ("one", "foreign"))
        assert answer["noise"] == pytest.approx((3.0 if hard else 1.0) * answer["floor"])
        assert (answer["quantum"] > 0.0) == hard
        for log in description.logs:
            assert 10.0 * 0.98 <= log.duration / rig.slowest <= 20.0
            step = np.diff(log.times).max() / (4.0 if hard else 1.0)
            assert rig.fastest / step >= 20.0
            excursion = np.abs(log.inputs[rig.command.name] - rig.rest)
            assert excursion.max() <= rig.amplitude[1] * 1.001
            assert excursion[0] == 0.0
            sizes = np.unique(np.round(log.inputs[rig.command.name] - rig.rest, 9))
            one_step = 3 if rig.integrators else 2  # both ways, where nothing holds the rig
            assert (len(sizes) == one_step) == (answer["tier"] == "poor")
        if hard:
            codes = joined(description, answer["judged"]) / answer["quantum"]
            assert np.abs(codes - np.round(codes)).max() < 0.01


def test_the_same_seed_gives_the_same_bytes_whatever_the_number(
    folder: tuple[Path, str], tmp_path: Path
) -> None:
    few = tmp_path / "few"
    generate(few, 5, SEED)
    answers = unlock(*folder)[:5]
    assert json.loads((few / "answers.json").read_text())["cases"] == answers
    for answer in answers:
        for name, digest in answer["files"].items():
            assert hashlib.sha256((few / name).read_bytes()).hexdigest() == digest
    other = tmp_path / "other"
    assert generate(other, 2, SEED + 1) != generate(tmp_path / "third", 2, SEED)
    log = "cases/0000/description.toml"
    assert (other / "cases").is_dir()
    assert (other / log).is_file()


def test_nothing_of_the_truth_is_in_a_case(folder: tuple[Path, str]) -> None:
    """No name, no size; what a description says is the same for every case of the rig."""
    said: dict[str, set[str]] = {}
    for answer in unlock(*folder):
        here = folder[0] / "cases" / answer["case"]
        logs = {file.name for file in here.glob("*.csv")}
        assert {file.name for file in here.iterdir()} == {"description.toml", *logs}
        text = (here / "description.toml").read_text()
        names = {c.name for every in (CATALOGUE, FOREIGN) for c in every[answer["actuator"]]}
        assert not [name for name in names if name in text.replace("transport_delay.time", "")]
        secret = [v for e in answer["effects"] for v in e["parameters"].values()]
        secret += [*answer["parameters"].values(), answer["floor"], answer["noise"]]
        numbers = {float(n) for n in re.findall(r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?", text)}
        assert not numbers & {abs(value) for value in secret}
        plain = re.sub(r"load_torque = [-\de.]+", "load_torque = X", text)
        said.setdefault(answer["actuator"], set()).update(plain.splitlines())
    for lines in said.values():
        assert len(lines) < 25
    assert not list((folder[0] / "cases").rglob("*.json"))


def test_a_changed_answer_or_log_breaks_the_seal(tmp_path: Path) -> None:
    path = tmp_path / "two"
    seal = generate(path, 2, 3)
    assert len(unlock(path, seal)) == 2
    answers = path / "answers.json"
    kept = answers.read_bytes()
    answers.write_bytes(kept.replace(b'"tier": "easy"', b'"tier": "hard"'))
    with pytest.raises(UserError, match="is not what was sealed"):
        unlock(path, seal)
    answers.write_bytes(kept)
    log = next((path / "truth").rglob("*.csv"))
    log.write_bytes(log.read_bytes() + b"\n")
    with pytest.raises(UserError, match="is not what was generated"):
        unlock(path, seal)
    with pytest.raises(UserError, match="cannot be read"):
        unlock(tmp_path / "nowhere", seal)


def test_it_runs_as_a_process_of_its_own_and_prints_the_seal(tmp_path: Path) -> None:
    path = tmp_path / "by command"
    command = [sys.executable, "-m", "servo_models.withheld.generator", str(path)]
    command += ["--cases", "2", "--seed", "3", "--tiers", "hard,poor"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    answers = unlock(path, done.stdout.strip())
    assert [answer["tier"] for answer in answers] == ["hard", "poor"]
    assert done.stderr.split() == ["1/2", "2/2"]
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 2
    assert again.stderr.count("\n") == 1
    assert "exists already" in again.stderr


def test_cases_are_generated_anew_beside_folders_of_any_name(tmp_path: Path) -> None:
    kept = {tmp_path / name / "precious" for name in (".part-runs", "runs.part", ".runs.part")}
    for path in kept:
        path.parent.mkdir()
        path.write_bytes(b"kept")
    asked = Asked(cases=1, seed=5, tiers=("easy",))
    seal = sealed_cases(tmp_path / "runs", asked, silent)
    assert sealed_cases(tmp_path / "runs", asked, silent) == seal
    generate(tmp_path / "cases", 1, 5)
    assert {path.parent.name for path in kept} | {"runs", "cases"} == set(os.listdir(tmp_path))
    assert all(path.read_bytes() == b"kept" for path in kept)
