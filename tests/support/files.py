"""Files of measured columns, and the sentence about a fault in one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st

from servo_models.data.readers import read_columns
from servo_models.errors import UserError

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ROWS = st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=12)


def file(folder: Path, content: str | bytes, name: str = "log.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def complaint(path: Path, column: str | int = 1, **options: Any) -> str:
    """The sentence about a fault, which is one line and names the file."""
    with pytest.raises(UserError) as caught:
        read_columns(path, **options).numbers(column)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message
