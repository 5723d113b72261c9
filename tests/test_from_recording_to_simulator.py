"""From a robot's recording to the lines of its simulator, by the commands of the documentation."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from servo_models import model, simulate
from servo_models.core.types import Array
from tests.conftest import Run
from tests.support.dataflash import flight_log
from tests.support.document import ROOT
from tests.support.engines import ardupilot_angles, jsbsim_angles
from tests.support.lerobot import FPS, JOINTS, data_set

DELAY = 0.13  # s, of which the variant knows nothing


def moved(frames: int, seed: int) -> tuple[Array, Array]:
    """Commands [deg] of slow motions, and what a late servo makes of them, both joints alike."""
    times = np.arange(frames) / FPS
    random = np.random.default_rng(seed)
    waves = [random.uniform(5.0, 15.0) * np.sin(w * times) for w in (1.1, 2.3, 4.1)]
    goal = np.round(np.sum(waves, axis=0), 2)
    servo = model("second_order_servo", "bus", {"transport_delay.time": DELAY})
    rest = {"goal": np.radians(goal), "pulse_width": 1.5e-3}
    angle = np.degrees(simulate(servo, times, rest)["angle_reading"])
    read = np.round(angle + 0.05 * random.standard_normal(frames), 2)
    return np.column_stack([goal, goal]), np.column_stack([read, read])


@pytest.mark.thorough
def test_a_joint_of_a_data_set_becomes_lines_of_mujoco(run: Run, tmp_path: Path) -> None:
    """LeRobot folder, description, diagnosis, MJCF: the delay comes through."""
    data_set(tmp_path / "arm", [moved(300, seed) for seed in range(3)])
    code, out, err = run("check", tmp_path / "arm", "--init")
    assert (code, out.count("wrote")) == (0, len(JOINTS)), err
    description, found = tmp_path / "arm_elbow.toml", tmp_path / "GAP.toml"
    code, out, err = run("diagnose", description, "--out", found)
    assert code == 1, err
    code, out, err = run("export", found, "--to", "mujoco", "--log", description)
    assert code == 0, err
    line = next(line for line in out.splitlines() if line.startswith("<position"))
    (delay,) = re.findall(r'delay="([\d.]+)"', line)
    assert float(delay) == pytest.approx(DELAY, abs=0.5 / FPS)
    (share,) = re.findall(r"MuJoCo keeps (\d+) %", out)
    assert int(share) > 80


ROW_S = 0.02  # time between two rows of a flight log
FINE_S = 1e-3  # step of the surface's own integration
LATE_S = 0.06  # delay of the surface
LAG_S = 0.05  # time constant of the surface
FASTEST = 4.0  # rad/s, largest rate of the surface


def flown(rows: int, seed: int) -> tuple[Array, Array]:
    """Commands and deflections [rad] of a surface with delay, lag and largest rate."""
    random = np.random.default_rng(seed)
    times = ROW_S * np.arange(rows)
    sweep = 0.15 * np.sin(2.0 * np.pi * (0.3 + 0.05 * times) * times)
    goal = np.repeat(random.uniform(-0.5, 0.5, rows), 25)[:rows] + sweep
    goal[:10] = 0.0
    fine = np.repeat(goal, round(ROW_S / FINE_S))
    lagged = deflection = 0.0
    deflections = []
    for late in np.concatenate([np.zeros(round(LATE_S / FINE_S)), fine]):
        deflections.append(deflection)
        lagged += FINE_S / LAG_S * (late - lagged)
        way = FASTEST * FINE_S
        deflection += min(max(lagged - deflection, -way), way)
    return goal, np.array(deflections)[: len(fine) : round(ROW_S / FINE_S)]


def rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


@pytest.mark.thorough
def test_a_flight_log_becomes_a_surface_of_jsbsim_and_of_sitl(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The engine of JSBSim, and a second writing of SITL's law, fly the flight with the lines: they
    leave what the export says, and in another flight as little."""
    for package in ("pymavlink.DFReader", "jsbsim"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    goal, deflection = flown(700, seed=1)
    read = deflection + np.random.default_rng(2).normal(0.0, 1e-3, len(goal))
    times, servo = ROW_S * np.arange(len(goal)), (np.degrees(read), np.degrees(goal))
    flight_log(Path("flight.bin"), times, {1: servo, 2: (0.0 * read, servo[1])})
    page = (ROOT / "docs" / "simulators.md").read_text(encoding="utf-8")
    (block,) = (it for it in page.split("```\n") if it.startswith("servo-models check flight.bin"))
    check, diagnose, *exports = (line.split()[1:] for line in block.splitlines())
    assert run(*check)[0] == 0
    assert run(*diagnose)[0] == 1  # a gap is found
    other, other_deflection = flown(700, seed=3)
    for words, step, fly in (
        (exports[0], 1.0 / 120.0, lambda *it: jsbsim_angles(*it, tmp_path)),
        (exports[1], 1.0 / 1200.0, ardupilot_angles),
    ):
        told = tmp_path / f"{words[3]}.json"
        code, _, err = run(*words, "--json", told)
        assert code == 0, err
        (errors,) = json.loads(told.read_text())["errors"]
        grid = np.arange(0.0, times[-1] + step, step)
        row = np.searchsorted(times, grid + 1e-6, side="right") - 1
        lines = Path(words[-1]).read_text()
        left = [
            rms(np.interp(times, grid, fly(lines, step, command[row])) - angle)
            for command, angle in ((goal, read), (other, other_deflection))
        ]
        assert left[0] == pytest.approx(errors["native"], rel=0.03), words
        assert max(left) < 0.3 * errors["nominal"], words
    rate = re.findall(r"<rate_limit>([\d.]+)<", Path("servo.xml").read_text())
    assert [float(it) for it in rate] == [pytest.approx(FASTEST, rel=0.05)]
