"""Commands on frames of 20 ms that are logged at the next row are no hold, and hide no play."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.schema import Section
from servo_models.diagnosis import summary
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.verdict import EFFECT, PARAMETERS
from studies.far_parameters import BELIEVED, NOISE
from tests.support.logs import changed, log_of

FINE = 1e-3
TIMES: Array = FINE * np.arange(12_000)
FRAME = 20  # fine steps


def told(true: dict[str, float], row: float, uneven: float) -> Description:
    """A bus servo whose goals come every 20 ms, logged in rows of their own clock [s]."""
    nominal, path, random = (
        model("second_order_servo", "bus"),
        Path("rig.toml"),
        np.random.default_rng(0),
    )
    levels = random.uniform(-0.8, 0.8, 12)
    levels[0] = 0.0
    sweep = 0.4 * np.sin(2.0 * np.pi * (0.3 + 0.12 * TIMES) * TIMES)
    smooth = np.where(TIMES < 6.0, levels[np.minimum(TIMES.astype(int), 11)], sweep)
    sent = smooth[np.arange(len(TIMES)) // FRAME * FRAME]
    angle = simulate(changed(nominal, true), TIMES, {"goal": sent})["angle"]
    steps = row / FINE * (1.0 + uneven * random.uniform(-1.0, 1.0, int(12.0 / row)))
    rows = np.concatenate([[0], np.cumsum(np.maximum(np.round(steps), 1).astype(int))])
    rows = rows[rows < len(TIMES)]
    reading = angle[rows] + NOISE * random.standard_normal(len(rows))
    log = log_of(TIMES[rows], {"goal": sent[rows]}, {"angle": reading})
    return Description(path, Section(path, "", {}), nominal, {}, BELIEVED, (log,))


CLOCKS = pytest.mark.parametrize(("row", "uneven"), [(7e-3, 0.0), (12e-3, 0.0), (10e-3, 0.4)])


@pytest.mark.thorough
@CLOCKS
def test_they_are_no_hold(row: float, uneven: float) -> None:
    found = diagnose(told({"natural_frequency": 25.0}, row, uneven), jobs=1)
    assert found.verdict.kind == PARAMETERS
    assert found.between_rows
    assert summary.sentence(found).startswith("If commands were sent between the rows")
    value = next(it.value for it in found.found if it.name == "natural_frequency")
    assert value == pytest.approx(25.0, rel=0.03)


@pytest.mark.thorough
@CLOCKS
def test_a_play_is_found_beside_them(row: float, uneven: float) -> None:
    found = diagnose(told({"backlash.half_width": 0.02}, row, uneven), jobs=1)
    assert found.verdict.kind == EFFECT
    assert found.selection.taken.effects == ("backlash",)
    assert found.ranking[0].probability is None  # learnt from logs whose commands are known
    assert "Log each command with the time at which it is sent" in str(found)
    value = next(it.value for it in found.found if it.name == "backlash.half_width")
    assert value == pytest.approx(0.02, rel=0.1)


@pytest.mark.thorough
def test_commands_that_are_logged_as_they_are_sent_are_believed() -> None:
    found = diagnose(told({"natural_frequency": 25.0}, 20e-3, 0.0), jobs=1)
    assert found.verdict.kind == PARAMETERS
    assert not found.between_rows
