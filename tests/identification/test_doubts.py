"""``identify`` exits 1 where its values are doubtful, and says so first.

Logs are simulated with a servo that is known, and then one fault is put in.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from tests.conftest import Run
from tests.support.bench_log import NOISE, laid_out
from tests.support.exact_motor import STEP, TRUE, prbs, rig

DISBELIEVED = "Doubtful"
COUNT, HOLD = 1500, 100
NOISE_OF_READING = 1e-3  # rad
DESCRIPTION = """
actuator = "second_order_servo"
variant = "bus"
free = {free}
[[logs]]
file = "log.csv"
time = {{ column = "t", unit = "s" }}
inputs.goal = {{ column = "u", unit = "rad" }}
outputs.angle_reading = {{ column = "y", unit = "rad" }}
"""


def described(
    folder: Path,
    rig_name: tuple[str, str] = ("second_order_servo", "bus"),
    noise: float = NOISE_OF_READING,
    odd: dict[int, float] | None = None,
    free: Sequence[str] = ("natural_frequency", "damping_ratio", "speed_limit"),
    true: dict[str, float] | None = None,
) -> Path:
    """The description of a log of steps; ``odd`` adds [rad] to the readings of these rows."""
    times = 4e-3 * np.arange(COUNT)
    random = np.random.default_rng(7)
    goal = np.repeat([0.0, *random.uniform(-1.0, 1.0, COUNT // HOLD - 1)], HOLD)
    reading = simulate(model(*rig_name, true), times, {"goal": goal})["angle"]
    reading = reading + noise * random.standard_normal(COUNT)
    for row, size in (odd or {}).items():
        reading[row] += size
    table = np.column_stack([times, goal, reading])
    np.savetxt(folder / "log.csv", table, "%.9g", delimiter=",", header="t,u,y", comments="")
    path = folder / "rig.toml"
    path.write_text(DESCRIPTION.format(free=list(free)))
    return path


def first_lines(out: str) -> str:
    """The title and the sentence below it."""
    return " ".join(" ".join(out.strip().split("\n\n")[:2]).split())


@pytest.mark.parametrize(
    "true", [{"natural_frequency": 40.0}, {"transport_delay.time": 0.0}], ids=str
)
def test_a_right_fit_is_believed(run: Run, tmp_path: Path, true: dict[str, float]) -> None:
    """An effect of size 0 is found to be off, though that is its bound."""
    path = described(tmp_path, free=("natural_frequency", *true), true=true)
    code, out, _ = run("identify", path)
    assert (code, DISBELIEVED in out) == (0, False)


def test_a_constant_on_its_bound_is_not_believed(run: Run, tmp_path: Path) -> None:
    """The friction of the rig is below 0, where the model has none."""
    path = laid_out(tmp_path) / "mine.toml"
    voltage = prbs(1500, 3)
    noise = NOISE * np.random.default_rng(3).standard_normal(1500)
    angle = np.degrees(rig({**TRUE, "friction_coefficient": -2e-6}, voltage) + noise)
    table = np.column_stack([1e3 * STEP * np.arange(1500), voltage, angle])
    head = "time_ms,u,angle_deg"
    np.savetxt(tmp_path / "log.csv", table, "%.9g", delimiter=",", header=head, comments="")
    code, out, _ = run("identify", path)
    assert code == 1
    assert DISBELIEVED in first_lines(out)
    assert "'friction_coefficient' sits on its low bound" in " ".join(out.split())
    assert "'friction_coefficient' is not excited" not in out


def test_a_gap_of_any_size_is_said_first(run: Run, tmp_path: Path) -> None:
    """A smart servo has a motor and a controller, and is no second order with limits."""
    code, out, _ = run("identify", described(tmp_path, ("smart_servo", "xl330"), noise=1e-5))
    assert code == 1
    assert DISBELIEVED in first_lines(out)
    assert "noise floors: the model lacks something" in first_lines(out)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "odd",
    [
        {**dict.fromkeys(range(150, 1400, 47), 1.5), 620: 2.0},
        {150 + 53 * k: 0.3 * 1.15**k for k in range(22)},
    ],
    ids=["many", "of all sizes"],
)
def test_wild_readings_that_move_the_fit_are_not_believed(
    run: Run, tmp_path: Path, odd: dict[int, float]
) -> None:
    """More of them than are left out."""
    code, out, _ = run("identify", described(tmp_path, odd=odd))
    assert code == 1
    assert DISBELIEVED in first_lines(out)
    largest = max(odd, key=lambda row: odd[row])
    assert f"row {largest + 2}" in " ".join(out.split())  # the header is row 1
