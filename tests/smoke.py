"""Run every dependency once, through the command, in the environment of this interpreter.

``python tests/smoke.py`` takes a minute and needs none of the test extra.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path

COMMAND = Path(sysconfig.get_path("scripts")) / "servo-models"
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
OTHER_REFERENCE = 1.5  # factor on the last column of a reference, which no tolerance allows


def expect(code: int, said: str, *words: str, **environment: str) -> None:
    """Run a command line.

    Raises:
        SystemExit: it ends with another code, or does not say ``said``.
    """
    done = subprocess.run(
        [COMMAND, *words], capture_output=True, text=True, check=False, env=os.environ | environment
    )
    if done.returncode != code or said not in done.stdout + done.stderr:
        raise SystemExit(
            f"servo-models {' '.join(words)}: exit code {done.returncode} in place of {code}, or no"
            f" '{said}' in\n{done.stdout}{done.stderr}"
        )


def smoke() -> None:
    """Run the commands in this folder."""
    for name in ("gimbal", "torque_motor", "two_csv_files", "uav"):
        shutil.copytree(EXAMPLES / name, name)
    expect(0, "torque_motor", "list")
    expect(2, "did you mean 'sg90'", "simulate", "sg9")
    expect(2, "absent.fmu", "validate", "absent.fmu")

    motor = ("simulate", "torque_motor", "--set", "stiffness=5 mN.m/rad")
    expect(0, "overshoot", *motor, "--out", "right.csv", "--plot", "step.svg")
    expect(0, "overshoot", *motor, "--out", "numba.parquet", CC="none")
    expect(0, "motor_torque", *motor, "--inputs", "numba.parquet")
    expect(0, "motor.fmu", "build", *motor[1:], "--out", "motor.fmu")
    head, *rows = Path("right.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    at = head.split(",").index("angle [rad]")
    wrong = [[*row[:at], str(OTHER_REFERENCE * float(row[at])), *row[at + 1 :]] for row in cells]
    Path("wrong.csv").write_text("\n".join([head, *map(",".join, wrong)]))
    expect(0, "PASSED", "validate", "motor.fmu", "--static-only")
    expect(0, "PASSED", "validate", "motor.fmu", "--reference", "right.csv", "--report", "a.html")
    expect(1, "FAILED", "validate", "motor.fmu", "--reference", "wrong.csv")

    expect(0, "drive_dead_zone", "check", "gimbal/gimbal.toml")
    files = ("--report", "gap.html", "--json", "gap.json", "--out", "gap.toml")
    expect(1, "drive_dead_zone", "diagnose", "gimbal/gimbal.toml", *files)
    expect(0, "wrote", "explore", "gimbal/gimbal.toml", "--no-show")
    expect(0, "servo.csv", "new", "example", "servo.toml")
    expect(1, "backlash", "diagnose", "servo.toml")
    on = ("--on", "gimbal/gimbal.toml")
    expect(0, "half_width", "compare", "gap.json", "gap.toml", "--trust", *on)
    expect(0, "Bandwidth", "figures", "sg90", "--plot", "sg90.svg")
    expect(0, "wrote", "explain", "backlash", "--page", "backlash.html")
    expect(0, "hobby servo", "explain", "sg90", "--diagram", "sg90_chain.svg")
    expect(0, "drive_dead_zone.half_width", "sample", "gap.toml", "--trust", "--out", "sets.csv")
    expect(0, "SIM_SERVO_DELAY", "export", "uav/GAP.toml", "--to", "ardupilot", "--out", "a.parm")
    expect(0, "SIM_SERVO_DELAY", "import", "a.parm")
    expect(0, "RMS errors", "identify", "two_csv_files/description.toml")
    expect(1, "transport_delay", "identify", "torque_motor/description.toml", "--report", "b.html")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        os.environ["SERVO_MODELS_CACHE"] = str(Path(folder) / "cache")
        smoke()
        os.chdir(EXAMPLES)
    print("every command does its work")
