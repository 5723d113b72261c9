"""A log of the torque motor with a description, and the sentence about a fault in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from servo_models.data.description import Description, read_description
from servo_models.errors import UserError

DEGREE = math.pi / 180.0
HEAD = 'actuator = "torque_motor"\nvariant = "measured"\n'
LOG = """
[[logs]]
file = "log.csv"
time = { column = "time_ms", unit = "ms" }
inputs.voltage = { column = "u", unit = "V" }
outputs.angle = { column = "angle_deg", unit = "deg" }
"""
TABLE = [(100.0 + 5.0 * i, float(i % 3), 0.1 * i) for i in range(20)]


def text_of(rows: Sequence[Sequence[object]], header: str = "time_ms,u,angle_deg") -> str:
    return "\n".join([header, *(",".join(str(cell) for cell in row) for row in rows)])


def describe(
    folder: Path, log: str = LOG, head: str = HEAD, data: str | None = None
) -> Description:
    """Write a description beside its log, and read it."""
    (folder / "log.csv").write_text(text_of(TABLE) if data is None else data)
    path = folder / "description.toml"
    path.write_text(head + log)
    return read_description(path)


def complaint(folder: Path, **options: Any) -> str:
    """The sentence about a fault, which is one line."""
    with pytest.raises(UserError) as caught:
        describe(folder, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)
