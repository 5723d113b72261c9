"""Tables of next experiments that ``diagnose`` writes: ready to play, and kept once filled."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.data.tables import read_signals
from servo_models.diagnosis import design
from tests.conftest import Run
from tests.support.delayed_motor import describe
from tests.support.schemas import check_schema

VOLTAGE = model("torque_motor").plant.wire["voltage"]
Diagnosed = Callable[..., tuple[str, list[dict[str, Any]]]]


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    """A description in a folder of its own."""
    folder = tmp_path / "rig"
    folder.mkdir()
    return describe(folder, seconds=0.1)


def planned(description: Path) -> design.Experiment:
    """A sine to play."""
    (log,) = read_description(description).logs
    times = np.linspace(0.0, 0.3, 61)
    plan = replace(log, times=times, inputs={"voltage": 5.0 * np.sin(20.0 * times)})
    names = ("transport_delay",), ("sensor_lag",)
    apart = 7.0 * (1.0 - np.eye(2))
    return design.Experiment(
        names,
        np.array([0.6, 0.4]),
        apart,
        apart > 1.0,
        imitated=(),
        decides=0.99,
        seconds=1.0,
        steps=("Play a sine.",),
        wire=VOLTAGE,
        plans=(plan, replace(plan, constants={"load_torque": 0.01, "constant_load.torque": 0.0})),
        floors={"angle": 1e-4},
    )


@pytest.fixture
def diagnosed(rig: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> Diagnosed:
    """Diagnose with so many sines as the next experiments: what is printed and what is told."""

    def command(count: int = 1) -> tuple[str, list[dict[str, Any]]]:
        sines = (planned(rig),) * count
        monkeypatch.setattr(design, "next_experiments", lambda *_: sines)
        _, out, _ = run("diagnose", rig, "--json", rig.parent / "d.json")
        document = json.loads((rig.parent / "d.json").read_text())
        check_schema(document)
        return out, document["next_experiments"]

    return command


@pytest.mark.thorough
def test_the_next_experiment_is_told_and_can_be_played(diagnosed: Diagnosed, rig: Path) -> None:
    out, (told,) = diagnosed()
    told_ = "Play a sine. The command is rig_next_1.csv; rig_next_1.py plays it."
    assert told_ in " ".join(out.split())
    played, signals = read_signals(rig.parent / told["file"], [VOLTAGE])
    assert np.array_equal(played, planned(rig).times)
    assert np.array_equal(signals["voltage"], planned(rig).command)


@pytest.mark.thorough
def test_a_table_that_is_a_log_by_now_is_not_written_over(diagnosed: Diagnosed, rig: Path) -> None:
    log = (rig.parent / "log.csv").rename(rig.parent / "rig_next_1.csv")
    rig.write_text(rig.read_text().replace("log.csv", log.name))
    before = log.read_bytes()
    _, told = diagnosed(2)
    assert [one["file"] for one in told] == ["rig_next_2.csv", "rig_next_3.csv"]
    assert log.read_bytes() == before


@pytest.mark.thorough
def test_a_filled_table_that_is_no_log_yet_is_not_written_over_either(
    diagnosed: Diagnosed, rig: Path
) -> None:
    """One that still is as it was written is replaced."""
    table = rig.parent / "rig_next_1.csv"
    for _ in range(2):
        diagnosed()
        assert {it.name for it in rig.parent.glob("*.csv")} == {"log.csv", table.name}
    head, *rows = table.read_text().splitlines()
    filled = "\n".join([f"{head},angle", *(f"{row},0.1" for row in rows)])
    table.write_text(filled)
    _, (told,) = diagnosed()
    assert table.read_text() == filled
    assert told["file"] == "rig_next_2.csv"


@pytest.mark.thorough
def test_without_a_file_no_table_is_promised(
    rig: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sine = planned(rig)
    monkeypatch.setattr(design, "next_experiments", lambda *_: (sine,))
    monkeypatch.chdir(tmp_path)
    _, out, _ = run("diagnose", rig, "--format", "json")
    told = json.loads(out)
    check_schema(told)
    assert [one["file"] for one in told["next_experiments"]] == [None]
    assert [it.name for it in tmp_path.iterdir()] == [rig.parent.name]
