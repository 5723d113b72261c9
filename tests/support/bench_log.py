"""A bench log of the exact motor as text, and its description."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.support.exact_motor import STEP, TRUE, prbs, rig

NOISE = np.radians(0.01)
HEAD = """
actuator = "torque_motor"
variant = "measured"
free = ["torque_constant", "inductance", "friction_coefficient"]
[parameters]
end_stops.half_range = 0.0
"""
LOG = """
[[logs]]
file = "log.csv"
time = { column = "time_ms", unit = "ms" }
inputs.voltage = { column = "u", unit = "V" }
outputs.angle = { column = "angle_deg", unit = "deg" }
held_out = { from = "0.5 s", to = "0.75 s" }
"""


def rows_of(count: int = 1500, seed: int = 3) -> list[list[str]]:
    """Cells of a bench log: ms, V and deg with noise."""
    voltage = prbs(count, seed)
    voltage[:20] = 0.0  # at rest, as a bench log begins
    noise = NOISE * np.random.default_rng(seed).standard_normal(count)
    angle = np.degrees(rig(TRUE, voltage) + noise)
    times = 1e3 * STEP * np.arange(count)
    return [[f"{t:g}", f"{u:g}", f"{y:.6f}"] for t, u, y in zip(times, voltage, angle)]


def write_log(folder: Path, rows: list[list[str]]) -> None:
    lines = [",".join(row) for row in [["time_ms", "u", "angle_deg"], *rows]]
    (folder / "log.csv").write_text("\n".join(lines) + "\n")


def laid_out(folder: Path) -> Path:
    """A folder with a log and its description, ``mine.toml``."""
    write_log(folder, rows_of())
    (folder / "mine.toml").write_text(HEAD + LOG)
    return folder


def changed(old: str, new: str) -> Callable[[Path], None]:
    """Change the description."""

    def change(folder: Path) -> None:
        whole = HEAD + LOG
        assert old in whole
        (folder / "mine.toml").write_text(whole.replace(old, new))

    return change
