"""Exit codes of every command, as docs/commands.md and its own help promise them.

The command line itself lists the commands, so that a new one needs its row.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import typer

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.cli import app
from tests.conftest import Run

STEP, COUNT, HOLD = 0.01, 600, 40  # s, rows, rows
NOISE = 1e-3  # rad
ROWS_LATE = 3
DESCRIPTION = """
actuator = "second_order_servo"
variant = "bus"
free = ["natural_frequency"]
[uncertainty]
natural_frequency = "20 %"
[[logs]]
file = "{name}.csv"
time = {{ column = "t", unit = "s" }}
inputs.goal = {{ column = "goal", unit = "rad" }}
outputs.angle = {{ column = "angle", unit = "rad" }}
"""
CASES = [
    (0, "list"),
    (2, "list sg90"),
    (0, "explain backlash"),
    (2, "explain nothing"),
    (0, "explore right.toml --no-show --out page.html"),
    (2, "explore absent.toml --no-show"),
    (0, "new actuator mine.py"),
    (2, "new actuator right.toml"),
    (0, "simulate torque_motor --stop 0.02"),
    (1, "simulate dc_motor --stop 30"),
    (2, "simulate sg9"),
    (0, "figures torque_motor"),
    (2, "figures torque_motor --amplitude 1m"),
    (0, "build torque_motor --out motor.fmu"),
    (2, "build nothing"),
    (0, "validate motor.fmu --static-only"),
    (1, "validate motor.fmu --reference wrong.csv"),
    (2, "validate absent.fmu"),
    (0, "check right.toml"),
    (1, "check clipped.toml"),
    (2, "check absent.toml"),
    (0, "identify right.toml --out PARAMS.toml"),
    (1, "identify late.toml"),
    (1, "identify midway.toml"),
    (1, "identify clipped.toml"),
    (2, "identify absent.toml"),
    (0, "diagnose right.toml --json right.json"),
    (1, "diagnose late.toml --quick"),
    (2, "diagnose right.toml --time-limit 0s"),
    (0, "rehearse plan.toml --noise angle=1mrad --effects dead_band --gap 3"),
    (1, "rehearse plan.toml --noise angle=1mrad --effects dead_band --gap 3 --time-limit 1us"),
    (2, "rehearse plan.toml --time-limit 0s"),
    (0, "survey right.toml --quick --out right"),
    (1, "survey late.toml --quick --out late"),
    (2, "survey absent"),
    (0, "compare right.json PARAMS.toml"),
    (2, "compare absent.json"),
    (0, "sample PARAMS.toml --count 3"),
    (2, "sample right.toml"),
    (0, "export PARAMS.toml --to ardupilot --out servo.parm"),
    (2, "export PARAMS.toml --to nothing"),
    (0, "import servo.parm"),
    (2, "import absent.xml"),
    (0, "blind --cases 1 --seed 1 --tiers easy"),
    (2, "blind --cases 1 --seed 1 --tiers none"),
]


def lay_out(folder: Path) -> None:
    """Logs: right; with late commands; of a servo that changes; clipped; and a plan of commands."""
    times = STEP * np.arange(COUNT)
    random = np.random.default_rng(20265)
    goal = np.repeat(random.uniform(-0.6, 0.6, COUNT // HOLD), HOLD)
    noise = NOISE * random.standard_normal(COUNT)
    servos = [model("second_order_servo", "bus", {"natural_frequency": w}) for w in (30.0, 45.0)]
    slow, fast = (simulate(servo, times, {"goal": goal})["angle"] for servo in servos)
    angle = slow + noise
    late = np.concatenate([np.full(ROWS_LATE, goal[0]), goal[:-ROWS_LATE]])
    midway = np.where(times < times[COUNT // 2], slow, fast) + noise
    logs = {
        "right": (goal, angle),
        "late": (late, angle),
        "midway": (goal, midway),
        "clipped": (goal, np.clip(angle, -0.3, 0.3)),
        "plan": (goal,),
    }
    for name, columns in logs.items():
        table = np.column_stack([times, *columns])
        head = ",".join(["t", "goal", "angle"][: 1 + len(columns)])
        np.savetxt(folder / f"{name}.csv", table, "%.9g", delimiter=",", header=head, comments="")
        (folder / f"{name}.toml").write_text(DESCRIPTION.format(name=name))
    at = np.linspace(0.0, 0.05, 6)
    wrong = np.column_stack([at, np.full(6, 3.0)])
    np.savetxt(
        folder / "wrong.csv", wrong, delimiter=",", header="time [s],angle [rad]", comments=""
    )


def test_every_command_has_a_row_for_each_code_that_its_help_promises() -> None:
    commands = vars(typer.main.get_command(app))["commands"]
    rows: dict[str, set[int]] = {name: set() for name in commands}
    for code, words in CASES:
        rows[words.split()[0]].add(code)
    rows["blind"].add(1)  # a diagnosis that crashes cannot be asked for
    warns = {name for name, command in commands.items() if ", 1: " in command.help}
    promised = {name: {0, 1, 2} if name in warns else {0, 2} for name in commands}
    assert rows == promised


@pytest.mark.thorough
def test_exit_codes(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one folder and in this order: later rows read what earlier ones write."""
    lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    wrong = []
    for code, words in CASES:
        ended, out, err = run(*words.split())
        if ended != code:
            wrong.append(f"{words}: {ended} in place of {code}\n{out[:800]}{err[:400]}")
    assert not wrong, "\n\n".join(wrong)
