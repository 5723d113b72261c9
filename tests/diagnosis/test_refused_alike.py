"""What identify refuses, diagnose refuses in the same words; an input may be constant in a run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from tests.conftest import Run

HEAD = """actuator = "torque_motor"
variant = "identified"
free = ["torque_constant", "inductance"]
[uncertainty]
torque_constant = "20 %"
inductance = "20 %"
"""
LOG = """[[logs]]
file = "{0}.csv"
time = "t"
inputs.voltage = "u"
outputs.angle = "angle"
{1}
"""
TIMES = np.arange(0.0, 0.3, 1e-3)
SQUARE = 8.0 * np.sign(np.sin(2.0 * np.pi * 12.0 * TIMES))
STILL = np.zeros(len(TIMES))


def recorded(folder: Path, name: str, voltage: Array, load: float = 0.0) -> None:
    rig = model("torque_motor", "identified")
    loads = np.full(len(TIMES), load)
    angle = simulate(rig, TIMES, {"voltage": voltage, "load_torque": loads})["angle"]
    angle = angle + 1e-4 * np.random.default_rng(1).standard_normal(len(TIMES))
    rows = np.column_stack([TIMES, voltage, angle, loads])
    np.savetxt(
        folder / f"{name}.csv", rows, "%.9g", delimiter=",", header="t,u,angle,load", comments=""
    )


def description(folder: Path, *logs: str, head: str = HEAD) -> Path:
    path = folder / "rig.toml"
    path.write_text(head + "".join(logs))
    return path


AWAY = (
    "[parameters]\nstiffness = 0.3\nend_stops.half_range = 0\n"
    "stiffness_hardening.coefficient = -200\n"
)
"""A spring that softens until the rotor runs away."""


@pytest.mark.parametrize(
    ("head", "logs", "said"),
    [
        (HEAD, [("still", "")], "no input ever changes, neither in a log nor from one to another"),
        (HEAD, [("still", ""), ("square", "held_out = true")], "no input ever changes"),
        (HEAD, [("square", 'held_out = { from = "2 ms" }')], "2 samples to fit for 2 free param"),
        (HEAD, [("square", "held_out = true")], "rig.toml' holds out every sample"),
        (f'method = "simulation"\nsweeps = []\n{HEAD}', [], "rig.toml', sweeps: has no table"),
        (HEAD + AWAY, [("square", "")], "the nominal model cannot be simulated on log 'square'"),
    ],
)
def test_both_commands_refuse_in_the_same_words(
    run: Run, tmp_path: Path, head: str, logs: list[tuple[str, str]], said: str
) -> None:
    recorded(tmp_path, "still", STILL)
    recorded(tmp_path, "square", SQUARE)
    path = description(tmp_path, *(LOG.format(*log) for log in logs), head=head)
    told = []
    for command in ("identify", "diagnose"):
        code, out, err = run(command, path)
        assert (code, out) == (2, "")
        told.append(err)
    assert told[0] == told[1]
    assert told[0].count("\n") == 1
    assert said in told[0]


@pytest.mark.thorough
@pytest.mark.parametrize("command", ["check", "identify", "diagnose"])
def test_runs_with_an_input_that_does_not_change_in_them(
    command: str, run: Run, tmp_path: Path
) -> None:
    """Each run has its own load, and one of them stands still."""
    mapped = 'inputs.load_torque = "load"\nsettle = 0'
    runs = {"free": (SQUARE, 0.0), "loaded": (SQUARE, 2e-3), "still": (STILL, 2e-3)}
    for name, (voltage, load) in runs.items():
        recorded(tmp_path, name, voltage, load)
    path = description(tmp_path, *(LOG.format(name, mapped) for name in runs))
    code, out, err = run(command, path, *(["--format", "json"] if command == "diagnose" else []))
    assert code == 0, err
    assert "ever changes" not in out
    if command == "diagnose":
        assert json.loads(out)["verdict"] == "no-gap"
