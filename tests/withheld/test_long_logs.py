"""The long recordings of the second plant can be read and have the size that they state."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from servo_models.data.description import read_description
from studies.second_plant.long_logs import current_motor, loaded_servo, sts3215_joint


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("write", "logs", "rows", "period"),
    [
        (sts3215_joint, 10, 10 * 24 * 50, 1.0 / 50.0),
        (current_motor, 9, 9 * 440, 1.0 / 440.0),
        (loaded_servo, 5, 1400, 1.0 / 100.0),
    ],
)
def test_a_long_recording_is_read_and_has_its_rows(
    write: Callable[[Path], Path], logs: int, rows: int, period: float, tmp_path: Path
) -> None:
    read = read_description(write(tmp_path / "recording")).logs
    assert (len(read), sum(len(log.times) for log in read)) == (logs, rows)
    assert all(np.allclose(np.diff(log.times), period, rtol=1e-5) for log in read)
